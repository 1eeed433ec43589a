#!/usr/bin/env bash
# Makes .venv: packages, the built workspace, compiled kernels. Each step is done once, and again
# only when what it is made from has changed; what was interrupted goes on where it can.
set -euo pipefail
cd "$(dirname "$0")/.."
tools=tools
root=$PWD
stamps=.venv/.setup

digest() { sha256sum | cut -d ' ' -f 1; }

# What goes into the workspace. Tests run from the source tree and texts are not installed.
sources() {
    find src -type f -not -path '*/test/*' -not -path '*/__pycache__/*' \
        -not -path '*.egg-info/*' -not -name '*.md' -not -name CHANGELOG.rst -print0 | LC_ALL=C sort -z
}

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
    flock 9
fi

# A folder that was moved or copied has an environment that points elsewhere.
if [ -e .venv ] && ! grep -qsF "$root/.venv" .venv/bin/activate; then rm -rf .venv; fi

packages=$(cat requirements/*.txt $tools/packages.sh | digest)
workspace=$({ echo "$packages"; cat $tools/workspace.sh $tools/ros_wheel_paths.cmake
              sources | xargs -0 sha256sum; } | digest)
kernels=$({ echo "$workspace"; cat $tools/kernels.sh; } | digest)

if ! done_before packages "$packages" || ! done_before workspace "$workspace"; then
    $tools/system_packages.sh
fi
step packages "$packages" $tools/packages.sh
step workspace "$workspace" $tools/workspace.sh
step kernels "$kernels" $tools/kernels.sh
