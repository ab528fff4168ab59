"""Where members run: on this machine by cores and memory, or on a Dask cluster."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.members import SCENE, SPEEDS, runs, states
from support.paths import ROOT

from taichi_ldem.cli import main
from taichi_ldem.ensemble.conduct import Conductor
from taichi_ldem.ensemble.pools import DaskPool, local_workers
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


@pytest.mark.parametrize(
    ("address", "warned"),
    [
        ("tcp://127.0.0.1:8786", False),
        ("tcp://localhost:8786", False),
        ("tcp://[::1]:8786", False),
        ("inproc://10.0.0.1/1/1", False),
        ("tls://10.0.0.1:8786", False),
        ("tcp://10.0.0.1:8786", True),
        ("tcp://127.example.org:8786", True),
        ("tcp://localhost.example.org:8786", True),
    ],
)
def test_a_scheduler_that_others_reach_without_tls_is_named(address: str, warned: bool) -> None:
    pool = object.__new__(DaskPool)
    pool._address = address
    pool._client = SimpleNamespace(nthreads=lambda: {"w": 2}, scheduler_info=lambda: {})
    assert ("whoever can reach it can run any code there" in pool.describe()) == warned


@pytest.mark.slow
def test_the_scheduler_with_tls_of_the_documentation(tmp_path, monkeypatch):
    """Slow: a scheduler and a worker in processes of their own."""
    pytest.importorskip("distributed")
    if shutil.which("openssl") is None:
        pytest.skip("no openssl")
    text = (ROOT / "docs/ensembles.md").read_text(encoding="utf-8")
    made = text[text.index("    umask 077") : text.index("Set this on the machine")]
    shown = text[text.index("    export DASK_") : text.index("Then the addresses begin")]
    script = f"""
export HOME={tmp_path} PATH={Path(sys.executable).parent}:$PATH
{made}
{shown}
cd {tmp_path}
where="--host 127.0.0.1 --no-dashboard"
dask scheduler --protocol tls $where --port 0 --scheduler-file contact.json &
while [ ! -s contact.json ]; do sleep 0.1; done
dask worker --scheduler-file contact.json $where --nthreads 1 --no-nanny &
trap 'kill $(jobs -p)' TERM
echo ready
wait
"""
    log = (tmp_path / "log").open("wb")
    cluster = subprocess.Popen(["bash", "-c", script], stdout=subprocess.PIPE, stderr=log)
    try:
        assert cluster.stdout is not None
        assert cluster.stdout.readline().strip() == b"ready"
        address = json.loads((tmp_path / "contact.json").read_text())["address"]
        assert address.startswith("tls://127.0.0.1:")
        code = """
import os, sys
from pathlib import Path
from taichi_ldem.ensemble.pools import DaskPool
from taichi_ldem.errors import SceneError
try:
    pool = DaskPool(sys.argv[1], Path("."))
    pool._client.wait_for_workers(1, timeout=30)
    print(pool.describe())
except SceneError as error:
    print("refused:", error)
sys.stdout.flush()
os._exit(0)
"""
        environment = "\n".join(line.strip() for line in shown.splitlines())
        run = f"export HOME={tmp_path}\n{environment}\nexec {sys.executable} -c '{code}' {address}"
        told = subprocess.run(["bash", "-c", run], capture_output=True, text=True, cwd=ROOT)
        assert f"1 workers with 1 places at {address}" in told.stdout, told.stderr
        for other in (address, address.replace("tls", "tcp")):
            words = [sys.executable, "-c", code, other]
            told = subprocess.run(words, capture_output=True, text=True, cwd=ROOT)
            assert told.stdout.startswith(f"refused: --scheduler {other}: "), told.stderr
    finally:
        cluster.terminate()
        cluster.wait(30)
        log.close()
