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
# What pip is told of a setting, by its environment or its files; uv reads neither.
told_pip() { .venv/bin/python -m pip config list | sed -n "s/^[^=]*\.$1='\(.*\)'$/\1/p" | tail -n 1; }

install_quickly() { # requirements …; silent where it fails, as pip says the same then
    install -r requirements/installer.txt
    local index extra links certificates
    index=$(told_pip index-url) extra=$(told_pip extra-index-url)
    links=$(told_pip find-links) certificates=$(told_pip cert)
    env ${index:+UV_DEFAULT_INDEX="$index"} ${extra:+UV_INDEX="$extra"} \
        ${links:+UV_FIND_LINKS="$links"} ${certificates:+SSL_CERT_FILE="$certificates"} \
        .venv/bin/uv pip install --quiet --no-config --python .venv/bin/python \
        --index-strategy unsafe-best-match --compile-bytecode "$@" 2> /dev/null
}

all=(-r requirements/ros.txt -r requirements/runtime.txt -r requirements/test.txt
    -r requirements/docs.txt)
echo "set-up: installing packages (2 GB)"
if ! install_quickly "${all[@]}"; then
    echo "set-up: uv cannot install them; pip tries, which takes minutes"
    install "${all[@]}"
fi
rm "$under_way"
