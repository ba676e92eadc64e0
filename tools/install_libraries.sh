#!/usr/bin/env bash
# See that Python can draw without a display: `install_libraries.sh PYTHON`. Where it cannot, the OpenGL libraries are
# installed if that is allowed; if not, the line to type is told and everything else goes on: only `fit-material view`
# needs them, and the tests that draw say that they skip.
set -euo pipefail

python=$1
packages="libegl1 libgl1 libgl1-mesa-dri"

can_draw() {
    "$python" -c 'from renderer.viewer.context import offscreen_context; offscreen_context()' >/dev/null 2>&1
}

tell() {
    echo "make install: $1; fit-material view needs it, type: sudo apt-get install $packages" >&2
}

install() {
    local sudo=()
    [ "$(id -u)" = 0 ] || sudo=(sudo -n)
    command -v apt-get >/dev/null && "${sudo[@]}" true 2>/dev/null || return 1
    # shellcheck disable=SC2086 — several words
    "${sudo[@]}" apt-get update -q && "${sudo[@]}" apt-get install -q -y --no-install-recommends $packages
}

can_draw && exit
install || { tell "OpenGL without a display is not installed"; exit 0; }
can_draw || tell "there is still no OpenGL 4.3 without a display"
