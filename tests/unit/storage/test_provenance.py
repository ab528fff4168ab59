"""What identifies a scene and a run."""

import os
import re
import sys
from pathlib import Path

import pytest
from support.scenes import GOOD

from taichi_ldem.scene import parse_scene_text
from taichi_ldem.storage import provenance as pv
from taichi_ldem.storage.durable import created
from taichi_ldem.storage.folder import RunFolder

SCENE = parse_scene_text(GOOD, "x")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("mass = 18.49", "mass = 18.490"),
        ("duration = 0.010", "duration = 1e-2\nthreads = 1"),
        ("duration = 0.010", "duration = 1e-2\n[output]\ncheckpoint_interval = 0"),
        ("duration = 0.010", "duration = 1e-2\nsafety = 0.9"),  # a default, spelt out
        ("mass = 18.49", "position = [-0.0, 0]\nmass = 18.49"),
        (
            "[striker]\ndiameter = 0.0127\nmass = 18.49",
            "[striker]\nmass = 18.49\ndiameter = 127e-4",
        ),
    ],
)
def test_the_hash_is_that_of_the_physics(old: str, new: str) -> None:
    assert old in GOOD
    assert pv.scene_hash(parse_scene_text(GOOD.replace(old, new), "x")) == pv.scene_hash(SCENE)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("mass = 18.49", "mass = 18.490000000000002"),  # the next double
        ("duration = 0.010", 'duration = 0.010\nprecision = "f32"'),
        ('kind = "rings"', 'kind = "bonded"'),
    ],
)
def test_whatever_changes_results_changes_the_hash(old: str, new: str) -> None:
    assert pv.scene_hash(parse_scene_text(GOOD.replace(old, new), "x")) != pv.scene_hash(SCENE)


def test_a_run_can_be_traced() -> None:
    record = pv.provenance(SCENE)
    assert re.fullmatch("[0-9a-f]{64}", record["scene_sha256"])
    assert record["packages"]["taichi"].startswith("1.")
    assert record["git"] is None or re.fullmatch(r"[0-9a-f]{40}(\+changes)?", record["git"])
    assert all(record[key] for key in ("version", "python", "platform", "cpu", "command"))


def test_what_bits_depend_on_is_compared() -> None:
    now = {"cpu": "one", "packages": {"taichi": "1.7.4", "numpy": "2.0"}}
    assert pv.changed_machine(now | {"packages": {"taichi": "1.7.4", "numpy": "1.9"}}, now) is None
    other = {"cpu": "two", "packages": {"taichi": "1.7.3"}}
    assert pv.changed_machine(other, now) == "CPU two, now one; taichi 1.7.3, now 1.7.4"
    assert pv.changed_machine(None, now) is None
    assert pv.changed_machine({"cpu": "one", "packages": 3}, now) == "taichi unknown, now 1.7.4"


def test_a_path_that_is_no_text_can_be_recorded(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It gave a traceback after the set-up, and a folder that needed --force."""
    run = tmp_path / os.fsdecode(b"caf\xe9")
    monkeypatch.setattr(sys, "argv", ["ldem", "impact", "--out", str(run)])
    with RunFolder.held(run):
        folder = RunFolder.create(run, force=False)
        folder.write_provenance(pv.provenance(SCENE))
        with created(folder.fields_file) as file:
            file.attrs["command"] = pv.provenance(SCENE)["command"]
    assert RunFolder(run).processes()[0]["command"].endswith("caf\\udce9'")
