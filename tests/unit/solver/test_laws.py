import itertools
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.blocks import DAMAGE, PMMA, Breakable
from support.paths import ROOT

from taichi_ldem.model import material as mat
from taichi_ldem.model.material import BarFamily

G_F, EPS_P = DAMAGE["fracture_energy"], DAMAGE["failure_strain"]
FAMILIES = ["longitudinal", "diagonal"]


def _ductility(block: Breakable) -> np.ndarray:
    return block.body.per_bar(block.bars.longitudinal.ductility, block.bars.diagonal.ductility)


def _softening(block: Breakable, peak: np.ndarray) -> np.ndarray:
    """Force over EA eps_p at a peak strain (in eps_p), from Fig. 2 and from the equal-area rule."""
    ductility = _ductility(block)
    if block.law == "bilinear":
        return np.where(peak < ductility, (ductility - peak) / (ductility - 1), 0.0)
    # an exponential cut at 1 % of the peak force encloses K_r / 2 with the elastic triangle
    decay = (ductility - 1) / 2 / 0.99
    force = np.exp(-(peak - 1) / decay)
    return np.where(force > 0.01, force, 0.0)


def _integrity(block: Breakable, strain: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """Share of the stiffness that a bar keeps: secant unloading, whole in compression."""
    force = np.where(peak > 1, _softening(block, peak), peak)
    kept = np.divide(force, peak, out=np.ones_like(peak), where=peak > 0)
    return np.where((strain > 0) | (kept == 0), kept, 1.0)


@pytest.mark.parametrize("family", FAMILIES)
def test_one_bar_loaded_unloaded_reloaded_compressed_and_broken(
    breakable: Breakable, family: str
) -> None:
    block = breakable.renew()
    bar = int(np.argmax(block.body.diagonal == (family == "diagonal")))
    constants: BarFamily = getattr(block.bars, family)
    whole = block.body.weights[bar] * constants.axial_stiffness
    ductility = constants.ductility
    peak = 0.0
    # in units of eps_p; a uniform dilatation gives every bar the same strain
    path = [0.5, 0.999, 1.2, 0.6, -1.0, 0.0, 0.3, 1.2, 1.5, 0.75, 4.0 * ductility, 0.5, -1.0]
    for ratio in path:
        peak = max(peak, ratio)
        block.put(EPS_P * ratio * block.body.positions)
        length = constants.length * (1 + EPS_P * ratio)
        force = block.pulls()[bar] * length
        if peak > ductility * 2.5:
            assert force == 0.0  # broken, in compression too
            continue
        everywhere = np.ones(len(block.body.ends))
        kept = _integrity(block, ratio * everywhere, peak * everywhere)[bar]
        expected = whole * EPS_P * ratio * kept
        assert force == pytest.approx(expected, rel=1e-11, abs=1e-12 * whole * EPS_P)


@pytest.mark.parametrize(
    ("start", "end"), [(0.9, 1.1), (0.7, 1.6), (1.5, 1.9), (2.0, 9.0), (0.5, 9.0)]
)
def test_a_step_in_which_the_law_bends_does_the_work_of_the_bar(
    breakable: Breakable, start: float, end: float
) -> None:
    """The force of such a step, bar by bar, against the area under the law.

    A uniform dilatation takes all bars from one strain (in eps_p) to another; the first was the
    largest so far, or followed 1.7 for the third pair, which is stretched beyond it again.
    """
    block, time_step = breakable.renew(), 4e-8
    body, everywhere = block.body, np.ones(len(block.body.ends))
    peak = 1.7 if start == 1.5 else start
    block.put(EPS_P * peak * body.positions)
    block.put(EPS_P * start * body.positions)
    rate = EPS_P * (end - start) / time_step
    block.dynamics.set_velocity(body.spread(rate * body.positions))
    block.dynamics.set_displacement(0, body.spread(EPS_P * end * body.positions))
    found = block.pulls(time_step) * (1 + EPS_P * end)  # times L0: forces
    block.dynamics.set_velocity(body.spread(0 * body.positions))

    path = np.linspace(start, end, 4001)
    law = np.array([_integrity(block, e * everywhere, max(e, peak) * everywhere) for e in path])
    forces = law * path[:, None]
    change = end - start
    area = np.sum(0.5 * (forces[1:] + forces[:-1]), axis=0) * (path[1] - path[0])
    missing = area - 0.5 * (forces[0] + forces[-1]) * change
    families = block.bars.longitudinal, block.bars.diagonal
    stiffness = body.weights * body.per_bar(*(f.axial_stiffness / f.length for f in families))
    mass = PMMA["density"] * block.spacing**3 * body.mass_shares
    soft = time_step**2 * stiffness * (1 / mass[body.ends]).sum(axis=1)
    way = change + 0.5 * soft * (law[0] - law[-1]) * end
    least = np.minimum(missing, way**2 / (2 * soft))
    extra = (way - np.sqrt(way**2 - 2 * soft * least)) / soft
    expected = stiffness * EPS_P * (forces[-1] + extra)
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-4 * (stiffness * EPS_P).max())
    assert np.abs(extra).max() > 0.02  # it is no small correction


