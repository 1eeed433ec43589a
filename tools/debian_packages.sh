# Sourced by scripts that need Debian's packages; `caller` is the word that their lines begin with.

fail() {
    printf "$caller: %s\n" "$@" >&2
    exit 1
}

bring() { # installs packages where it may; else says how to
    if ! command -v apt-get > /dev/null; then
        fail "this machine lacks what Debian calls: $*" \
            "Install it with the machine's own package manager and try again."
    fi
    local root=()
    if [ "$(id -u)" -ne 0 ]; then
        sudo -n true 2> /dev/null || fail "this machine lacks $*. Bring it and try again:" \
            "  sudo apt-get update && sudo apt-get install -y --no-install-recommends $*"
        root=(sudo -n)
    fi
    echo "$caller: installing system packages: $*"
    "${root[@]}" apt-get update -qq
    "${root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -y -qq --no-install-recommends "$@" > /dev/null
}
