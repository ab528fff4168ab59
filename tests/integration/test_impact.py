"""The impact scenario from the command line: what a user types, and what is in the folder then."""

import json
import signal
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest
from support.command import COMMAND, SCENE, cut_off, ldem

from taichi_ldem.analysis.fragments import labels_of, of_modules
from taichi_ldem.analysis.strain import green_strain, mean_gradient
from taichi_ldem.analysis.stress import as_components, as_matrices
from taichi_ldem.model.cell import CELLS
from taichi_ldem.model.material import bars_of
from taichi_ldem.scenarios import runner
from taichi_ldem.scenarios.measure import measure_run
from taichi_ldem.scenarios.progress import newtons
from taichi_ldem.scene.tables import Quantity
from taichi_ldem.solver.backend import vulkan_device
from taichi_ldem.solver.contact import observables
from taichi_ldem.storage import checkpoint
from taichi_ldem.storage.fields import read_broken_bars, read_fields, read_times
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.fragments import read_fragments


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("scene") / "small.toml"
    file.write_text(SCENE)
    return file


@pytest.fixture(scope="module")
def single(scene: Path) -> RunFolder:
    """The same run in single precision, with all that fields can hold."""
    out = scene.parent / "single"
    more = [f"output.fields={list(get_args(Quantity))}".replace("'", '"'), "output.fragments=true"]
    settings = [word for text in more for word in ("--set", text)]
    done = ldem("impact", str(scene), "--out", str(out), "--precision", "f32", "--quiet", *settings)
    assert done.returncode == 0, done.stderr
    return RunFolder.open(out)


@pytest.fixture(scope="module")
def finished(scene: Path) -> RunFolder:
    done = ldem("impact", str(scene), "--out", str(scene.parent / "run"), "--threads", "1")
    assert done.returncode == 0, done.stderr
    assert "[Taichi]" not in done.stdout  # its banner
    for word in ("K_r", "steps of", "on disk at most", "ETA"):
        assert word in done.stdout
    return RunFolder.open(scene.parent / "run")


def test_run_folder_holds_a_whole_run(finished: RunFolder) -> None:
    history, summary = finished.read_history(), finished.read_summary()
    assert list(history) == [
        "time_s",
        "striker_displacement_m",
        "striker_velocity_m_s",
        "striker_force_n",
        "ring_force_n",
        "kinetic_plate_j",
        "kinetic_striker_j",
        "strain_j",
        "fracture_j",
        "contact_j",
        "energy_error",
        "broken_bars",
    ]
    assert history["time_s"][-1] == pytest.approx(8e-5, abs=1e-12)  # the duration
    assert np.allclose(np.diff(history["time_s"]), 1e-6, rtol=1e-9)  # history_interval
    assert history["broken_bars"][-1] > 0
    assert summary["broken_bars"] == history["broken_bars"][-1]
    assert summary["energy_error"] < 0.05
    # Newton's second law for the striker, from the impulses of the history alone
    impulse = np.cumsum(history["striker_force_n"] * 1e-6)[-1]
    assert 0.01 * (8.0 - summary["striker_velocity_end_m_s"]) == pytest.approx(impulse, rel=1e-2)


def test_cracks_and_work_are_in_the_summary(finished: RunFolder) -> None:
    history, summary = finished.read_history(), finished.read_summary()
    cracks = measure_run(finished)
    assert cracks is not None
    for key, value in cracks.summary().items():
        assert summary[key] == value or summary[key] == pytest.approx(value), key
    assert (finished.path / "cracks.png").stat().st_size > 0
    # the work of the force is what the striker has lost
    lost = history["kinetic_striker_j"][0] - history["kinetic_striker_j"][-1]
    assert summary["total_energy_j"] == pytest.approx(lost, rel=0.01)
    assert 0 < summary["energy_at_peak_load_j"] <= summary["total_energy_j"]
    assert summary["deflection_at_peak_load_m"] <= history["striker_displacement_m"][-1]


