"""Members as jobs of SLURM, through dask-jobqueue: a scheduler here, and a worker in each job.

The scheduler and its workers speak TLS with a key that is made for the ensemble and lies in its
folder, which only its owner may enter, until the command has ended. Partition, account, time limit
and further options are those of dask-jobqueue's configuration (``jobqueue.slurm``).
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from taichi_ldem.ensemble.pools import DaskPool
from taichi_ldem.errors import SceneError

KEYS = "slurm"
"""Folder of the key, of scripts and of what the jobs print, in the ensemble's."""

WORKER, SPARE = 0.5e9, 1.2
"""Bytes of a Dask worker, which shares a job's memory with its member, and what a job asks for over
the estimate of a member."""


class SlurmPool(DaskPool):
    """A number of SLURM jobs, each of which runs one member at a time.

    A job that ends before the ensemble, at its time limit for example, is replaced by another.
    """

    def __init__(self, jobs: int, ensemble: Path, threads: int, memory: int) -> None:
        """Queue the jobs.

        Args:
            jobs: their number.
            ensemble: the ensemble's folder, on a file system that the jobs see.
            threads: CPU threads of a member. memory: that it needs, bytes.

        Raises:
            SceneError: dask-jobqueue or ``sbatch`` is missing, or its configuration is wrong.
        """
        try:
            import dask_jobqueue
            import distributed
        except ImportError:
            raise SceneError(
                "--slurm needs dask-jobqueue: pip install 'taichi-ldem[cluster]'"
            ) from None
        if shutil.which("sbatch") is None:
            raise SceneError("--slurm: there is no 'sbatch' here; run it where jobs are submitted")
        self._keys, self._jobs = ensemble / KEYS, jobs
        self._keys.mkdir(mode=0o700, exist_ok=True)
        self._keys.chmod(0o700)  # of an earlier command, or a copy
        jobqueue: Any = dask_jobqueue
        dask: Any = distributed
        security = dask.Security.temporary()
        try:
            self._cluster = jobqueue.SLURMCluster(
                cores=threads,
                processes=1,
                memory=f"{int(SPARE * memory + WORKER)}B",
                nanny=False,
                worker_extra_args=["--nthreads", "1"],
                job_name="ldem",
                log_directory=str(self._keys),
                shared_temp_directory=str(self._keys),
                security=security,
                scheduler_options={"dashboard": False, "dashboard_address": None},
            )
        except (ValueError, TypeError, OSError, RuntimeError) as error:
            raise SceneError(f"--slurm {jobs}: {' '.join(str(error).split())}") from None
        try:
            self._cluster.adapt(minimum_jobs=jobs, maximum_jobs=jobs)
            super().__init__(self._cluster.scheduler_address, ensemble, security)
        except BaseException:
            self._cluster.close()
            raise

    def describe(self) -> str:  # noqa: D102
        return f"{self._jobs} SLURM jobs, one member at a time in each; their output is in {KEYS}/"

    def close(self) -> None:  # noqa: D102
        try:
            super().close()
        finally:
            self._cluster.close()
