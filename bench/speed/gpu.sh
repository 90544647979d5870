#!/bin/sh
# A first hour on a GPU in one call: the check of the kernels, their tests, their speed and memory beside gsplat
# (where it is installed), what they need of other GPUs, and two scenes trained whole on it and on the processor.
#
#     RIG_DATA=FOLDER bench/speed/gpu.sh [--quick]
#
# Tables go to bench/results; what fails is named at the end, and the rest is measured all the same.
set -u
cd "$(dirname "$0")/../.." || exit 1
python=${PYTHON:-python3}
failed=""
"$python" -m bench.speed.gpu --present || exit 1
for part in gpu gpu_kernels gpu_scenes; do
  "$python" -m "bench.speed.$part" --write "$@" || failed="$failed bench.speed.$part"
done
"$python" -m rig doctor || failed="$failed rig-doctor"
[ -z "$failed" ] || { echo "Failed:$failed." >&2; exit 1; }
