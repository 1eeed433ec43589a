#!/usr/bin/env bash
# Makes the virtual environment and installs the pinned requirements into it.
set -euo pipefail
python=${PYTHON:-python3}
under_way=.venv/.setup/packages_under_way

# An interrupted pip leaves packages that look installed and are not whole.
if [ -e "$under_way" ]; then rm -rf .venv; fi
if ! .venv/bin/python -m pip --version > /dev/null 2>&1; then
    echo "set-up: making .venv from $("$python" --version)"
    rm -rf build/colcon # CMake remembers the folder and the Python it was built with
    "$python" -m venv --clear .venv
fi
mkdir -p .venv/.setup
touch "$under_way"

install() { PIP_USER=0 .venv/bin/python -m pip --disable-pip-version-check install -qq "$@"; }

if ! .venv/bin/python -c 'import sys; sys.exit(sys.version_info >= (3, 12))'; then
    # There is no wheel of PyBullet for these. Built without NumPy, its images come as tuples.
    echo "set-up: building PyBullet, which takes minutes"
    install -c requirements/constraints.txt numpy setuptools
    CFLAGS="-g0 ${CFLAGS:-}" install -c requirements/constraints.txt \
        --use-pep517 --no-build-isolation pybullet
fi
echo "set-up: installing packages (2 GB, about two minutes)"
install -r requirements/ros.txt -r requirements/runtime.txt -r requirements/test.txt \
    -r requirements/docs.txt
rm "$under_way"
