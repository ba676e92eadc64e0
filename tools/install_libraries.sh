#!/usr/bin/env bash
# Bring the system's libraries that Python packages do not: `install_libraries.sh needed PYTHON` before the packages are
# installed, `install_libraries.sh useful PYTHON` after. What is missing is installed where that is allowed; if not, the
# line to type is printed. Without what is needed nothing works, and this fails; without what is useful the rest goes on.
#
#   needed   libatomic1, against which Dr.Jit is linked
#   useful   LLVM, by which Dr.Jit compiles, several times faster; OpenGL without a display, for `fit-material view`
#   for-tests   LLVM 15, which does not compile our kernels: what happens where it is the only one is tested
set -euo pipefail

kind=$1 python=$2
opengl="libegl1 libgl1 libgl1-mesa-dri"
llvm="libllvm19 libllvm22 libllvm21 libllvm20" # the first that this system has; older ones do not compile our kernels

has_atomic() {
    "$python" -c 'import ctypes; ctypes.CDLL("libatomic.so.1")' >/dev/null 2>&1
}

has_llvm() {
    env -u FIT_MATERIAL_LLVM -u DRJIT_LIBLLVM_PATH \
        "$python" -c '
import sys
from fit_material.renderer.backends import llvm
sys.exit(llvm.choose(None, llvm.candidates()).chosen is None)' \
        >/dev/null 2>&1
}

has_llvm_15() {
    compgen -G '/usr/lib/*/libLLVM-15.so*' >/dev/null
}

can_draw() {
    "$python" -c 'from fit_material.renderer.opengl.context import offscreen_context; offscreen_context()' >/dev/null 2>&1
}

as_root() {
    if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n "$@"; fi
}

may_install() {
    command -v apt-get >/dev/null && as_root true 2>/dev/null
}

update() {
    [ -n "${updated:-}" ] || as_root apt-get update -q || true
    updated=1
}

# The first of the packages that this system knows; the very first where it knows none.
known() {
    for package in "$@"; do
        if apt-cache show "$package" >/dev/null 2>&1; then
            echo "$package"
            return
        fi
    done
    echo "$1"
}

# bring CHECK "PACKAGES" WHAT: fails where the check fails in the end.
bring() {
    "$1" && return
    # shellcheck disable=SC2086 — several words
    may_install && as_root apt-get install -q -y --no-install-recommends $2 || true
    "$1" && return
    echo "make install: $3; type: sudo apt-get install $2" >&2
    return 1
}

if [ "$kind" = needed ]; then
    [ "$(uname)" = Linux ] || exit 0
    has_atomic && exit
    may_install && update
    bring has_atomic libatomic1 "libatomic.so.1 is missing, without which nothing works"
elif [ "$kind" = for-tests ]; then
    has_llvm_15 && exit
    may_install && update
    bring has_llvm_15 libllvm15 "LLVM 15 is not installed; the tests on it are left out" || true
else
    has_llvm && can_draw && exit
    may_install && update
    # shellcheck disable=SC2086
    bring has_llvm "$(known $llvm)" "no LLVM that serves is installed; all works without, but several times slower" || true
    bring can_draw "$opengl" "OpenGL 4.3 without a display is not installed; fit-material view needs it" || true
fi