def test_fields_agree_with_the_history(finished: RunFolder) -> None:
    history = finished.read_history()
    broken = read_broken_bars(finished.fields_file)
    assert len(broken.bar) == history["broken_bars"][-1]
    assert np.all(np.diff(broken.time_s) >= 0)
    fields = read_fields(finished.fields_file)
    # the striker's tip has pressed the plate down, and no node lies above it
    sunk = -fields.displacement[:, 2].min()
    assert sunk >= 0.9 * history["striker_displacement_m"][-1]
    inside = np.abs(broken.position_m) <= np.array([0.0048, 0.0048, 0.0016]) + 1e-12
    assert inside.all()


def test_pieces_in_the_fields_and_in_the_table_are_those_of_the_broken_bars(
    taichi: None, single: RunFolder
) -> None:
    from taichi_ldem.scenarios.fragment_output import fragments_of

    times, table = read_times(single.fields_file), read_fragments(single.fragments_file)
    np.testing.assert_array_equal(np.unique(table["time_s"]), times)
    for step, at in enumerate(times):
        stored = read_fields(single.fields_file, step, ["fragment"]).quantities["fragment"]
        np.testing.assert_array_equal(stored, fragments_of(single, at))
        now = table["time_s"] == at
        assert set(stored) <= set(table["fragment"][now])
        assert table["mass_kg"][now].sum() == pytest.approx(1190 * 0.0096**2 * 0.0016, rel=1e-6)
    summary, debris = single.read_summary(), table["fragment"][now] == 0
    assert summary["fragments"] == (~debris).sum() > 1
    share = table["mass_kg"][now][debris].sum() / table["mass_kg"][now].sum()
    assert share > 0
    assert summary["debris_mass_share"] == pytest.approx(share)
    assert (single.path / "fragments.png").stat().st_size > 0


@pytest.mark.slow
@pytest.mark.parametrize("lattice", CELLS)
def test_bars_that_failed_at_crack_tips_or_carry_compression_again_join_nothing(
    taichi: None, scene: Path, lattice: str
) -> None:
    """The pieces are those of the peak strains in the last checkpoint, negative at crack tips."""
    from taichi_ldem.solver.build import build_lattice

    out = scene.parent / lattice
    keys = ["material.fracture=crack", "material.after_failure=closing", "output.fragments=true"]
    words = [word for key in (*keys, f"plate.lattice={lattice}") for word in ("--set", key)]
    done = ldem("impact", str(scene), "--out", str(out), "--quiet", *words)
    assert done.returncode == 0, done.stderr
    run = RunFolder.open(out)
    plate = build_lattice(run.read_scene())
    peak = checkpoint.decode((out / checkpoint.LATEST).read_bytes()).state["dynamics/peak"]
    limits = [family.ductility for family in bars_of(run.read_scene())]
    limit = np.array([limits[family] for family in plate.cell.family])[:, None, None, None]
    failed = np.moveaxis(plate.bar_exists(), -1, 0) & ((peak < 0) | (peak >= limit * (1 - 1e-9)))
    assert failed.sum() == run.read_summary()["broken_bars"]
    assert (peak < 0).any()
    bits = (failed.astype(np.uint16) << np.arange(len(peak))[:, None, None, None]).sum(axis=0)
    stored = read_fields(run.fields_file, -1, ["fragment"]).quantities["fragment"]
    np.testing.assert_array_equal(stored, of_modules(plate, labels_of(plate, bits)))


