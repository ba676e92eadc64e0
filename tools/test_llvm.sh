#!/usr/bin/env bash
# The tests that depend on LLVM, in each state of `with_llvm.sh`: `test_llvm.sh PYTHON`. A state that this machine cannot
# be brought into is named at the end, and fails where the environment says CI.
set -euo pipefail
cd "$(dirname "$0")/.."

python=$1 missing=
export OMP_NUM_THREADS=1
bash tools/install_libraries.sh for-tests "$python"
for state in none 15 19 broken; do
    echo "LLVM: $state"
    code=0
    bash tools/with_llvm.sh "$state" "$python" -m pytest -q -n 2 --dist worksteal -m dr_jit || code=$?
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
