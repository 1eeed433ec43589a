#!/usr/bin/env bash
# Brings the engines that the benchmarks compare with; nothing else needs them.
#
#   tools/bench_packages.sh             ODE, without which it fails, and Rapier
#   tools/bench_packages.sh emcee       the sampler of bench-learning
#   tools/bench_packages.sh pooltool    pooltool, 800 MB, in build/benchmarks/pooltool
set -euo pipefail
cd "$(dirname "$0")/.."
caller=benchmarks
# shellcheck source=tools/debian_packages.sh
source tools/debian_packages.sh
environment=build/benchmarks/pooltool

has_ode() { printf '#include <ode/ode.h>\n' | g++ -E -x c++ - > /dev/null 2>&1; }

# Its requirements are not those of .venv.
bring_pooltool() {
    .venv/bin/python -m venv "$environment"
    "$environment/bin/pip" --disable-pip-version-check install -q pooltool-billiards
}

bring_wheel() { # of PyPI; the benchmarks can do without
    if .venv/bin/python -c "import $1" 2> /dev/null; then return; fi
    echo "benchmarks: installing the Python package $1"
    .venv/bin/python -m pip --disable-pip-version-check install -q \
        -c requirements/constraints.txt "$1" || echo "benchmarks: goes on without $1"
}

bring_ode() {
    if has_ode; then return; fi
    bring libode-dev
    has_ode || fail "there is no <ode/ode.h>, although apt-get did install libode-dev"
}

case "${1-}" in
    emcee) bring_wheel emcee ;;
    pooltool) bring_pooltool ;;
    "")
        bring_wheel rapier3d
        bring_ode
        ;;
    *) fail "got '$1'; expected nothing, emcee or pooltool" ;;
esac
