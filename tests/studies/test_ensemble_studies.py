"""Studies that read ensembles: directions of cracks, and the effect of the module size."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.paths import SCENES

from studies import bias, size_effect
from studies import specimens as specimens_study
from taichi_ldem.analysis.cracks import RadialCrack
from taichi_ldem.ensemble.attempt import FINISHED
from taichi_ldem.ensemble.axes import CV, SEED
from taichi_ldem.ensemble.results import Row
from taichi_ldem.errors import SceneError
from taichi_ldem.scene import load_scene

SCENE = SCENES / "cracking.toml"


def straight(degrees: float, length: float = 0.02, points: int = 61) -> RadialCrack:
    direction = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    path = np.linspace(0.002, length, points)[:, None] * direction
    return RadialCrack(path[-1], path, np.zeros(points))


def test_directions_are_folded_onto_the_nearest_axis():
    angles = np.radians([0, 44, 46, 90, 100, 225, 359])
    found = bias.folded(np.stack([np.cos(angles), np.sin(angles)], axis=-1))
    assert found == pytest.approx([0, 44, 44, 0, 10, 45, 1])


def test_cracks_along_the_axes_and_on_the_diagonals():
    axis = np.zeros(2)
    along = bias.specimen([straight(90.0 * n) for n in range(4)], axis, 1.0)
    assert bias.fourfold(along.tips) == pytest.approx(1)
    assert bias.fourfold(along.pieces, along.lengths) == pytest.approx(1)
    # the last chord may be short of the tip by less than a piece
    assert along.lengths.sum() == pytest.approx(4 * 0.018, rel=bias.PIECE / 60)
    across = bias.specimen([straight(45.0 + 90.0 * n) for n in range(4)], axis, 1.0)
    assert bias.fourfold(across.tips) == pytest.approx(-1)
    everywhere = bias.specimen([straight(angle) for angle in range(0, 360, 3)], axis, 1.0)
    assert bias.fourfold(everywhere.tips) == pytest.approx(0, abs=1e-12)
    assert np.mean(everywhere.tips < bias.CLOSE) == pytest.approx(2 * 10 / 90, abs=0.02)


def test_a_staircase_lies_along_its_chord():
    """Steps of one module at 45 degrees on the whole: its tip and its path say so."""
    steps = np.cumsum(np.tile([[1.0, 0.0], [0.0, 1.0]], (30, 1)), axis=0)
    crack = RadialCrack(steps[-1], steps, np.zeros(len(steps)))
    found = bias.specimen([crack], np.zeros(2), 1.0)
    assert bias.fourfold(found.tips) == pytest.approx(-1)
    assert bias.fourfold(found.pieces, found.lengths) == pytest.approx(-1)


def test_a_specimen_without_radial_cracks_has_no_direction():
    nothing = bias.specimen([], np.zeros(2), 1.0)
    assert (len(nothing.tips), len(nothing.pieces)) == (0, 0)
    found = bias.cells("none", [nothing])
    assert found[2:5] == ["0.0", "-", "-"]


def row(settings: list[str], varied: dict, **numbers: float) -> SimpleNamespace:
    member = SimpleNamespace(scene=load_scene(SCENE, settings), varied=varied)
    member.group = tuple((k, v) for k, v in varied.items() if k != SEED)
    return SimpleNamespace(member=member, numbers=numbers)


def test_groups_are_called_by_what_is_random_in_them():
    both = row(
        ["disorder.fracture_energy_cv=0.25", "plate.perturbation=0.05"],
        {CV: 0.25, SEED: 3, "striker.velocity": 2.0},
    )
    assert bias.label(both) == "CV 25 %, perturbed 5 % of L, striker.velocity 2.0"
    assert bias.label(row([], {"striker.position": [0.0, 0.0]})) == "homogeneous"
    strength = ["disorder.strength_cv=0.15", "disorder.reference_volume=1e-7"]
    strength += ['material.fracture="crack"', "material.failure_strain=0.02"]
    assert bias.label(row(strength, {})) == "strength CV 15 %"


def specimens(modules: int, mean: float, deviation: float, seed: int) -> list[SimpleNamespace]:
    values = np.random.default_rng(seed).normal(mean, deviation, 40)
    return [
        row([], {size_effect.MODULES: modules, SEED: n}, strength=float(value))
        for n, value in enumerate(values)
    ]


def test_a_size_effect_is_seen_and_its_absence_too():
    table = size_effect.report(
        specimens(3, 60e6, 3e6, 1) + specimens(6, 50e6, 1e6, 2), "strength", 1e6
    )
    *_, last = table.strip().splitlines()
    _, _, pair, ratio, means, spreads, _, _ = (cell.strip() for cell in last.split("|"))
    assert pair == "3, 6"
    assert float(ratio) == pytest.approx(50 / 60, abs=0.02)
    assert float(means) < 1e-6
    assert float(spreads) < 1e-3
    same = [[r.numbers["strength"] for r in specimens(3, 60e6, 3e6, seed)] for seed in (3, 4)]
    _, means, spreads = size_effect.compared(*same)
    assert min(means, spreads) > 0.05


def test_seeds_are_compared_in_pairs():
    # differences of 1, 2 and 3 over a mean of 20: 2 +- 4.303 (t, two degrees) x 1 / sqrt 3
    assert size_effect.seed_by_seed([10.0, 20.0, 30.0], [11.0, 22.0, 33.0]) == (
        "+10.0 ± 12.4 % (p = 0.074)"
    )
    assert size_effect.seed_by_seed([1.0], [1.0, 2.0]) == "-"


def test_interval_of_a_deviation():
    """s = 1 of ten values: 0.688 to 1.826 (tables of chi squared: 19.02 and 2.700)."""
    low, high = size_effect.deviation_interval(1.0, 10)
    assert (low, high) == pytest.approx((0.688, 1.826), abs=1e-3)


def test_a_number_that_no_member_has():
    with pytest.raises(SceneError, match="--number toughness: no finished member has it"):
        size_effect.report(specimens(3, 60e6, 1e6, 1), "toughness", 1.0)


def test_numbers_over_those_of_the_homogeneous_specimen():
    def made(modules: int, cv: float, strength: float) -> Row:
        settings = [f"plate.modules_through_thickness={modules}"]
        settings += [f"disorder.fracture_energy_cv={cv}"] if cv else []
        found = row(settings, {size_effect.MODULES: modules, CV: cv})
        return Row(found.member, {"strength": strength}, (), FINISHED)

    rows = [made(3, 0.0, 50.0), made(3, 0.25, 40.0), made(6, 0.25, 30.0)]
    with pytest.raises(SceneError, match="no finished homogeneous specimen has 6 modules"):
        size_effect.over_homogeneous(rows, "strength")
    found = size_effect.over_homogeneous([*rows, made(6, 0.0, 40.0)], "strength")
    assert [r.numbers["strength"] for r in found] == pytest.approx([40 / 50, 30 / 40])


def test_two_groups_of_specimens_differ_where_welch_says_so():
    """Two samples of eight: means 10 and 13, deviations 1 and 2, by construction."""
    eight = np.array([-1.0, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0]) * np.sqrt(7 / 8)
    first, second = 13 + 2 * eight, 10 + eight
    value, half, p = specimens_study.difference(first, second)
    # t = 3 / sqrt(1 / 8 + 4 / 8) = 3.795, 25 / 17 x 7 = 10.3 degrees of freedom, t(0.975) = 2.22
    assert value == pytest.approx(0.3)
    assert half == pytest.approx(2.22 * np.sqrt(5 / 8) / 10, rel=2e-3)
    assert 0.002 < p < 0.005  # t = 3.795 lies between 3.58 (0.005) and 4.14 (0.002) of 10 degrees
    plain = dict.fromkeys(specimens_study.QUANTITIES, second)
    table = specimens_study.report({"a": plain, "b": plain | {"P1": first}})
    assert table.splitlines()[-1].count("(+0 ") == len(plain) - 1
    assert "| +30 ± 18 % |" in table