def test_strain_and_stress_of_modules_are_in_the_fields(single: RunFolder) -> None:
    first, last = (read_fields(single.fields_file, step, get_args(Quantity)) for step in (0, -1))
    for name, values in first.quantities.items():
        assert np.abs(values).max() < (1e-6 * 3.35e9 if "stress" in name else 1e-6), name
    gradient = mean_gradient(last.points, last.hexahedra, last.displacement)
    strain = as_components(green_strain(gradient))
    np.testing.assert_allclose(last.quantities["strain"], strain, rtol=1e-5, atol=1e-6)
    stress, damage = last.quantities["stress"], last.quantities["damage"]
    largest = np.linalg.eigvalsh(as_matrices(stress))[:, 2]
    found = last.quantities["principal_stress"]
    np.testing.assert_allclose(found, largest, rtol=1e-4, atol=1e-4 * np.abs(stress).max())
    assert (damage[last.broken_fraction > 0] > 0).all()
    assert ((damage >= 0) & (damage <= 1)).all()
    # Hooke's law holds, on the whole, inside of the plate, where no bar has softened
    place = last.points[last.hexahedra].mean(axis=1)
    inside = (damage == 0) & (np.abs(place[:, 2] - 0.0008) < 0.0004)
    wanted = 3.35e9 / 2.5 * (strain[:, :3].sum(axis=1, keepdims=True) + 2 * strain[:, :3])
    apart = np.corrcoef(stress[inside, :3].ravel(), wanted[inside].ravel())[0, 1]
    assert inside.sum() > 20
    assert apart > 0.9


@pytest.mark.slow
def test_same_history_with_one_and_two_threads(finished: RunFolder, scene: Path) -> None:
    out = scene.parent / "two"
    done = ldem("impact", str(scene), "--out", str(out), "--threads", "2", "--quiet")
    assert (done.returncode, done.stdout) == (0, "")
    assert (out / "history.csv").read_bytes() == finished.history_file.read_bytes()


@pytest.mark.slow
def test_elastic_landings_have_one_history_on_one_and_two_threads(scene: Path) -> None:
    histories = []
    for threads in ("1", "2"):
        out = scene.parent / f"elastic_{threads}"
        words = ("--out", str(out), "--quiet", "--threads", threads)
        done = ldem("impact", str(scene), *words, "--set", 'contact.landing="elastic"')
        assert done.returncode == 0, done.stderr
        histories.append(RunFolder.open(out).read_history())
        assert abs(histories[-1]["contact_j"]).max() < 1e-9  # J; the striker gives 0.1 and more
        assert abs(histories[-1]["contact_elastic_j"]).max() > 0
    assert all((histories[0][name] == histories[1][name]).all() for name in histories[0])


@pytest.mark.slow  # builds a simulation to be refused
def test_an_existing_run_is_kept(finished: RunFolder, scene: Path) -> None:
    before = finished.history_file.read_bytes()
    done = ldem("impact", str(scene), "--out", str(finished.path))
    assert done.returncode == 2
    assert "--force" in done.stderr
    # refused only once the critical time step is known: the old run must still be there
    large = ("--set", "solver.time_step=1e-6", "--force")
    done = ldem("impact", str(scene), "--out", str(finished.path), *large)
    assert done.returncode == 2
    assert "above the critical time step" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert finished.history_file.read_bytes() == before


@pytest.mark.slow
def test_the_guard_stops_an_unstable_run(scene: Path) -> None:
    out = scene.parent / "unstable"
    settings = ["solver.time_step=1.95e-7", "solver.allow_unstable=true", "material.damage=false"]
    words = [w for text in settings for w in ("--set", text)]
    done = ldem("impact", str(scene), "--out", str(out), *words)
    assert done.returncode == 3
    last = next(line for line in done.stderr.splitlines() if line.startswith("stopped"))
    for word in ("stopped: t =", "step", "node x =", "likely cause: the time step 1.95e-07 s"):
        assert word in last
    folder = RunFolder.open(out)
    assert len(folder.read_history()["time_s"]) > 1
    assert folder.read_summary() == {}


