"""Grips, gauge, and the tension test from the command line."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.blocks import PMMA, SPACING, block_scene
from support.paths import CONFIGS
from support.reference import Body

from taichi_ldem.cli import main
from taichi_ldem.model import material as mat
from taichi_ldem.scenarios.tension import initial_slope
from taichi_ldem.storage.fields import read_broken_bars
from taichi_ldem.storage.folder import RunFolder

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

LENGTH, SPEED, RAMP = 1.2 * SPACING, 3.0, 4e-6


def _pulled(lateral: str) -> "Simulation":
    from taichi_ldem.solver.simulation import Simulation

    grips = {"length": LENGTH, "velocity": SPEED, "ramp": RAMP, "lateral": lateral}
    return Simulation(block_scene(12, 4, 3, scenario="tension", grips=grips))


@pytest.fixture(scope="module", params=["held", "free"])
def pulled(taichi: None, request: pytest.FixtureRequest) -> "Simulation":
    return _pulled(request.param)


@pytest.fixture
def gripped(pulled: "Simulation") -> "tuple[Simulation, Body, np.ndarray]":
    """A block of 12 x 4 x 3 modules at rest; of its nodes, +1 and -1 for those in the grips."""
    pulled.reset(pulled.scene)
    body = Body(pulled.dynamics.lattice.mask, SPACING)
    x = body.positions[:, 0]
    return pulled, body, np.sign(x) * (np.abs(x) > 6 * SPACING - LENGTH)


def test_grips_go_where_their_speed_takes_them(
    gripped: "tuple[Simulation, Body, np.ndarray]",
) -> None:
    simulation, body, side = gripped
    assert np.count_nonzero(side) == 2 * (
        2 * 5 * 4 + 4 * 3
    )  # two planes of corners, one of centres
    simulation.advance(100)
    displaced = simulation.displacement()[body.index]
    times = np.linspace(0, simulation.time, 100_001)
    share = np.minimum(times / RAMP, 1)
    separation = np.mean(SPEED * (3 * share**2 - 2 * share**3)) * simulation.time
    assert simulation.time > 2 * RAMP
    held = side != 0
    np.testing.assert_allclose(displaced[held, 0], 0.5 * separation * side[held], rtol=1e-5)
    grips = simulation.body("grips")
    assert grips.separation_at(simulation.time) == pytest.approx(separation, rel=1e-5)
    assert grips.separation_at(0.3 * RAMP) == pytest.approx(
        SPEED * RAMP * (0.3**3 - 0.5 * 0.3**4), rel=1e-12
    )
    across = np.abs(displaced[side != 0, 1:]).max()
    if simulation.body("grips").table.lateral == "held":
        assert across == 0.0
    else:
        assert across > 1e-3 * separation


def test_force_and_work_are_those_of_the_nodes_in_the_grips(
    gripped: "tuple[Simulation, Body, np.ndarray]",
) -> None:
    """Newton's law node by node, bar forces from the reference lattice."""
    simulation, body, side = gripped
    stiffness = mat.axial_stiffness(PMMA["youngs_modulus"], PMMA["poisson_ratio"], SPACING)
    mass = PMMA["density"] * SPACING**3 * body.mass_shares[:, None]
    dt = simulation.time_step
    simulation.advance(60)
    rows = []
    for _ in range(20):
        before = simulation.dynamics.get_velocity()[body.index]
        bars = body.forces(simulation.displacement()[body.index], stiffness)
        sample = simulation.sample_step()
        after = simulation.dynamics.get_velocity()[body.index]
        given = mass * (after - before) - dt * bars
        assert np.abs(given[side == 0]).max() < 1e-9 * np.abs(given).max()
        if rows:  # the first sample's force is a mean since the start
            pull = 0.5 * (side * given[:, 0]).sum() / dt
            assert sample.observed["grip_force_n"] == pytest.approx(pull, rel=1e-9)
        # a step's work: one half before the sample's time, one half after
        halves = 0.5 * (given * before).sum(), 0.5 * (given * after).sum()
        rows.append((*halves, sample.ledger.external))
    earlier, later, external = np.array(rows).T
    np.testing.assert_allclose(np.diff(external), later[:-1] + earlier[1:], rtol=1e-7)
    assert sample.ledger.contact == 0.0
    assert sample.ledger.kinetic_plate > 0.01 * sample.ledger.external  # both terms count
    assert sample.energy_error < 1e-7  # finite strains: the work's trapezoids are not exact