@pytest.fixture(scope="module")
def closing(taichi: None) -> Breakable:
    """A block whose failed bars carry compression; its kernels take 18 s on a slow core."""
    return Breakable("bilinear", closing=True)


def test_a_failed_bar_that_closes_carries_compression_and_no_tension(closing: Breakable) -> None:
    """Forces bar by bar, and the work of the nodes against the change of the ledger's energies."""
    block = closing.renew()
    body, positions = block.body, block.body.positions
    stiffness = (block.bars.longitudinal.axial_stiffness, block.bars.diagonal.axial_stiffness)
    block.put(4.0 * EPS_P * positions)  # K_r is 2.3 and 2.7: every bar fails
    assert not block.pulls().any()
    _, dissipated, broken = block.energies()
    assert broken == len(body.ends)
    work = 0.0
    path = np.linspace(0.5, -1.5, 41)
    before = block.node_forces()
    for last, ratio in itertools.pairwise(path):
        displacement = EPS_P * ratio * positions
        block.put(displacement)
        kept = np.full(len(body.ends), 1.0 if ratio < 0 else 0.0)
        force = body.forces(displacement, stiffness, kept)
        np.testing.assert_allclose(block.node_forces(), force, atol=1e-12 * stiffness[0])
        # the nodes do work against the bars' forces, by the trapezium rule
        work -= 0.5 * ((before + force) * (EPS_P * (ratio - last) * positions)).sum()
        before = force
    strain, fracture, still = block.energies()
    assert (fracture, still) == (dissipated, broken)
    assert strain == pytest.approx(work, rel=2e-3)  # 30 trapeziums of a parabola and its ends
    block.put(0.2 * EPS_P * positions)
    assert not block.pulls().any()


@pytest.mark.parametrize(("start", "end"), [(0.4, -0.3), (-0.3, 0.4), (0.4, 0.1), (-0.1, -0.4)])
def test_what_a_step_leaves_out_where_crack_faces_meet_is_booked_as_lost(
    closing: Breakable, start: float, end: float
) -> None:
    """The trapezium of a step less the area under the force, which is 0 in tension, bar by bar."""
    block, time_step = closing.renew(), 4e-8
    body = block.body
    block.put(4.0 * EPS_P * body.positions)
    rate = EPS_P * (end - start) / time_step
    block.dynamics.set_velocity(body.spread(rate * body.positions))
    block.dynamics.set_displacement(0, body.spread(EPS_P * end * body.positions))
    block.pulls(time_step)
    block.sums.potential(0)
    found = block.sums.lost_at_faces(block.sums.total())

    path = np.linspace(start, end, 4001)
    force = np.minimum(path, 0.0)
    missing = 0.5 * (force[0] + force[-1]) * (end - start) - np.trapezoid(force, path)
    families = block.bars.longitudinal, block.bars.diagonal
    scale = body.weights * body.per_bar(*(f.axial_stiffness * f.length for f in families))
    expected = missing * EPS_P**2 * scale.sum()
    assert found == pytest.approx(expected, rel=1e-4, abs=1e-9 * EPS_P**2 * scale.sum())
    assert np.sign(start) * np.sign(end) > 0 or abs(missing) > 0.03  # it is no small correction


