#!/usr/bin/env bash
# Makes build/oldest, an environment with the versions of Ubuntu 24.04 and our libraries, installed by
# pip as a user without ROS would.
set -euo pipefail
oldest=requirements/oldest/ubuntu_24_04.txt
place=build/oldest

# These versions have wheels up to 3.11 only.
supported() { "$1" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 12))' 2> /dev/null; }
python=
for one in "${PYTHON:-python3}" python3.11 python3.10; do
    if supported "$one"; then
        python=$one
        break
    fi
done
if [ -z "$python" ]; then
    echo "oldest: needs Python 3.10 or 3.11, for which these versions have wheels; found neither" >&2
    exit 1
fi

mkdir -p "$place"
names=$(sed -n 's/^\([a-z]*\)==.*/\1/p' "$oldest" | paste -sd '|')
{ grep -vE "^($names|#)" requirements/constraints.txt; cat "$oldest"; } > "$place/constraints.txt"
grep -hvE '^(-c|#|mypy|ruff)' requirements/runtime.txt requirements/test.txt > "$place/packages.txt"

made_from=$(cat "$place/constraints.txt" "$place/packages.txt" "$0" | sha256sum)
if [ "$(cat "$place/made_from" 2> /dev/null)" != "$made_from" ]; then
    echo "oldest: installing packages with $("$python" --version)"
    "$python" -m venv --clear "$place/venv"
    "$place/venv/bin/python" -m pip --disable-pip-version-check install -qq hatchling \
        -c "$place/constraints.txt" -r "$place/packages.txt"
    echo "$made_from" > "$place/made_from"
fi

"$place/venv/bin/python" -m pip --disable-pip-version-check install -qq --no-deps \
    --no-build-isolation --force-reinstall .
"$place/venv/bin/python" -m intuitive_physics.kernels.warm_up intuitive_physics.simulation.compile \
    intuitive_physics_perception.compile intuitive_physics_predictor.compile
