#!/usr/bin/env bash
# Runs an experiment as a Slurm job array of N shards, with a job that merges them when all have ended:
#     cluster/slurm.sh CONFIG N [ARGUMENT OF experiment]...
# In the root of the repository, on a file system that all nodes see. CPUS are asked for each shard; what
# else a job may take is said by sbatch's own variables, such as SBATCH_PARTITION, SBATCH_TIMELIMIT,
# SBATCH_MEM_PER_NODE and SBATCH_OUTPUT. XTASK names the program.
set -euo pipefail
if [ $# -lt 2 ]; then
  echo "usage: cluster/slurm.sh CONFIG N [ARGUMENT OF experiment]..." >&2
  exit 1
fi
config=$1 shards=$2
shift 2

xtask=$(realpath "${XTASK:-target/release/xtask}")
shard=$(realpath "$(dirname "$0")/shard.sh")
arguments=$(printf ' %q' "$config" "$@")
# As many threads as processors were asked for; 0 is as many as there are.
environment="XTASK=$(printf %q "$xtask") RAYON_NUM_THREADS=${CPUS:-0}"
# Jobs on nodes that fail begin again, and go on where they were.
submit=(sbatch --parsable --requeue ${CPUS:+--cpus-per-task "$CPUS"})

array=$("${submit[@]}" --job-name shard --array "1-$shards" --wrap \
  "$environment exec $(printf %q "$shard") \$SLURM_ARRAY_TASK_ID/$shards$arguments")
merge=$("${submit[@]}" --job-name merge --dependency "afterok:$array" --kill-on-invalid-dep yes --wrap \
  "$environment exec $(printf %q "$xtask") experiment$arguments --merge")
echo "shards: job $array; merge: job $merge"