@pytest.mark.parametrize("family", FAMILIES)
def test_pulling_a_bar_apart_takes_its_fracture_energy(breakable: Breakable, family: str) -> None:
    """The area under force against elongation, by the trapezium rule, is G_f A_f for both laws."""
    block = breakable.renew()
    bar = int(np.argmax(block.body.diagonal == (family == "diagonal")))
    constants: BarFamily = getattr(block.bars, family)
    strain = EPS_P * np.linspace(0.0, 8.0, 401)
    force = []
    for value in strain:
        block.put(value * block.body.positions)
        axial = block.axial()
        force.append(axial[_home(block, bar)] * constants.length * (1 + value))
    assert force[-1] == 0.0
    work = np.trapezoid(force, strain * constants.length)
    given = G_F * constants.fracture_area * block.body.weights[bar]
    assert work == pytest.approx(given, rel=1e-3)


def _home(block: Breakable, bar: int) -> tuple[int, ...]:
    """Index of a bar in the program's (S, 14) fields."""
    shape = (*block.dynamics.sites, 14)
    numbers = np.arange(np.prod(shape)).reshape(shape)
    found = block.body.bar_values(numbers, block.dynamics.lattice.bar_midpoints)[bar]
    return tuple(int(n) for n in np.unravel_index(int(found), shape))


def test_any_history_of_all_bars(breakable: Breakable) -> None:
    block = breakable.renew()
    rng = np.random.default_rng(11)
    body, stiffness = (
        block.body,
        tuple(f.axial_stiffness for f in (block.bars.longitudinal, block.bars.diagonal)),
    )
    peak = np.zeros(len(body.ends))
    for size in (0.3, 0.5, 0.8, 0.5, 1.2, 0.2, 1.5):
        displacement = rng.normal(0.0, size * EPS_P * block.spacing, (len(body.places), 3))
        block.put(displacement)
        strain = body.strains(displacement)
        peak = np.maximum(peak, strain / EPS_P)
        kept = _integrity(block, strain, peak)
        expected = body.forces(displacement, stiffness, kept)
        np.testing.assert_allclose(
            block.node_forces(), expected, rtol=0, atol=1e-12 * np.abs(expected).max()
        )
        energy, fracture, broken = block.energies()
        assert energy == pytest.approx(body.strain_energy(displacement, stiffness, kept), rel=1e-12)
        assert broken == np.count_nonzero((peak > 1) & (_softening(block, peak) == 0))
    assert 0 < broken < len(body.ends)
    assert fracture > 0


def test_the_dissipated_energy_is_the_work_that_does_not_come_back(breakable: Breakable) -> None:
    """External work along a path of loading, unloading and failing bars, against the ledger."""
    block = breakable.renew()
    rng = np.random.default_rng(12)
    mode = rng.normal(0.0, EPS_P * block.spacing, (len(block.body.places), 3))
    turns = [0.0, 1.0, -0.5, 2.5]
    amplitudes = np.concatenate([np.linspace(a, b, 400) for a, b in itertools.pairwise(turns)])
    work, before, force_before = 0.0, 0.0, np.zeros_like(mode)
    for amplitude in amplitudes:
        block.put(amplitude * mode)
        force = -block.node_forces()
        work += 0.5 * np.sum((force + force_before) * mode) * (amplitude - before)
        before, force_before = amplitude, force
    energy, fracture, broken = block.energies()
    assert broken > 20
    assert fracture > 0.1 * work
    # the trapezium rule misses half a step at each sudden failure of the exponential law
    assert energy + fracture == pytest.approx(work, rel=2e-3)


