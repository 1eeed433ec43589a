#!/usr/bin/env bash
# Makes .venv: packages, the built workspace, compiled kernels. Each step is done once, and again
# only when what it is made from has changed; what was interrupted goes on where it can.
set -euo pipefail
cd "$(dirname "$0")/.."
tools=tools
root=$PWD
stamps=.venv/.setup

digest() { sha256sum | cut -d ' ' -f 1; }

# What the workspace is built from: all else in src/ is run from there, but a new file wants a link.
built_sources() {
    find src -name setup.py -o -name package.xml -o -name CMakeLists.txt -o -name '*.cpp' \
        -o -path '*_msgs/*.*'
}
linked_names() {
    find src -type f -not -path 'src/*/intuitive_physics*/*' -not -path '*/test/*' \
        -not -path '*/__pycache__/*'
}
kernel_sources() {
    find src/intuitive_physics{,_perception,_predictor}/intuitive_physics* -name '*.py'
}
contents() { LC_ALL=C sort | xargs sha256sum; }

done_before() { [ "$(cat "$stamps/$1" 2>/dev/null)" = "$2" ]; }

step() { # name, digest of what it is made from, command …
    local name=$1 made_from=$2
    shift 2
    if done_before "$name" "$made_from"; then return; fi
    rm -f "$stamps/$name"
    "$@"
    mkdir -p "$stamps"
    echo "$made_from" > "$stamps/$name"
}

mkdir -p build
exec 9> build/setup.lock
if ! flock --nonblock 9; then
    echo "set-up: another one is under way in $root; waiting for it"
    flock --timeout 1800 9 || { echo "set-up: the other one has not ended after half an hour" >&2; exit 1; }
fi

# A folder that was moved or copied has an environment that points elsewhere.
if [ -e .venv ] && ! grep -qsF "$root/.venv" .venv/bin/activate; then rm -rf .venv; fi

packages=$(cat requirements/*.txt $tools/packages.sh | digest)
workspace=$({ echo "$packages"; cat $tools/{workspace.sh,link_packages.py,ros_wheels.cmake}
              cat pyproject.toml; built_sources | contents; linked_names | LC_ALL=C sort; } | digest)
kernels=$({ echo "$packages"; cat $tools/kernels.sh; kernel_sources | contents; } | digest)

if ! done_before packages "$packages" || ! done_before workspace "$workspace"; then
    $tools/system_packages.sh
fi
step packages "$packages" $tools/packages.sh
step workspace "$workspace" $tools/workspace.sh
step kernels "$kernels" $tools/kernels.sh
