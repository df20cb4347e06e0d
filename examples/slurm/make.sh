#!/usr/bin/env bash
# Makes a data set by an array of SLURM jobs, each with a share of the images.
#
#   sbatch --array=0-15 examples/slurm/make.sh /shared/dice 100000
#
# Submit it again to go on where it ended. To run some of the jobs only, give the number of all:
#
#   TASKS=16 sbatch --array=3,7 examples/slurm/make.sh /shared/dice 100000
#
#SBATCH --job-name=heliograph
#SBATCH --cpus-per-task=8
#SBATCH --time=08:00:00
#SBATCH --requeue
#SBATCH --output=%x-%A_%a.log
set -euo pipefail
cd "${SLURM_SUBMIT_DIR:-.}"  # SLURM runs a copy of this file
exec "${PYTHON:-.venv/bin/python}" examples/slurm/make.py "$@" \
  --task "$SLURM_ARRAY_TASK_ID" --tasks "${TASKS:-$SLURM_ARRAY_TASK_COUNT}" \
  --threads "${SLURM_CPUS_PER_TASK:-1}"
