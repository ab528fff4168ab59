"""What is told and tidied before Taichi starts; no kernel runs."""

import os
import time
from pathlib import Path

import pytest
from support.blocks import DAMAGE, block_scene

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Solver
from taichi_ldem.solver import backend


def test_a_lock_that_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    old, new, other = (tmp_path / name / "ticache.lock" for name in ("old", "new", "other"))
    other = other.with_name("other.lock")
    for lock in (old, new, other):
        lock.parent.mkdir()
        lock.touch()
    before = time.time() - 2 * backend.STALE
    os.utime(old, (before, before))
    os.utime(other, (before, before))
    backend._free_cache(tmp_path)
    assert [lock.exists() for lock in (old, new, other)] == [False, True, True]


@pytest.mark.parametrize(
    ("devices", "word"), [([], "no Vulkan device"), ([False], "this device has no f64")]
)
def test_vulkan_without_what_it_takes_is_refused(
    monkeypatch: pytest.MonkeyPatch, devices: list[bool], word: str
) -> None:
    monkeypatch.setattr(backend, "_vulkan_devices", lambda: devices)
    with pytest.raises(SceneError, match=word) as error:
        backend.start(Solver(duration=1.0, arch="vulkan"))
    assert "\n" not in str(error.value)


def test_metal_is_refused() -> None:
    with pytest.raises(SceneError, match="has no f64, which contact sums need"):
        backend.start(Solver(duration=1.0, arch="metal", precision="f32"))


def test_vulkan_has_no_exponential_law_in_f64() -> None:
    law = DAMAGE | {"law": "exponential"}
    with pytest.raises(SceneError, match="has no exp in f64"):
        block_scene(4, 4, 1, material=law, solver={"arch": "vulkan"})
    block_scene(4, 4, 1, material=law, solver={"arch": "vulkan", "precision": "f32"})
