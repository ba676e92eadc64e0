#!/usr/bin/env bash
# Run a command on a machine that has this LLVM alone: `with_llvm.sh STATE COMMAND…`. Nothing is uninstalled: libraries are
# hidden in a mount namespace of the command's own, which takes root; without, exit code 77 says that it was not run.
#
#   none      no LLVM library
#   19, 15 …  only the library of that version; exit code 77 where it is not installed
#   broken    all libraries, and DRJIT_LIBLLVM_PATH names a file that is none
set -euo pipefail

state=$1
shift
unset DRJIT_LIBLLVM_PATH FIT_MATERIAL_LLVM
if [ "$state" = broken ]; then
    export DRJIT_LIBLLVM_PATH=$PWD/pyproject.toml
    exec "$@"
fi

skip() {
    echo "with_llvm.sh: $1" >&2
    exit 77
}

mapfile -t libraries < <(find -L /usr/lib /usr/lib64 /usr/local/lib -maxdepth 3 -name 'libLLVM*' -type f -exec realpath {} + 2>/dev/null | sort -u)
kept=() hidden=()
for library in "${libraries[@]}"; do
    case $(basename "$library") in
    libLLVM-"$state".* | libLLVM.so."$state".* | libLLVM-"$state".so* | libLLVM.so."$state") kept+=("$library") ;;
    *) hidden+=("$library") ;;
    esac
done
[ "$state" = none ] || [ ${#kept[@]} -gt 0 ] || skip "LLVM $state is not installed"
unshare --mount true 2>/dev/null || skip "this user may not hide libraries"
# a device is no library: whoever looks for one passes it by
# shellcheck disable=SC2016
exec unshare --mount bash -c '
    count=$1; shift
    for library in "${@:1:count}"; do mount --bind /dev/null "$library"; done
    shift "$count"
    exec "$@"' with_llvm "${#hidden[@]}" "${hidden[@]}" "$@"
