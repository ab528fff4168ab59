"""The processor's name and the free memory, from what the system lists."""

import subprocess
import sys
from pathlib import Path

import pytest

from taichi_ldem import machine


def test_a_processor_is_named_with_family_and_model() -> None:
    properties = {"model name": "A Xeon", "cpu family": "6", "model": "85"}
    assert machine.processor_name(properties) == "A Xeon (family 6, model 85)"
    assert machine.processor_name({"model name": "Neoverse"}) == "Neoverse"
    assert machine.processor_name({})
    assert machine.processor_name()


def test_a_container_s_limit_counts(tmp_path: Path) -> None:
    assert machine._free_of_group(tmp_path) is None
    for name, text in (
        ("memory.max", "1000000\n"),
        ("memory.current", "900000\n"),
        ("memory.stat", "anon 1\ninactive_file 50000\n"),
    ):
        (tmp_path / name).write_text(text)
    assert machine._free_of_group(tmp_path) == 150_000
    (tmp_path / "memory.max").write_text("max\n")
    assert machine._free_of_group(tmp_path) is None


@pytest.mark.skipif(sys.platform != "linux", reason="/proc")
def test_this_machine_has_memory() -> None:
    available = machine.available_bytes()
    assert available is not None
    assert 1 << 20 < available < 1 << 50


def test_memory_is_unknown_where_python_has_no_resource_module(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "resource", None)  # as on Windows: importing it fails
    assert machine.peak_bytes() is None
    assert machine.addresses_left() is None


def test_modes_can_be_imported_without_the_resource_module() -> None:
    code = "import sys; sys.modules['resource'] = None; import taichi_ldem.scenarios.modes"
    subprocess.run([sys.executable, "-c", code], check=True)
