"""Checks that compare tables of a scene with each other, and what each scenario asks of its scene.

Every check raises ValueError with a complete message. A check of a table is a function here that
``CHECKS`` lists. What a scenario needs stands in its entry of ``SCENARIOS``; ``register_scenario``
adds one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import flaws
from taichi_ldem.scene.checks_of_strikers import (
    check_strikers,
    check_supports,
    refuse_for_bend,
)
from taichi_ldem.scene.equations import FAMILY_NAMES, QUARTER, Bars, bar_families
from taichi_ldem.scene.load_rules import check_loads, check_probes, check_start
from taichi_ldem.scene.tables import SAFETY, SAFETY_OF_PIECES
from taichi_ldem.scene.values import refuse
from taichi_ldem.scene.weibull import strength_by_volume

if TYPE_CHECKING:
    from taichi_ldem.scene.scene import Scene

MAX_SAMPLES = 10**7
MAX_FRAMES = 10**4
NO_DURATION = 1.0  # s, of a scene that does not step in time
ROUNDING = 0.01  # largest relative change of a side that is rounded to whole modules
LEAST_RATIO_OF_VOLUMES = 0.16
"""Least Poisson's ratio of modules with an energy of their volume whose bars break.

Below 1/4 that energy is less than zero, so a module gains it when its first bar fails. In uniaxial
tension the four modules around an edge bar gain 2 (1 - 4 nu) (1 - 2 nu) mu eps^2 L^3, which must
not be more than the mu eps^2 L^3 / 2 that the bar loses: nu >= 0.1585.
"""
LARGE_SIDE = 1.0  # m; a plate with a longer side was probably meant in millimetres


def check(scene: Scene) -> None:
    """Compare all tables of a scene.

    Raises:
        ValueError: the message of the first fault.
    """
    for rule in CHECKS:
        rule(scene)


# --- scenarios ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ScenarioRules:
    """What a scenario asks of its scene.

    Attributes:
        needs: tables that the scene must have.
        without: tables that it must not have.
        breaks: whether bars may break, so that the lattice must be fine enough for the material.
        defaults: of keys that other scenarios need, by table and key.
        check: the scenario's own check, called when the tables are as above.
    """

    needs: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    breaks: bool = True
    defaults: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    check: Callable[[Scene], None] | None = None


def register_scenario(name: str, rules: ScenarioRules | None = None) -> None:
    """Make a scenario known to scenes as ``scenario = name``; one that is known stays as it is."""
    SCENARIOS.setdefault(name, rules or ScenarioRules())


def with_defaults(data: Any) -> Any:
    """Tables as TOML gives them, with the defaults of their scenario."""
    name = data.get("scenario") if isinstance(data, Mapping) else None
    rules = SCENARIOS.get(name) if isinstance(name, str) else None
    if rules is None:
        return data
    for table, values in rules.defaults.items():
        given = data.get(table, {})
        if isinstance(given, Mapping):
            data = {**data, table: {**values, **given}}
    return _with_safety(_with_stiffness(data))


def _with_stiffness(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """Tables with the stiffness of plates that bars alone would not make isotropic."""
    plate, material = data.get("plate"), data.get("material")
    if not isinstance(plate, Mapping) or not isinstance(material, Mapping):
        return data
    if "stiffness" in plate:
        return data
    stiffness = default_stiffness(material.get("poisson_ratio", QUARTER))
    return {**data, "plate": {**plate, "stiffness": stiffness}}


def default_stiffness(poisson_ratio: float) -> str:
    """``plate.stiffness`` where a scene does not name it."""
    return "equation-2" if poisson_ratio == QUARTER else "volumetric"


def _with_safety(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """Tables with the share of the critical time step that suits pieces that touch."""
    contact, solver = data.get("contact"), data.get("solver")
    if not isinstance(contact, Mapping) or not isinstance(solver, Mapping):
        return data
    if "safety" in solver or contact.get("fragments") is not True:
        return data
    return {**data, "solver": {**solver, "safety": SAFETY_OF_PIECES}}


def default_safety(scene: Scene) -> float:
    """``solver.safety`` where a scene does not name it."""
    pieces = scene.contact is not None and scene.contact.fragments
    return SAFETY_OF_PIECES if pieces else SAFETY


def _check_scenario(scene: Scene) -> None:
    """Check that the tables are there that the scenario needs, and none that it cannot use."""
    name, rules = scene.scenario, SCENARIOS[scene.scenario]
    for table in rules.without:
        if getattr(scene, table) is not None:
            raise refuse("scenario", name, f"takes no table [{table}]")
    if "grips" not in rules.needs:
        if scene.grips is not None:
            raise refuse("scenario", name, "takes no table [grips]")
        if scene.plate.angle:
            why = f"is for scenario = {_needing('grips')} only"
            raise refuse("plate.angle", scene.plate.angle, why)
    for table in rules.needs:
        if getattr(scene, table) is None:
            raise ValueError(f"missing table '[{table}]' (scenario = \"{name}\")")
    if scene.pulse is not None and "pulse" not in rules.needs:
        raise refuse("scenario", name, f"must be {_needing('pulse')} with a table [pulse]")
    if rules.check is not None:
        rules.check(scene)


def _needing(table: str) -> str:
    """Names of the scenarios that need a table."""
    return " or ".join(f'"{name}"' for name, rules in SCENARIOS.items() if table in rules.needs)


def _check_tension(scene: Scene) -> None:
    grips, spacing = scene.grips, scene.plate.spacing
    assert grips is not None
    between = scene.plate.size[0] - 2 * grips.length
    if between < 2 * spacing:
        longest = scene.plate.size[0] / 2 - spacing
        why = f"must be at most {longest:.6g}, which leaves two modules between the grips"
        raise refuse("grips.length", grips.length, why)
    gauge = grips.gauge_length or scene.default_gauge_length
    assert gauge is not None
    if not 2 * spacing * (1 - ROUNDING) <= gauge <= between * (1 + ROUNDING):
        why = f"must lie between {2 * spacing:.6g} (two modules) and {between:.6g} (grip to grip)"
        raise refuse("grips.gauge_length", gauge, why)


def _check_bend(scene: Scene) -> None:
    if scene.held:
        assert scene.clamp is not None
        why = 'must be "free" or absent with scenario = "bend": the beam lies on [supports]'
        raise refuse("clamp.kind", scene.clamp.kind, why)
    refuse_for_bend(scene)


def _check_wave(scene: Scene) -> None:
    pulse = scene.pulse
    assert pulse is not None
    _check_free_prism(scene)
    shortest = 4 * scene.plate.spacing
    if pulse.wavelength < shortest:
        why = f"must be at least {shortest:.6g}, four modules"
        raise refuse("pulse.wavelength", pulse.wavelength, why)
    axis = "xyz".index(pulse.axis)
    side = scene.plate.actual_size[axis]
    low, high = (0.0, side) if axis == 2 else (-side / 2, side / 2)
    if not low <= pulse.position < pulse.probes[0] < pulse.probes[1] <= high:
        why = f"must follow pulse.position in rising order between {low:.6g} and {high:.6g}"
        raise refuse("pulse.probes", pulse.probes, why)


def _check_free_prism(scene: Scene) -> None:
    plate = scene.plate
    if plate.shape != "rectangle":
        raise refuse("plate.shape", plate.shape, 'must be "rectangle" with [pulse]')
    if plate.perturbation:
        why = "must be 0 with [pulse]: waves are compared with those of a regular lattice"
        raise refuse("plate.perturbation", plate.perturbation, why)
    for key, value in (("velocity", plate.velocity), ("gravity", plate.gravity)):
        if value is not None:
            raise refuse(
                f"plate.{key}", value, "cannot be used with [pulse], which sets the motion"
            )
    for name, present in (
        ("disorder", scene.disorder),
        ("striker", scene.striker),
        ("clamp", scene.held),
        ("supports", scene.supports),
        ("floor", scene.floor),
        ("notch", scene.notch),
        ("load", scene.loads),
        ("start", scene.start),
        ("hole", scene.hole),
    ):
        if present:
            raise ValueError(
                f"table '[{name}]': cannot be used with [pulse], which needs a free, uniform prism"
            )


SCENARIOS = {
    "impact": ScenarioRules(),
    "tension": ScenarioRules(
        needs=("grips",), without=("striker", "clamp", "floor"), check=_check_tension
    ),
    "bend": ScenarioRules(needs=("striker", "supports"), check=_check_bend),
    "load": ScenarioRules(),
    "wave": ScenarioRules(needs=("pulse",), without=("contact",), check=_check_wave),
    "modes": ScenarioRules(
        without=("contact",), breaks=False, defaults={"solver": {"duration": NO_DURATION}}
    ),
}
"""The scenarios that ``scenario`` may name, in the order of messages."""


# --- plate and material ---------------------------------------------------------------------------


def _check_sides(scene: Scene) -> None:
    plate, spacing = scene.plate, scene.plate.spacing
    for axis, side, actual in zip("xy", plate.size, plate.actual_size, strict=False):
        if plate.angle or abs(actual - side) <= ROUNDING * side:
            continue
        if SCENARIOS[scene.scenario].breaks:
            refuse_coarse(scene)  # before sides are fitted to modules that are too coarse
        below = math.floor(side / spacing)
        fits = " or ".join(f"{n * spacing:.6g}" for n in (below, below + 1) if n > 0)
        why = f"side {axis} must be a whole number of modules of {spacing:.6g} m: {fits}"
        raise refuse("plate.size", plate.size, why)


def _check_motion(scene: Scene) -> None:
    plate = scene.plate
    for key, value in (("velocity", plate.velocity), ("gravity", plate.gravity)):
        if value is not None and plate.angle:
            why = "is for plate.angle = 0 only: its axes are those of the lattice"
            raise refuse(f"plate.{key}", value, why)


def bars_of(scene: Scene) -> Bars:
    """The bar families of a scene, without judging K_r."""
    plate, by_volume = scene.plate, strength_by_volume(scene)
    return bar_families(scene.material, plate.spacing, plate.stiffness, by_volume, plate.lattice)


def refuse_coarse(scene: Scene, name: str = "") -> Bars:
    """The scene's bar families, refused where modules are too coarse for the material.

    Args:
        name: of the scene's file, which opens the message.

    Raises:
        SceneError: with damage, K_r < 1 for a family (Eq. (12)).
    """
    plate, limit = scene.plate, scene.material.limit_strain
    where = f"{name}: " if name else ""
    bars = bars_of(scene)
    if not scene.material.damage:
        return bars
    for kind, family in zip(FAMILY_NAMES[plate.lattice], bars, strict=True):
        if family.ductility >= 1:
            continue
        if limit is not None:
            raise SceneError(
                f"{where}material.limit_strain = {limit}: must be at least the failure strain "
                f"eps_p = {_rounded_up(family.peak_strain)}"
            )
        largest = family.critical_length * plate.spacing / family.length
        modules = math.ceil(plate.size[2] / largest)
        metres = max(plate.size) > LARGE_SIDE
        raise SceneError(
            f"{where}plate.modules_through_thickness = {plate.modules_through_thickness}: "
            f"too coarse for {kind} bars to soften: K_r = {family.ductility:.3f} < 1 (Eq. 12); "
            f"take at least {modules} modules (an edge of {largest * 1e3:.4g} mm at most), or give "
            'material.fracture = "crack", with which a crack still costs about G_f, or '
            f"material.limit_strain >= {_rounded_up(family.peak_strain)}, with which bars "
            "dissipate more than G_f" + ("; plate.size is in metres" if metres else "")
        )
    return bars


def _rounded_up(strain: float) -> str:
    """A strain to five digits that is not below it: it may be copied into a scene."""
    text = f"{strain:.5g}"
    return text if float(text) >= strain else f"{strain * (1 + 5e-5):.5g}"


def _check_lattice(scene: Scene) -> None:
    plate, material = scene.plate, scene.material
    _check_ratio(scene)
    _check_tips(scene)
    if plate.lattice == "module":
        return
    if plate.stiffness != "volumetric" and material.poisson_ratio != QUARTER:
        why = 'must be 0.25 with plate.lattice = "cubic-26", or plate.stiffness = "volumetric"'
        raise refuse("material.poisson_ratio", material.poisson_ratio, why)
    for key, value, other in (
        ("material.fracture_areas", material.fracture_areas, "paper"),
        ("plate.stiffness", plate.stiffness, "as-printed"),
    ):
        if value == other:
            raise refuse(key, value, 'is for plate.lattice = "module" only')


def _check_tips(scene: Scene) -> None:
    """Refuse tip strains in a regular lattice, where cracks keep to its planes all the same."""
    criterion = scene.material.tip_criterion
    if criterion == "strain" and scene.plate.perturbation == 0:
        why = 'must be "release", unless plate.perturbation > 0; its constants are those of 0.07'
        raise refuse("material.tip_criterion", criterion, why)


def _check_ratio(scene: Scene) -> None:
    """Refuse a Poisson's ratio that the plate's stiffness cannot have."""
    nu, stiffness = scene.material.poisson_ratio, scene.plate.stiffness
    if stiffness != "volumetric" and nu == 0:
        why = (
            "must be greater than 0: at 0 the diagonal bars have no stiffness, and a lattice "
            "without them is a mechanism"
        )
        raise refuse("material.poisson_ratio", nu, why)
    if stiffness == "volumetric" and scene.material.damage and nu < LEAST_RATIO_OF_VOLUMES:
        why = (
            f"must be at least {LEAST_RATIO_OF_VOLUMES} where bars break, or above 0 with "
            'plate.stiffness = "equation-2": below it a broken bar gives energy to its modules'
        )
        raise refuse("material.poisson_ratio", nu, why)


def _check_disorder(scene: Scene) -> None:
    length = scene.disorder.correlation_length if scene.disorder is not None else 0.0
    if 0 < length < scene.plate.spacing:
        why = f"must be 0 (no correlation) or at least {scene.plate.spacing:.6g}, one module"
        raise refuse("disorder.correlation_length", length, why)


# --- rigid bodies ---------------------------------------------------------------------------------


def _check_clamp(scene: Scene) -> None:
    clamp = scene.clamp
    if clamp is None or clamp.kind == "free":
        return
    key = "inner_diameter" if clamp.kind == "rim" else "outer_diameter"
    diameter = getattr(clamp, key)
    width = scene.plate.diameter or scene.plate.width
    if diameter > width:
        why = f"must fit inside the plate, at most {width!r}"
        raise refuse(f"clamp.{key}", diameter, why)


def _check_contact(scene: Scene) -> None:
    contact = scene.contact
    if contact is not None and contact.fragments and not (scene.material.damage or scene.notch):
        why = "needs material.damage = true or a [[notch]], as nothing else makes pieces"
        raise refuse("contact.fragments", contact.fragments, why)
    held = scene.clamp is not None and scene.clamp.kind == "rings"
    if scene.lands_elastically and not (held or scene.strikers or scene.supports or scene.floor):
        why = 'needs a striker, a clamp of the kind "rings", supports or a floor to land on'
        raise refuse("contact.landing", scene.contact.landing, why)  # type: ignore[union-attr]


# --- time and machine -----------------------------------------------------------------------------


def _check_output(scene: Scene) -> None:
    end, output = scene.solver.duration, scene.output
    for key, limit in (("history_interval", MAX_SAMPLES), ("field_interval", MAX_FRAMES)):
        interval = getattr(output, key)
        if not interval:
            continue
        if interval > end:
            why = f"must be at most solver.duration = {end!r}"
            raise refuse(f"output.{key}", interval, why)
        if not end / interval <= limit:
            why = f"must be at least {end / limit:.6g}: a run has at most {limit} intervals"
            raise refuse(f"output.{key}", interval, why)
    if output.field_interval and output.field_interval < output.history_interval:
        why = f"must be at least output.history_interval = {output.history_interval!r}, or 0"
        raise refuse("output.field_interval", output.field_interval, why)
    nyquist = 0.5 / output.history_interval
    for cutoff in output.filter_frequencies:
        if cutoff >= nyquist:
            why = f"must be below {nyquist:.6g}, half of 1 / output.history_interval"
            raise refuse("output.filter_frequencies", cutoff, why)
    for time in output.image_times:
        if time > end:
            why = (
                f"must lie between 0 and solver.duration = {end!r}; for no snapshots give "
                '--set "output.image_times=[]"'
            )
            raise refuse("output.image_times", time, why)


def _check_vulkan(scene: Scene) -> None:
    solver, law = scene.solver, scene.material.law
    if (solver.arch, solver.precision, law) == ("vulkan", "f64", "exponential"):
        why = 'Vulkan has no exp in f64, use "bilinear" or solver.precision = "f32"'
        raise refuse("material.law", law, why)
    if solver.arch == "vulkan" and scene.material.damage and scene.material.fracture == "crack":
        why = 'must be "bar" on Vulkan, for which Taichi 1.7.4 cannot compile the rule for tips'
        raise refuse("material.fracture", "crack", why)


CHECKS: tuple[Callable[[Scene], None], ...] = (
    _check_sides,
    _check_lattice,
    _check_motion,
    _check_disorder,
    _check_clamp,
    check_strikers,
    _check_scenario,
    check_supports,
    _check_contact,
    _check_output,
    _check_vulkan,
    flaws.check_notches,
    flaws.check_holes,
    check_loads,
    check_start,
    check_probes,
)
"""All checks, in the order in which faults are reported."""