def test_the_gauge_reads_uniform_strains(gripped: "tuple[Simulation, Body, np.ndarray]") -> None:
    simulation, body, _ = gripped
    gauge = simulation.body("grips").gauge
    # half of the 9.6 modules between the grips; planes at -2 and 2, sides at -2 and 2
    assert (gauge.length, gauge.width) == pytest.approx((4 * SPACING, 4 * SPACING), rel=1e-12)
    assert gauge.section == pytest.approx(12 * SPACING**2, rel=1e-9)
    strain = np.array([[2e-3, 1e-4, 0], [3e-4, -5e-4, 0], [0, 0, 7e-4]])
    displaced = body.positions @ strain.T + 1e-5
    simulation.dynamics.set_displacement(0, body.spread(displaced))
    assert gauge.strains(0) == pytest.approx((2e-3, -5e-4), rel=1e-9)


def test_a_gauge_across_the_lattice(taichi: None) -> None:
    from taichi_ldem.model.outlines import specimen_mask
    from taichi_ldem.scene import Material, Plate
    from taichi_ldem.solver.dynamics import Dynamics, Features
    from taichi_ldem.solver.gauge import Gauge

    plate = Plate(size=(20 * SPACING, 6 * SPACING, SPACING), modules_through_thickness=1, angle=45)
    from taichi_ldem.model.lattice import Lattice

    lattice = Lattice(specimen_mask(plate), SPACING)
    bars = mat.bar_families(Material(**PMMA), SPACING)
    dynamics = Dynamics(lattice, bars, PMMA["density"], Features())
    gauge = Gauge(dynamics, np.pi / 4, 10 * SPACING)
    # nine rows of modules side by side, 1/sqrt(2) apart: a mean width of 9/sqrt(2)
    assert gauge.section == pytest.approx(9 / np.sqrt(2) * SPACING**2, rel=0.01)
    body = Body(lattice.mask, SPACING)
    along = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    across = np.array([-1.0, 1.0, 0.0]) / np.sqrt(2)
    strain = 2e-3 * np.outer(along, along) - 5e-4 * np.outer(across, across)
    dynamics.set_displacement(0, body.spread(body.positions @ strain))
    assert gauge.strains(0) == pytest.approx((2e-3, -5e-4), rel=1e-9)


def test_the_initial_slope_is_that_of_the_curve_at_the_origin() -> None:
    x = np.linspace(0.001, 0.01, 30)
    assert initial_slope(x, 3.0 * x - 5.0 * x**2) == pytest.approx(3.0, rel=1e-9)
    assert np.isnan(initial_slope(x[:4], x[:4]))
    assert np.isnan(initial_slope(x[20:], x[20:]))
    ringing = 3.0 * x + 0.02 * x.max() * (-1.0) ** np.arange(30)
    assert np.isnan(initial_slope(x, ringing))


# -- the command

