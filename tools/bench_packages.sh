#!/usr/bin/env bash
# Brings the engines that the benchmarks compare with; nothing else needs them.
#
#   tools/bench_packages.sh             ODE, without which it fails, and Rapier
#   tools/bench_packages.sh pooltool    pooltool, 800 MB, in build/benchmarks/pooltool
set -euo pipefail
cd "$(dirname "$0")/.."
package=libode-dev
environment=build/benchmarks/pooltool

has_ode() { printf '#include <ode/ode.h>\n' | g++ -E -x c++ - > /dev/null 2>&1; }

fail() {
    printf 'benchmarks: %s\n' "$@" >&2
    exit 1
}

# Its requirements are not those of .venv.
bring_pooltool() {
    .venv/bin/python -m venv "$environment"
    "$environment/bin/pip" --disable-pip-version-check install -q pooltool-billiards
}

bring_rapier() {
    if .venv/bin/python -c "import rapier3d" 2> /dev/null; then return; fi
    echo "benchmarks: installing the Python package rapier3d"
    .venv/bin/python -m pip --disable-pip-version-check install -q \
        -c requirements/constraints.txt rapier3d || echo "benchmarks: goes on without Rapier"
}

bring_ode() {
    if has_ode; then return; fi
    if ! command -v apt-get > /dev/null; then
        fail "this machine lacks ODE, which Debian calls $package." \
            "Install it, in double precision, with the machine's own package manager and try again."
    fi
    local root=()
    if [ "$(id -u)" -ne 0 ]; then
        sudo -n true 2> /dev/null || fail "this machine lacks $package. Bring it and try again:" \
            "  sudo apt-get update && sudo apt-get install -y --no-install-recommends $package"
        root=(sudo -n)
    fi
    echo "benchmarks: installing the system package $package"
    "${root[@]}" apt-get update -qq
    "${root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -y -qq --no-install-recommends "$package" > /dev/null
    has_ode || fail "there is no <ode/ode.h>, although apt-get did install $package"
}

case "${1-}" in
    pooltool) bring_pooltool ;;
    "")
        bring_rapier
        bring_ode
        ;;
    *) fail "got '$1'; expected nothing or pooltool" ;;
esac
