#!/bin/bash
# A job of Slurm that goes on where it was: sbatch examples/slurm.sh SCENE.toml RUN_FOLDER
#SBATCH --job-name=ldem
#SBATCH --cpus-per-task=8
#SBATCH --time=01:00:00
#SBATCH --requeue
#SBATCH --open-mode=append
# USR1 comes 120 s before the time is over. B: it comes to this script only, which passes it on.
#SBATCH --signal=B:USR1@120

scene=${1:?usage: sbatch slurm.sh SCENE.toml RUN_FOLDER}
out=${2:?usage: sbatch slurm.sh SCENE.toml RUN_FOLDER}

again=no interrupted=no
stop() { # the run takes a checkpoint and ends with code 143
    interrupted=yes
    kill -TERM "$run" 2>/dev/null
}
trap 'again=yes; stop' USR1 # the time is over: the job goes back into the queue
trap stop TERM              # scancel, or the queue needs the nodes and decides itself

# --resume starts the run, or goes on with it where it has been begun.
ldem impact "$scene" --out "$out" --resume --quiet --threads "${SLURM_CPUS_PER_TASK:-1}" &
run=$!

# A signal ends `wait` before the run has ended: wait again until the checkpoint is written.
code=0
while :; do
    interrupted=no
    wait "$run"
    ended=$?
    [ "$ended" -ne 127 ] && code=$ended # 127: the code has been read already
    [ "$interrupted" = no ] && break
done

if [ "$again" = yes ] && [ "$code" -eq 143 ]; then
    scontrol requeue "$SLURM_JOB_ID"
fi
exit "$code"