WITHOUT_VULKAN = os.environ | {"VK_ICD_FILENAMES": "/none", "VK_DRIVER_FILES": "/none"}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """Half a dumb-bell, pulled until it has parted."""
    out = tmp_path_factory.mktemp("tension") / "run"
    command = [sys.executable, "-m", "taichi_ldem.cli", "tension"]
    words = [str(CONFIGS / "tension_quick.toml"), "--out", str(out), "--threads", "1", "--quiet"]
    done = subprocess.run(
        [*command, *words], capture_output=True, text=True, check=False, env=WITHOUT_VULKAN
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    return RunFolder.open(out)


@pytest.mark.slow
def test_a_dumb_bell_is_pulled_until_it_parts(finished: RunFolder) -> None:
    history, summary = finished.read_history(), json.loads(finished.summary_file.read_text())
    assert list(history) == [
        "time_s",
        "grip_displacement_m",
        "grip_force_n",
        "gauge_strain",
        "gauge_lateral_strain",
        "kinetic_plate_j",
        "strain_j",
        "fracture_j",
        "external_j",
        "energy_error",
        "broken_bars",
    ]
    # three modules across: free faces make it softer (tests/verification/test_specimens.py)
    assert summary["youngs_modulus"] == pytest.approx(3.35e9, rel=0.04)
    assert summary["poisson_ratio"] == pytest.approx(0.25, abs=0.05)
    # E eps_p, less what the steps of the fillets raise the stress by
    assert 0.7 * 58.5e6 < summary["strength"] < 58.5e6
    force = history["grip_force_n"]
    assert summary["peak_force_n"] == force.max()
    assert summary["strength"] == pytest.approx(force.max() / (3 * 3 * (1.6e-3 / 3) ** 2), rel=1e-6)
    assert np.abs(force[-50:]).mean() < 0.15 * force.max()
    assert summary["energy_error_of_plate"] < 0.01
    net = summary["net_section_m2"]
    assert summary["fracture_energy_dissipated"] == pytest.approx(history["fracture_j"][-1] / net)
    assert summary["fracture_energy_dissipated"] > 1034.0
    x = read_broken_bars(finished.fields_file).position_m[:, 0]
    assert np.quantile(np.abs(x), 0.95) < 0.012 / 2 + 1e-3  # between the tabs
    for name in ("stress_strain.png", "energy.png", "crack_map.png"):
        assert (finished.path / name).stat().st_size > 10_000


DUMBBELL = (CONFIGS / "tension_quick.toml").read_text()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("grips.length=0.0155", "grips.length = 0.0155: must be at most 0.0153417"),
        ("grips.gauge_length=0.013", "grips.gauge_length = 0.013: must lie between 0.00106667"),
        ("grips.gauge_length=1e-4", "grips.gauge_length = 0.0001: must lie between 0.00106667"),
        ("grips.velocity=0", "grips.velocity = 0: must be greater than 0"),
        ("grips.lateral=loose", 'grips.lateral = "loose": must be "held" or "free"'),
        ("plate.narrow_width=0.005", "plate.narrow_width = 0.005: must lie between 0.0005"),
        (
            "plate.narrow_length=0.03",
            "plate.narrow_length = 0.03: must fit into plate.size[0] together with the fillets",
        ),
        ("plate.shape=rectangle", 'is for plate.shape = "dumbbell" only'),
        ("plate.angle=100", "plate.angle = 100: must be at most 90"),
        ("scenario=impact", 'scenario = "impact": takes no table [grips]'),
        ("clamp.kind=free", 'scenario = "tension": takes no table [clamp]'),
        ("floor.gap=0.0", 'scenario = "tension": takes no table [floor]'),
    ],
)
def test_bad_specimens_are_refused(
    setting: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scene.toml").write_text(DUMBBELL)
    assert main(["tension", str(tmp_path / "scene.toml"), "--set", setting]) == 2
    assert message in capsys.readouterr().err


def test_a_command_refuses_the_scene_of_another(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(DUMBBELL)
    assert main(["impact", str(scene)]) == 2
    assert 'scenario = "tension": run it with `ldem tension`' in capsys.readouterr().err
    assert main(["tension", str(CONFIGS / "impact_quick.toml")]) == 2
    assert "run it with `ldem impact`" in capsys.readouterr().err
    without = DUMBBELL[: DUMBBELL.index("[grips]")] + DUMBBELL[DUMBBELL.index("[solver]") :]
    scene.write_text(without)
    assert main(["tension", str(scene)]) == 2
    assert "missing table '[grips]'" in capsys.readouterr().err
