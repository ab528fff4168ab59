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


def test_taichi_gets_a_home_and_nothing_that_overrules_the_scene(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without HOME, and with TI_ARCH = nonsense, Taichi ends the process (exit code 134)."""
    monkeypatch.delenv("HOME")
    monkeypatch.setenv("TI_ARCH", "nonsense")
    with backend._environment():
        assert Path(os.environ["HOME"]).is_dir()
        assert "TI_ARCH" not in os.environ
    assert "HOME" not in os.environ
    assert os.environ["TI_ARCH"] == "nonsense"


def test_a_user_without_a_home_gets_a_folder_for_temporary_files(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def nameless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", nameless)
    assert Path(backend._home()).is_dir()


def test_a_home_that_cannot_be_written_leaves_a_cache_that_can(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """With a cache that it cannot write, Taichi ends with a fault when all has been done."""
    monkeypatch.setattr(backend.tempfile, "gettempdir", lambda: str(tmp_path))
    (tmp_path / "file").touch()
    wanted = tmp_path / "file" / "ticache"
    cache = backend._cache_folder(wanted)
    assert cache.parent == tmp_path
    assert cache.stat().st_mode & 0o077 == 0
    assert backend._cache_folder(tmp_path / "new" / "ticache").is_dir()
    monkeypatch.setattr(backend, "_writable", lambda folder: False)
    with pytest.raises(SceneError, match="set TI_OFFLINE_CACHE_FILE_PATH"):
        backend._cache_folder(wanted)


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


def test_what_vulkan_cannot_compile_is_said_in_a_line() -> None:
    with (
        pytest.raises(SceneError, match=r'cannot compile this scene.*use "cpu".*does not yet'),
        backend.compiling(),
    ):
        raise RuntimeError('\n[spirv_ir_builder.cpp:query_value@1316] "tmp1" does not yet exist.\n')
    with pytest.raises(RuntimeError, match="another"), backend.compiling():
        raise RuntimeError("another error")


def test_vulkan_has_no_rule_for_crack_tips() -> None:
    """Taichi's SPIR-V builder fails: a value does not yet exist."""
    crack = DAMAGE | {"fracture": "crack"}
    with pytest.raises(SceneError, match=r'material.fracture.*must be "bar" on Vulkan'):
        block_scene(4, 4, 1, material=crack, solver={"arch": "vulkan"})
