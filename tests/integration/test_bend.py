"""Beams on two cylinders: contact, statics, balances, and what the scenario reports."""

import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from support.blocks import DAMAGE, PMMA, SPACING, block_scene
from support.paths import CONFIGS
from support.reference import Body

from taichi_ldem.analysis.cracks import broken_area
from taichi_ldem.model import material as mat
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.scenarios import bend
from taichi_ldem.scene import Notch, Scene, load_scene
from taichi_ldem.storage.fields import BrokenBars, read_broken_bars
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.studies.compliance import lattice_compliance

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

SPAN, LENGTH, WIDTH, HEIGHT = 24, 28, 2, 4  # modules
MODULE_MASS = PMMA["density"] * SPACING**3
STIFFNESS = mat.axial_stiffness(PMMA["youngs_modulus"], PMMA["poisson_ratio"], SPACING)


def beam_scene(striker: dict[str, Any], **tables: Any) -> Scene:
    """A beam under a cylinder, 14 x 1 x 2 mm on a span of 12 mm."""
    striker = {"shape": "cylinder", "diameter": 4e-3, "velocity": 0.0} | striker
    supports = {"span": SPAN * SPACING, "diameter": 2e-3}
    return block_scene(LENGTH, WIDTH, HEIGHT, striker=striker, supports=supports, **tables)


# -- a beam that is struck -------------------------------------------------------------------------


class Struck:
    """A notched beam hit by a heavy cylinder, watched at every seventh step.

    Attributes (n looks):
        balance: (n,) momentum of striker and beam, and what the supports have taken, kg m/s.
        taken: (n,) the last of these.
        inside: (n,) deepest place of any node inside striker or supports, m.
        last: the last sample.
    """

    mass, speed, looks = 0.1, 1.0, 200

    def __init__(self) -> None:
        from taichi_ldem.solver.contact.kernels.body import IMPULSE
        from taichi_ldem.solver.simulation import Simulation

        notch = {"normal": "x", "position": 0.0, "from": [-1e-3, 0.0], "to": [1e-3, 0.6e-3]}
        striker = {"mass": self.mass, "velocity": self.speed}
        scene = beam_scene(striker, material=DAMAGE, notch=[notch])
        self.simulation = s = Simulation(scene)
        body = Body(s.dynamics.lattice.mask, SPACING)
        masses = MODULE_MASS * body.mass_shares
        rows = []
        for _ in range(self.looks):
            s.advance(6)
            sample = s.sample_step()
            velocity = s.dynamics.get_velocity()[body.index]
            place = body.positions + s.displacement()[body.index]
            travelled, _, speed = s.body("striker").motion()
            momentum = self.mass * speed - masses @ velocity[:, 2]
            taken = float(s.body("supports").collected()[IMPULSE])
            rows.append((momentum + taken, taken, self._inside(place, travelled)))
        self.last = sample
        self.balance, self.taken, self.inside = np.array(rows).T

    def _inside(self, place: np.ndarray, travelled: float) -> float:
        """Depth in the nearest of the three cylinders, whose flat shafts point away."""
        x, _, z = place.T
        up = np.minimum(z - (HEIGHT * SPACING + 2e-3 - travelled), 0.0)
        nose = 2e-3 - np.hypot(x, up)
        down = np.maximum(z + 1e-3, 0.0)
        rolls = 1e-3 - np.hypot(np.abs(x) - SPAN * SPACING / 2, down)
        return float(max(nose.max(), rolls.max()))


@pytest.fixture(scope="module")
def struck(taichi: None) -> Struck:
    return Struck()


def test_striker_beam_and_supports_keep_the_momentum(struck: Struck) -> None:
    np.testing.assert_allclose(struck.balance, struck.mass * struck.speed, rtol=1e-12)
    assert struck.taken[-1] > 1e-3 * struck.mass * struck.speed
    assert np.diff(struck.taken).min() >= 0  # a support does not pull


def test_no_node_is_inside_a_cylinder(struck: Struck) -> None:
    assert struck.inside.max() < 1e-9 * SPACING


def test_energy_is_accounted_for_until_something_breaks(struck: Struck) -> None:
    assert struck.last.ledger.fracture == 0
    assert struck.last.energy_error < 1e-9
    given = 0.5 * struck.mass * struck.speed**2 - struck.last.ledger.kinetic_bodies
    assert given > 1e-4 * 0.5 * struck.mass * struck.speed**2
    # displacements are not small, so the trapezoidal work of the bars' forces is not exact
    assert struck.last.energy_error_of_plate < 1e-5