def test_all_bars_broken_dissipate_g_f_times_their_areas(breakable: Breakable) -> None:
    block = breakable.renew()
    block.put(10 * EPS_P * block.body.positions)
    energy, fracture, broken = block.energies()
    areas = block.body.weights * block.body.per_bar(*mat.fracture_areas(0.25)) * block.spacing**2
    assert energy == 0.0
    assert broken == len(block.body.ends)
    assert fracture == pytest.approx(G_F * areas.sum(), rel=1e-12)


def test_broken_bars_are_reported_once_and_in_order(breakable: Breakable) -> None:
    block = breakable.renew()
    body, dynamics = block.body, block.dynamics
    block.put(10 * EPS_P * body.positions * [1, 0, 0])
    sites, bars = dynamics.new_broken()
    assert len(bars) == block.energies()[2] > 0
    order = np.lexsort((bars, *sites.T[::-1]))
    np.testing.assert_array_equal(order, np.arange(len(bars)))
    along = body.strains(10 * EPS_P * body.positions * [1, 0, 0]) / EPS_P
    broken = _softening(block, np.maximum(along, 1)) == 0
    middle = dynamics.lattice.bar_midpoints(sites, bars)
    mine = body.positions[body.ends[broken]].mean(axis=1)
    assert {tuple(p) for p in np.rint(4 * middle / block.spacing).astype(int).tolist()} == {
        tuple(p) for p in np.rint(4 * mine / block.spacing).astype(int).tolist()
    }
    assert len(dynamics.new_broken()[1]) == 0
    block.put(10 * EPS_P * body.positions)
    assert len(dynamics.new_broken()[1]) == len(body.ends) - len(bars)


def test_a_brittle_bar_breaks_at_once(breakable: Breakable) -> None:
    block = breakable.renew(limit_strain=EPS_P)
    block.put(0.999 * EPS_P * block.body.positions)
    assert block.energies()[1:] == (0.0, 0)
    block.put(1.001 * EPS_P * block.body.positions)
    energy, fracture, broken = block.energies()
    assert broken == len(block.body.ends)
    assert energy == 0.0
    stiffness = mat.axial_stiffness(PMMA["youngs_modulus"], 0.25, block.spacing)
    whole = block.body.strain_energy(EPS_P * block.body.positions, stiffness)
    assert fracture == pytest.approx(whole, rel=1e-12)  # all that was stored at eps_p


STRAIGHT = """
import taichi as ti

@ti.func
def softening(peak, failure, _):
    return (failure - peak) / (failure - 1)

@ti.func
def area(peak, failure, _):
    return (peak - 1) * (1 - 0.5 * (peak - 1) / (failure - 1))

def parameters(ductility):
    return ductility, 0.0
"""

NEW_LAW = """
import sys
from support.blocks import DAMAGE, block_scene
assert "taichi" not in sys.modules
scene = block_scene(2, 2, 2, material=DAMAGE | {"law": "straight"})
assert "taichi" not in sys.modules
from taichi_ldem.solver.laws import law_named
law = law_named("straight")
assert law.parameters(3.0) == (3.0, 0.0)
print(law.softening.__module__)
"""


def test_a_law_is_added_by_a_file(tmp_path: Path) -> None:
    """A scene takes the name of a new file, and checking the scene does not import Taichi."""
    package = tmp_path / "taichi_ldem"
    shutil.copytree(ROOT / "taichi_ldem", package, ignore=shutil.ignore_patterns("__pycache__"))
    (package / "solver" / "laws" / "straight.py").write_text(STRAIGHT, encoding="utf-8")
    path = os.pathsep.join([str(tmp_path), str(ROOT / "tests")])
    command = [sys.executable, "-c", NEW_LAW]
    done = subprocess.run(
        command, cwd=tmp_path, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-1] == "taichi_ldem.solver.laws.straight"
