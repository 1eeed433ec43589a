#!/usr/bin/env bash
# Brings ODE, the engine that the benchmarks compare with; nothing else needs it.
set -euo pipefail
package=libode-dev

installed() { printf '#include <ode/ode.h>\n' | g++ -E -x c++ - > /dev/null 2>&1; }

fail() {
    printf 'benchmarks: %s\n' "$@" >&2
    exit 1
}

if installed; then exit 0; fi
if ! command -v apt-get > /dev/null; then
    fail "this machine lacks ODE, which Debian calls $package." \
        "Install it, in double precision, with the machine's own package manager and try again."
fi
root=()
if [ "$(id -u)" -ne 0 ]; then
    sudo -n true 2> /dev/null || fail "this machine lacks $package. Bring it and try again:" \
        "  sudo apt-get update && sudo apt-get install -y --no-install-recommends $package"
    root=(sudo -n)
fi
echo "benchmarks: installing the system package $package"
"${root[@]}" apt-get update -qq
"${root[@]}" env DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -qq --no-install-recommends "$package" > /dev/null
installed || fail "there is no <ode/ode.h>, although apt-get did install $package"
