#!/usr/bin/env bash
# Make a virtual environment: `make_venv.sh DIRECTORY`. PYTHON names the Python to take; without it, the first of
# python3.11 and python3 that is new enough.
set -euo pipefail

directory=$1

fail() {
    echo "make install: $1" >&2
    exit 1
}

is_new_enough() {
    "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null
}

find_python() {
    local candidate
    for candidate in ${PYTHON:-python3.11 python3}; do
        if is_new_enough "$candidate"; then
            echo "$candidate"
            return
        fi
    done
    fail "found no Python of version 3.11 or newer; install python3.11, or say where one is: make install PYTHON=/path/to/python3"
}

# Debian keeps the part of Python that makes environments in a package of its own, named after the exact version.
install_venv_module() {
    local package sudo=()
    package=$("$1" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')
    [ "$(id -u)" = 0 ] || sudo=(sudo -n)
    if ! command -v apt-get >/dev/null || ! "${sudo[@]}" true 2>/dev/null; then
        fail "$1 cannot make environments yet; type: sudo apt-get install $package"
    fi
    "${sudo[@]}" apt-get update -q && "${sudo[@]}" apt-get install -q -y "$package" ||
        fail "could not install $package; type: sudo apt-get install $package"
}

python=$(find_python)
"$python" -c 'import ensurepip, venv' 2>/dev/null || install_venv_module "$python"
rm -rf "$directory" # perhaps half made
"$python" -m venv "$directory"
