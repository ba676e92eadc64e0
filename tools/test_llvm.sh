#!/usr/bin/env bash
# The tests that depend on LLVM, in the states of `with_llvm.sh`: `test_llvm.sh PYTHON [all]`. All of them run where the
# library that is found does not serve, for there a command could end by a signal; of the states none and broken, whose
# commands go the ways of 15 and of `make test`, the choice of the library alone; with `all`, all tests in all states. A
# state that this machine cannot be brought into is named at the end, and fails where the environment says CI.
set -euo pipefail
cd "$(dirname "$0")/.."

python=$1 extent=${2:-} missing=
choice=(tests/renderer/backends tests/fitter/selftest/test_machine.py)
export OMP_NUM_THREADS=1
bash tools/install_libraries.sh for-tests "$python"
states=(15 none broken)
[ "$extent" != all ] || states=(none 15 19 broken)
for state in "${states[@]}"; do
    echo "LLVM: $state"
    tests=()
    [ "$extent" = all ] || [ "$state" = 15 ] || tests=("${choice[@]}")
    code=0
    bash tools/with_llvm.sh "$state" "$python" -m pytest -q -n 2 --dist worksteal -m dr_jit "${tests[@]}" || code=$?
    case $code in
    0) ;;
    77) missing="$missing $state" ;;
    *) exit "$code" ;;
    esac
done
if [ -n "$missing" ]; then
    echo "not tested: the states$missing of LLVM, into which this machine cannot be brought" >&2
    [ -z "${CI:-}" ]
fi