@pytest.mark.slow
@pytest.mark.skipif(not vulkan_device(), reason="no Vulkan device: apt install mesa-vulkan-drivers")
def test_a_gpu_backend_cracks_the_same_plate(single: RunFolder, scene: Path) -> None:
    """Several whole steps a launch on Vulkan (a software device will do), strips on the CPU.

    Striker, rings and cracks, in f32: the same until the first bar softens, within bands then.
    """
    import device

    out = scene.parent / "vulkan"
    words = ["--precision", "f32", "--arch", "vulkan", "--quiet"]
    done = subprocess.run(
        [*COMMAND, "impact", str(scene), "--out", str(out), *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    folder = RunFolder.open(out)
    mine, theirs = folder.read_history(), single.read_history()
    assert device.deviations(mine, theirs, "f32") == []
    assert folder.read_summary()["steps"] > 500
    changed = mine | {"strain_j": mine["strain_j"] * 1.001}
    assert len(device.deviations(changed, theirs, "f32")) == 1


def test_ctrl_c_keeps_what_was_computed(scene: Path) -> None:
    out = scene.parent / "interrupted"
    long = ["--set", "solver.duration=1.0", "--set", "output.history_interval=1e-6"]
    code, errors = cut_off(scene, out, 8, signal.SIGINT, *long)
    assert code == 130
    assert "interrupted at t =" in errors
    assert "Traceback" not in errors
    assert len(RunFolder.open(out).read_history()["time_s"]) > 5
    assert not (out / "summary.json").exists()


def test_zeros_have_no_sign(finished: RunFolder) -> None:
    assert "-0.0" not in finished.history_file.read_text().replace("\n", ",").split(",")
    names = (
        "kinetic_plate",
        "kinetic_bodies",
        "strain",
        "fracture",
        "damping",
        "contact",
        "opened",
    )
    ledger = SimpleNamespace(**dict.fromkeys((*names, "external"), -0.0))
    columns = [o.column for energy in (False, True) for o in observables(energy=energy)]
    zeros = {"observed": dict.fromkeys(columns, -0.0), "time": -0.0, "energy_error": -0.0}
    values = runner.row(SimpleNamespace(ledger=ledger, broken_bars=0, **zeros))  # type: ignore
    assert {str(value) for value in values.values()} == {"0.0", "0"}
    assert newtons(-0.04) == "    0.0"
    assert newtons(-0.06) == "   -0.1"


@pytest.mark.slow
def test_what_a_scene_leaves_out_is_left_out(scene: Path) -> None:
    bare = scene.parent / "bare.toml"
    text = SCENE[: SCENE.index("[striker]")] + SCENE[SCENE.index("[solver]") :]
    bare.write_text(text.replace("failure_factor = 31.45", "damage = false"))
    out = scene.parent / "bare"
    done = ldem("impact", str(bare), "--out", str(out), "--quiet")
    assert done.returncode == 0, done.stderr
    names = ["time_s", "kinetic_plate_j", "strain_j", "energy_error"]
    assert list(RunFolder.open(out).read_history()) == names
    assert json.loads((out / "summary.json").read_text())["first_peak_force_n"] is None
    printed = ldem("info", str(bare), "--fields").stdout
    whole = ldem("info", str(scene), "--fields").stdout
    for field in ("peak", "touched", "recorded", "striker.nodes", "rings.nodes"):
        assert field in whole
        assert field not in printed
    assert "striker contact (no [striker])" in printed
    assert "left out: bar history and broken-bar record (material.damage = false)" in printed


@pytest.mark.slow
def test_the_end_is_written_where_it_falls_within_an_interval(scene: Path) -> None:
    out = scene.parent / "uneven"
    settings = ["solver.duration=2e-5", "output.history_interval=3e-6", "output.field_interval=0"]
    words = [w for text in settings for w in ("--set", text)]
    done = ldem("impact", str(scene), "--out", str(out), "--quiet", *words)
    assert done.returncode == 0, done.stderr
    folder = RunFolder.open(out)
    step = folder.read_summary()["time_step_s"]
    assert folder.read_history()["time_s"][-1] == pytest.approx(2e-5, abs=0.5 * step)
    assert read_fields(folder.fields_file).times == pytest.approx([0.0, 2e-5], abs=0.5 * step)


@pytest.mark.slow
def test_f32_runs_and_agrees_before_cracking(finished: RunFolder, single: RunFolder) -> None:
    f32, double = single.read_history(), finished.read_history()
    before = double["fracture_j"] == 0
    assert before.sum() > 10
    largest = double["strain_j"][before].max()
    assert np.abs(f32["strain_j"] - double["strain_j"])[before].max() < 1e-3 * largest
