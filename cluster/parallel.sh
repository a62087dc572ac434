#!/usr/bin/env bash
# Runs an experiment in N shards with GNU parallel, and merges them:
#     cluster/parallel.sh CONFIG N [ARGUMENT OF experiment]...
# On this machine JOBS at a time (2), each with its share of the processors; on others with a file
# system that all see by PARALLEL='--sshloginfile HOSTS --workdir .'. XTASK names the program.
set -euo pipefail
if [ $# -lt 2 ]; then
  echo "usage: cluster/parallel.sh CONFIG N [ARGUMENT OF experiment]..." >&2
  exit 1
fi
config=$1 shards=$2
shift 2

jobs=${JOBS:-2}
threads=$((($(nproc) + jobs - 1) / jobs))
export RAYON_NUM_THREADS=${RAYON_NUM_THREADS:-$threads} XTASK=${XTASK:-target/release/xtask}
arguments=$(printf ' %q' "$config" "$@")

seq "$shards" | parallel --env RAYON_NUM_THREADS --env XTASK --jobs "$jobs" --halt soon,fail=1 \
  --line-buffer "cluster/shard.sh {}/$shards$arguments"
exec "$XTASK" experiment "$config" "$@" --merge