def test_notch_bars_are_neither_broken_nor_dissipated(struck: Struck) -> None:
    from taichi_ldem.solver.build import notch_bars

    assert struck.last.broken_bars == 0
    notch = struck.simulation.scene.notch[0]
    lattice = struck.simulation.dynamics.lattice
    removed = notch_bars(struck.simulation.scene, lattice)
    # two modules wide: longitudinal bars on rows 0 and 1 of corner nodes and 1/2 of centre nodes;
    # diagonals upwards from both rows of corners, four each, and four downwards from the upper one
    assert np.unpackbits(removed.view(np.uint8)).sum() == 3 + 3 + 2 + 4 + 4 + 4
    # rows of bars at 0, 1/4, ..., 2 mm: 0.6 mm cuts those up to 0.5 mm
    assert bend.notch_depth(notch, lattice) == pytest.approx(0.625e-3, rel=1e-12)
    # what is removed and what is left make up the section, as a notch beside it shows
    other = notch.model_copy(update={"from_": (-1e-3, 0.6e-3), "to": (1e-3, 2e-3)})
    parts = [bend.ligament_area(struck.simulation.scene, n, lattice) for n in (notch, other)]
    section = WIDTH * HEIGHT * SPACING**2
    assert sum(parts) == pytest.approx(section, rel=1e-12)
    assert sum(parts) > parts[0] > 0.6 * section


@pytest.mark.slow
def test_a_cylinder_out_of_reach_never_acts(taichi: None) -> None:
    from taichi_ldem.solver.simulation import Simulation

    ends = []
    for tables in (
        {},
        {
            "striker": {"shape": "cylinder", "diameter": 4e-3, "mass": 1.0, "velocity": 1.0}
            | {"gap": 1e-3}
        },
    ):
        simulation = Simulation(block_scene(6, 3, 2, **tables))
        noise = np.random.default_rng(3).normal(0.0, 1e-2, (2, *simulation.dynamics.sites, 3))
        noise *= simulation.dynamics.lattice.exists()[..., None]
        simulation.start_from(np.zeros_like(noise), noise)
        simulation.advance(200)
        ends.append(simulation.displacement())
    assert simulation.body("striker") is not None
    assert not simulation.body("striker").collected().any()
    np.testing.assert_array_equal(*ends)


# -- a beam at rest under a weight -----------------------------------------------------------------

WEIGHT = {"mass": 3e-6, "gravity": 4e3}  # 12 mN: small against what moves the contacts
DAMPING = 1.3e5


@pytest.fixture(scope="module")
def loaded(taichi: None) -> "Simulation":
    """The whole beam under a weight, at rest.

    DAMPING is near the critical one of its first mode, 6.6e4 rad/s by slender-beam theory.
    """
    from taichi_ldem.solver.simulation import Simulation

    simulation = Simulation(beam_scene(WEIGHT, solver={"damping": DAMPING}))
    for _ in range(12):
        simulation.advance(499)
        simulation.sample_step()
    return simulation


def test_supports_carry_what_the_striker_presses_with(loaded: "Simulation") -> None:
    weight = WEIGHT["mass"] * WEIGHT["gravity"]
    sample = loaded.sample_step()
    assert sample.observed["striker_force_n"] == pytest.approx(weight, rel=1e-6)
    assert sample.observed["support_force_n"] == pytest.approx(weight, rel=1e-6)


