"""Where members run: on this machine by cores and memory, or on a Dask cluster."""

import os

import pytest
from support.members import SCENE, SPEEDS, runs, states

from taichi_ldem.cli import main
from taichi_ldem.ensemble.conduct import Conductor
from taichi_ldem.ensemble.pools import local_workers
from taichi_ldem.errors import SceneError


def test_workers_by_cores_and_memory(plan, monkeypatch):
    from taichi_ldem.ensemble import pools

    scenes = [member.scene for member in plan.members]
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    monkeypatch.setattr(pools, "needed_bytes", lambda _: 10)
    monkeypatch.setattr(pools, "available_bytes", lambda: 1000)
    assert local_workers(None, 1, scenes) == 3  # no more than members
    assert local_workers(None, 4, scenes) == 2
    assert local_workers(None, 16, scenes) == 1
    monkeypatch.setattr(pools, "available_bytes", lambda: 25)
    assert local_workers(None, 1, scenes) == 2
    with pytest.raises(SceneError, match=r"--local 3: .* take at most 2"):
        local_workers(3, 1, scenes)


def test_members_on_a_dask_cluster(conduct, plan, fake):
    distributed = pytest.importorskip("distributed")
    from taichi_ldem.ensemble.pools import DaskPool

    options = {"processes": False, "n_workers": 1, "threads_per_worker": 2}
    with distributed.LocalCluster(**options, dashboard_address=None) as cluster:
        pool = DaskPool(cluster.scheduler_address, conduct.folder)
        asked = fake(velocity2=["fail"])
        conductor = Conductor(plan, conduct.folder, pool, asked)
        assert "1 workers with 2 places" in pool.describe()
        assert conductor.run() == 0
        pool.close()
    assert states(conduct.folder, "velocity2") == ["failed", "finished"]
    assert runs(conduct.folder, "velocity3") == ["begin"]


def test_no_scheduler_there(tmp_path, capsys):
    pytest.importorskip("distributed")
    words = ["ensemble", str(SCENE), "--vary", SPEEDS, "--out", str(tmp_path / "out")]
    assert main([*words, "--scheduler", "nonsense://x"]) == 2
    assert "--scheduler nonsense://x: " in capsys.readouterr().err
