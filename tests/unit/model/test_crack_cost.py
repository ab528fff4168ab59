"""What a crack costs in a scene, against the strips from which it was read."""

import pytest
from support.paths import CONFIGS

from taichi_ldem.model.crack_cost import crack_cost, words
from taichi_ldem.scene import Scene, load_scene, parse_scene


def _at(modules: int):
    """The cost in the strip of docs/tension.md with modules of 1.6 mm over a number."""
    data = load_scene(CONFIGS / "tension_strip.toml").model_dump(by_alias=True, exclude_none=True)
    data["plate"] |= {"modules_through_thickness": modules}
    return crack_cost(parse_scene(data))


# costs of running cracks by `ldem study toughness`: the table of docs/tension.md
@pytest.mark.parametrize(
    ("modules", "axis", "diagonal"), [(3, 3.23, 2.79), (6, 1.87, 1.29), (12, 1.49, 1.19)]
)
def test_the_cost_is_what_was_measured(modules: int, axis: float, diagonal: float) -> None:
    cost = _at(modules)
    assert cost.axis == pytest.approx(axis, rel=0.01)
    assert cost.diagonal == pytest.approx(diagonal, rel=0.01)


def test_modules_that_resolve_their_cracks() -> None:
    cost = _at(12)
    assert cost.resolved == pytest.approx(0.027 * 1.011e-3, rel=0.02)  # 0.1 / 0.49 of 0.132 l_ch
    fine = _at(60)  # edges of 0.0267 mm
    assert fine.axis == pytest.approx(1.1, abs=0.01)


def _with(**material) -> Scene:
    data = load_scene(CONFIGS / "impact.toml").model_dump(by_alias=True, exclude_none=True)
    data["material"] |= material
    return parse_scene(data)


def test_cracks_that_grow_by_their_energy_cost_about_g_f() -> None:
    said = words(_with(fracture="crack"))
    assert said == "0.95 to 1.38 G_f, by its direction in the lattice"
    assert crack_cost(_with(fracture="crack")) is None
    assert words(_with()).startswith("2.8 to 3.2 G_f")


@pytest.mark.parametrize(
    ("lattice", "costs"), [("module", "0.94 to 1.10 G_f"), ("cubic-26", "0.99 to 1.10 G_f")]
)
def test_tip_strains_have_costs_of_their_own(lattice: str, costs: str) -> None:
    """docs/tension.md, tip strains in a perturbed lattice."""
    data = load_scene(CONFIGS / "impact_crack_module.toml").model_dump(
        by_alias=True, exclude_none=True
    )
    data["plate"] |= {"perturbation": 0.07, "lattice": lattice}
    data["material"] |= {"tip_criterion": "strain"}
    assert str(words(parse_scene(data))).startswith(costs)


def test_each_lattice_has_its_own_costs() -> None:
    """Those of cubic-26 are in docs/tension.md; with fracture = "bar" they were not measured."""
    data = load_scene(CONFIGS / "impact_crack_module.toml").model_dump(
        by_alias=True, exclude_none=True
    )
    data["plate"] |= {"lattice": "cubic-26"}
    assert words(parse_scene(data)) == "0.82 to 1.15 G_f, by its direction in the lattice"
    data["material"] |= {"fracture": "bar", "failure_strain": 0.01}
    assert words(parse_scene(data)) is None


def test_nothing_is_said_of_what_was_not_measured() -> None:
    assert crack_cost(load_scene(CONFIGS / "impact_measured_strength.toml")) is None
    assert crack_cost(_with(law="exponential", failure_factor=20.0)) is None
    assert crack_cost(_with(poisson_ratio=0.33, failure_factor=20.0)) is None
    assert crack_cost(_with(poisson_ratio=0.28)) is not None