def test_the_beam_s_axis_bends_as_timoshenko_s(loaded: "Simulation") -> None:
    """Of the axis against its own places over the supports: dents at the contacts are not in it.

    P S^3/(48 E I) + P S/(4 k G A) with k = 10 (1 + nu)/(12 + 11 nu) (Cowper 1966).
    """
    modulus, nu = PMMA["youngs_modulus"], PMMA["poisson_ratio"]
    span, height, width = (n * SPACING for n in (SPAN, HEIGHT, WIDTH))
    shear = 10 * (1 + nu) / (12 + 11 * nu) * modulus / (2 * (1 + nu)) * height * width
    inertia = width * height**3 / 12
    expected = (
        WEIGHT["mass"]
        * WEIGHT["gravity"]
        * (span**3 / (48 * modulus * inertia) + span / (4 * shear))
    )
    sunk = -loaded.displacement()[0, 1 + HEIGHT // 2, 1 + WIDTH // 2, :, 2]
    middle = 1 + LENGTH // 2
    axis = sunk[middle] - 0.5 * (sunk[middle - SPAN // 2] + sunk[middle + SPAN // 2])
    assert axis == pytest.approx(expected, rel=0.02)  # four modules: 1 % more


def test_the_striker_sinks_as_the_assembled_lattice_says(loaded: "Simulation") -> None:
    """The same bars, assembled and solved without kernels, dents included."""
    lattice = loaded.dynamics.lattice
    none = np.zeros(lattice.sites, dtype=np.uint16)
    compliance = lattice_compliance(lattice, STIFFNESS, none, SPAN * SPACING)
    sunk = loaded.body("striker").motion()[0]
    assert sunk == pytest.approx(compliance * WEIGHT["mass"] * WEIGHT["gravity"], rel=1e-4)


# -- a section's energy ----------------------------------------------------------------------------


@pytest.mark.parametrize("depth", [1.0e-3, 1.25e-3, 1.4e-3])
def test_ligament_is_what_a_flat_crack_would_break(depth: float) -> None:
    """Half a row of bars more or less than the section beyond the notch's depth."""
    scene = block_scene(20, 6, 8, material=DAMAGE)
    lattice = Lattice(prism(20, 6, 8), SPACING)
    notch = Notch.model_validate(
        {"normal": "x", "position": 0.0, "from": [-1.5e-3, 0.0], "to": [1.5e-3, depth]}
    )
    built = bend.notch_depth(notch, lattice)
    assert abs(built - depth) <= SPACING / 4 + 1e-12
    left = bend.ligament_area(scene, notch, lattice) / (6 * SPACING)
    assert left == pytest.approx(8 * SPACING - built, abs=SPACING / 4)


# -- the command -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """A tiny notched beam of brittle bars, broken within 0.1 ms."""
    out = tmp_path_factory.mktemp("bend") / "run"
    changes = ("plate.size=[0.015, 0.0015, 0.003]", "plate.modules_through_thickness=6")
    changes += ("supports.span=0.012", "supports.diameter=0.002", "striker.diameter=0.002")
    changes += ("striker.velocity=3.0", "solver.duration=1.2e-4", "output.image_times=[]")
    settings = [word for change in changes for word in ("--set", change)]
    scene = out.parent / "small.toml"
    text = (CONFIGS / "bend_quick.toml").read_text()
    scene.write_text(text.replace("0.002875]", "0.001]").replace("0.0015, 0", "0.00075, 0"))
    command = [sys.executable, "-m", "taichi_ldem.cli", "bend", str(scene), "--out", str(out)]
    done = subprocess.run([*command, "--quiet", *settings], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return RunFolder.open(out)


def test_a_run_reports_its_energies_at_the_peak(finished: RunFolder) -> None:
    history, summary = finished.read_history(), finished.read_summary()
    assert "support_force_n" in history
    assert "ring_force_n" not in history
    assert history["broken_bars"][-1] > 0
    assert len(read_broken_bars(finished.fields_file).bar) == history["broken_bars"][-1]
    peak = int(np.argmax(history["strain_j"]))
    assert summary["peak_time_s"] == history["time_s"][peak]
    parts = ("absorbed_j", "peak_kinetic_j", "peak_contact_j")
    assert sum(summary[part] for part in parts) == pytest.approx(summary["peak_work_j"], rel=0.02)
    assert summary["notch_depth_m"] == pytest.approx(1.125e-3, rel=1e-12)
    # 1.5 mm x (3 - 1.125) mm; more than G_f per area only if it cracks beside the section too
    assert summary["ligament_area_m2"] == pytest.approx(1.5e-3 * 1.875e-3, rel=0.05)
    assert 0.3 * 1034 < summary["fracture_per_ligament_j_m2"] < 2 * 1034


def test_damage_beside_the_notch_s_plane_is_told_apart(finished: RunFolder) -> None:
    """Beside the broken bars that were recorded: each of them holds G_f times its area."""
    bars, summary = read_broken_bars(finished.fields_file), finished.read_summary()
    scene = load_scene(finished.scene_file)
    far = np.abs(bars.position_m[:, 0]) > 0.51 * scene.plate.spacing
    assert summary["broken_bars_beside_plane"] == np.count_nonzero(far)
    beside = BrokenBars(bars.time_s[far], bars.position_m[far], bars.bar[far])
    least = 1034 * float(broken_area(beside, scene, np.array([1.0]))[0])
    assert least <= summary["fracture_beside_plane_j"] * (1 + 1e-9)
    in_plane = summary["fracture_j"] - summary["fracture_beside_plane_j"]
    assert 0.5 * summary["fracture_j"] < in_plane <= summary["fracture_j"]


def test_a_new_run_clears_the_folder(finished: RunFolder) -> None:
    left = {path.name for path in finished.path.iterdir()}
    assert left - set(finished.own_files()) == {"run.lock"}


def test_a_run_has_its_pictures(finished: RunFolder) -> None:
    drawn = {path.name for path in finished.path.glob("*.png")}
    assert {"force.png", "force_displacement.png", "energy.png", "crack_map.png"} <= drawn
