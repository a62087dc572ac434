#!/usr/bin/env bash
# Does one shard of an experiment, and goes on with it where it was killed:
#     cluster/shard.sh K/N CONFIG [ARGUMENT OF experiment]...
# What ends with an error is not tried again. XTASK names the program.
set -euo pipefail
shard=$1
shift

for _ in 1 2 3; do
  status=0
  "${XTASK:-target/release/xtask}" experiment "$@" --shard "$shard" || status=$?
  # 128 and the number of the signal that ended it.
  if [ "$status" -le 128 ]; then
    exit "$status"
  fi
  echo "shard $shard was killed (status $status)" >&2
done
exit "$status"
