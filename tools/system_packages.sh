#!/usr/bin/env bash
# Checks what PyPI cannot bring: Python itself, a compiler with cmake, a few system libraries.
# On Debian and Ubuntu it installs what is missing where it may; else it says how to.
set -euo pipefail
python=${PYTHON:-python3}
caller=set-up
# shellcheck source=tools/debian_packages.sh
source "$(dirname "$0")/debian_packages.sh"

main() {
    check_machine
    local packages
    mapfile -t packages < <(missing)
    if [ ${#packages[@]} -ne 0 ]; then
        bring "${packages[@]}"
        mapfile -t packages < <(missing)
        if [ ${#packages[@]} -ne 0 ]; then
            fail "$(command -v "$python") still lacks ${packages[*]}, which apt-get did install." \
                "They belong to Debian's own Python. Try: make setup PYTHON=/usr/bin/python3"
        fi
    fi
    check_python
}

check_machine() {
    if [ "$(uname -sm)" != "Linux x86_64" ]; then
        fail "this machine is $(uname -sm); expected Linux x86_64, where there are ROS 2 wheels." \
            "Elsewhere build src/ with a ROS 2 Jazzy of its own: rosdep install, colcon build."
    fi
    case $PWD in
        *[[:space:]]*) fail "the path of this folder has a space: $PWD." \
            "The first line of a script cannot name a Python there. Move the folder." ;;
    esac
    # Without a python3, Debian's is installed; a Python that is there has to be of use.
    if [ "$python" != python3 ] || command -v python3 > /dev/null; then check_python; fi
}

check_python() {
    local version
    command -v "$python" > /dev/null || fail "there is no $python; expected Python 3.10 to 3.13"
    version=$("$python" -c 'import sys; print("%d.%d.%d" % sys.version_info[:3])' 2>&1) || true
    case $version in
        3.10.* | 3.11.* | 3.12.* | 3.13.*) ;;
        [0-9]*) fail "$python is Python $version; expected 3.10 to 3.13." \
            "Install one of them and name it: make setup PYTHON=python3.11" ;;
        *) fail "$python does not run (${version//$'\n'/ }); expected Python 3.10 to 3.13" ;;
    esac
}

missing() { # Debian's names of what is not there
    command -v cmake > /dev/null || echo cmake
    command -v ninja > /dev/null || echo ninja-build
    command -v gcc > /dev/null || echo gcc
    command -v g++ > /dev/null || echo g++
    command -v "$python" > /dev/null || echo python3
    "$python" -c 'import ensurepip, venv' 2> /dev/null || echo python3-venv
    "$python" -c 'import os, sys, sysconfig
sys.exit(not os.path.exists(sysconfig.get_path("include") + "/Python.h"))' 2> /dev/null ||
        echo python3-dev
    local libraries pair
    libraries=$(PATH=$PATH:/usr/sbin:/sbin ldconfig -p)
    for pair in libusb-1.0.so.0:libusb-1.0-0 libGL.so.1:libgl1 libEGL.so.1:libegl1 \
        libX11.so.6:libx11-6 libudev.so.1:libudev1 libgomp.so.1:libgomp1; do
        grep -qF "${pair%%:*} " <<< "$libraries" || echo "${pair##*:}"
    done
}

main
