"""The text of ``ldem info``: what a scene's inputs imply, and what is built for it."""

import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Group
from rich.table import Table
from rich.text import Text

from taichi_ldem.model import crack_cost
from taichi_ldem.model import material as mat
from taichi_ldem.model.disorder import cv_from_shape, shape_of
from taichi_ldem.scenarios import describe_cuts, leave_out, strikers_in_words
from taichi_ldem.scenarios.loads_in_words import loads_in_words
from taichi_ldem.scenarios.resolution import unresolved
from taichi_ldem.scene import Scene
from taichi_ldem.scene.weibull import strength_by_volume
from taichi_ldem.solver.contact import BODIES, CONTACTS, FRAGMENTS
from taichi_ldem.solver.features import Features
from taichi_ldem.solver.memory import field_bytes, refuse_too_large

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

RESOLVED = 4
"""Modules that a correlation length should span."""

LARGE_STRAIN = 0.2
"""Peak strain that no brittle material exceeds."""

FAST = 0.1
"""Share of the speed of longitudinal waves above which a striker's speed is most likely a slip."""

MANY_STEPS = 5e6
"""Number of steps above which a remark is made; the paper's test has a fortieth of it."""

LIGHTEST, HEAVIEST = 10.0, 25e3
"""Densities of solids, from foam to osmium, kg/m3."""

SOFTEST = 1e6
"""Young's modulus below which MPa or GPa are more likely, Pa: rubber is stiffer."""

SAFE_WITH_PIECES = 0.7
"""Share of the critical time step above which pieces that touch are remarked on."""

ROUNDED = 1e-4
"""Relative change of a side by rounding to whole modules above which a remark is made."""

LEGEND = (
    "EA: axial stiffness of a bar; long., diag.: bars along the edges of a module and from its "
    "corners to its centre"
)
LEGEND_OF_DAMAGE = (
    "eps_p: strain at which a bar begins to soften; eps_r: at which it is broken; K_r = eps_r / "
    "eps_p, must not be below 1; L_cr: critical module edge, where K_r is 1; R_f: failure factor"
)


def implied(scene: Scene) -> dict[str, str]:
    """Quantities that follow from the inputs without building anything: name -> value with unit."""
    plate, m = scene.plate, scene.material
    bars = mat.bars_of(scene)
    names = mat.FAMILY_NAMES[plate.lattice]
    nx, ny, nz = plate.modules
    x, y, z = (1e3 * side for side in plate.actual_size)
    rows = {
        "modules": f"{nx} x {ny} x {nz}, L = {1e3 * plate.spacing:.4f} mm",
        "size": f"{x:.2f} x {y:.2f} x {z:.2f} mm",
        f"EA {', '.join(names)}": ", ".join(f"{f.axial_stiffness:.2f}" for f in bars) + " N",
    }
    c11, c12, c44 = mat.elastic_constants(m.youngs_modulus, m.poisson_ratio, plate.stiffness)
    rows["C11, C12, C44"] = f"{c11 / 1e9:.3f}, {c12 / 1e9:.3f}, {c44 / 1e9:.3f} GPa"
    if m.damage and m.fracture_energy is not None:
        rows |= _fracture(scene, bars, m.fracture_energy)
    return rows


def _fracture(scene: Scene, bars: mat.Bars, fracture_energy: float) -> dict[str, str]:
    m = scene.material
    families, eps_p = tuple(bars), bars[0].peak_strain
    kinds = "long., diag." if scene.plate.lattice == "module" else "edge, face, cube diag."

    def pair(values: list[float], form: str = ".4f") -> str:
        return ", ".join(f"{value:{form}}" for value in values)

    length = mat.characteristic_length(m)
    rows = {
        "peak strain eps_p": f"{eps_p:.5f}",
        "strength E eps_p": f"{1e-6 * m.youngs_modulus * eps_p:.1f} MPa",
        f"limit strain eps_r ({kinds})": pair([f.limit_strain for f in families], ".5f"),
        f"K_r ({kinds})": pair([f.ductility for f in families], ".3f"),
        f"L_cr ({kinds})": pair([1e3 * f.critical_length for f in families]) + " mm",
        "characteristic length 1/R_f^2": f"{1e3 * length:.3f} mm",
        "fracture energy G_f": f"{fracture_energy:.0f} J/m2",
    }
    if (cost := crack_cost.words(scene)) is not None:
        rows["a crack costs"] = cost
    if m.limit_strain is not None:
        excess = [f.energy_to_break / (fracture_energy * f.fracture_area) - 1 for f in families]
        rows["a broken bar dissipates"] = (
            pair([100 * e for e in excess], "+.1f") + " % against G_f A_f (given limit_strain)"
        )
    return rows


def warnings(scene: Scene, steps: int | None = None) -> list[str]:
    """Remarks that a user should read before trusting a run, a line each.

    Args:
        steps: number of steps of the run; None: it is estimated.
    """
    plate, m = scene.plate, scene.material
    lines = [*_slips(scene, steps), *unresolved(scene), *describe_cuts.remarks(scene)]
    lines += strikers_in_words.remarks(scene)
    c11, c12, c44 = mat.elastic_constants(m.youngs_modulus, m.poisson_ratio, plate.stiffness)
    anisotropy = 2 * c44 / (c11 - c12)
    rough = not 0.2 <= m.poisson_ratio <= 0.3 and plate.stiffness != "volumetric"
    if rough or plate.stiffness == "as-printed":
        lines.append(
            f"the lattice is not isotropic: C11 = {c11 / 1e9:.3f}, C12 = {c12 / 1e9:.3f}, C44 = "
            f"{c44 / 1e9:.3f} GPa, 2 C44 / (C11 - C12) = {anisotropy:.2f}"
        )
    if not plate.surface_weights:
        lines.append(
            "full bars on the faces (plate.surface_weights = false): stiffer and tougher faces, "
            "as the paper's model most likely had"
        )
    length = scene.disorder.correlation_length if scene.disorder is not None else 0.0
    if 0 < length < RESOLVED * plate.spacing:
        lines.append(
            f"disorder.correlation_length is {length / plate.spacing:.2g} modules: below "
            f"{RESOLVED} the statistics of strength depend on the module size"
        )
    if plate.perturbation:
        lines.append(
            "plate.perturbation makes the lattice softer than these constants, by about its square "
            "(docs/disorder.md)"
        )
    if FRAGMENTS.table(scene) is not None and scene.solver.safety > SAFE_WITH_PIECES:
        lines.append(
            f"solver.safety = {scene.solver.safety:g}: pieces that touch raise the highest "
            f"frequency, take at most {SAFE_WITH_PIECES:g} (docs/fragment-contact.md)"
        )
    if scene.solver.allow_unstable:
        lines.append("solver.allow_unstable = true: the time step may be above the critical one")
    return lines


def _slips(scene: Scene, steps: float | None) -> list[str]:
    """Remarks on numbers that are possible but unusual, most likely in the wrong unit."""
    plate, m = scene.plate, scene.material
    lines = []
    for number, side in enumerate(plate.size):
        if side > mat.LARGE_SIDE:
            lines.append(
                f"plate.size[{number}] = {side:g} is in metres; if millimetres were meant, it "
                f"must be {side / 1000:g}"
            )
    if not plate.angle and any(
        abs(actual - side) > ROUNDED * side
        for side, actual in zip(plate.size, plate.actual_size, strict=True)
    ):
        asked, built = (
            " x ".join(f"{1e3 * side:.2f}" for side in sides[:2])
            for sides in (plate.size, plate.actual_size)
        )
        lines.append(
            f"plate.size: {asked} mm are asked for, {built} mm are built, in whole modules of "
            f"{1e3 * plate.spacing:.4g} mm"
        )
    if m.youngs_modulus < SOFTEST:
        lines.append(
            f"material.youngs_modulus = {m.youngs_modulus:g} is in Pa and softer than rubber; were "
            "MPa or GPa meant?"
        )
    if not LIGHTEST <= m.density <= HEAVIEST:
        lines.append(f"material.density = {m.density:g} is in kg/m3; no solid has this density")
    if m.damage and (strain := mat.failure_strain(m)) > LARGE_STRAIN:
        lines.append(
            f"the peak strain eps_p is {strain:.3g}, more than any brittle material's; are "
            "youngs_modulus in Pa and fracture_energy in J/m2?"
        )
    lines += _fast(scene)
    steps = _steps(scene) if steps is None else steps
    if scene.scenario != "modes" and steps > MANY_STEPS:
        lines.append(
            f"solver.duration = {scene.solver.duration:g} is in seconds and takes about "
            f"{steps / 1e6:.3g} million steps"
        )
    return lines


def _fast(scene: Scene) -> list[str]:
    """Remarks on strikers whose speed is not far below that of waves."""
    plate, m, lines = scene.plate, scene.material, []
    stiffness = mat.elastic_constants(m.youngs_modulus, m.poisson_ratio, plate.stiffness)[0]
    wave = math.sqrt(stiffness / m.density)
    for number, striker in enumerate(scene.strikers):
        if striker.speed > FAST * wave:
            key = "striker" if len(scene.strikers) == 1 else f"striker[{number}]"
            lines.append(
                f"{key}.velocity = {striker.speed:g} is in m/s: {striker.speed / wave:.2g} "
                f"of the speed of longitudinal waves ({wave:.0f} m/s)"
            )
    return lines


def _steps(scene: Scene) -> float:
    """Estimate of the number of steps from the critical time step of the infinite lattice."""
    from taichi_ldem.model.waves import bulk

    solver, plate = scene.solver, scene.plate
    if solver.time_step != "auto":
        return solver.duration / float(solver.time_step)
    critical = (
        2 / bulk(scene.material, plate.spacing, plate.stiffness, plate.lattice).highest_frequency
    )
    return solver.duration / min(solver.safety * critical, scene.output.history_interval)


def left_out(scene: Scene) -> list[str]:
    """What the scene does not have, and why: neither allocated nor compiled."""
    contacts = [c.absent for c in CONTACTS if c.absent and c.table(scene) is None]
    if not any(notch.time for notch in scene.notch):
        contacts.append("notches that open during the run (no notch.time)")
    smooth = [line for body in BODIES if (line := body.without_friction(scene))]
    absent = {
        "motion and strain at the start (no [start])": scene.start is None,
        "probes (no [[probe]])": not scene.probes,
    }
    without = [line for line, is_absent in absent.items() if is_absent]
    return [*Features.of(scene).left_out(), *contacts, *without, *smooth]


def _disorder(scene: Scene, drawn: dict[str, tuple[float, float]]) -> dict[str, str]:
    """Mean and CV of the fields that were drawn, and those that the scene asks for."""
    rows = {}
    units = {"fracture_energy": (1.0, "J/m2"), "youngs_modulus": (1e-9, "GPa")}
    m = scene.material
    for name, (mean, cv) in drawn.items():
        shape = shape_of(scene.disorder, name)
        assert shape is not None
        if name == "strength":
            given, unit = 1e-6 * m.youngs_modulus * _mean_peak_strain(scene), "MPa"
        else:
            scale, unit = units.get(name, (1.0, "kg/m3"))
            given = scale * getattr(m, name)
        rows[f"drawn {name}"] = (
            f"mean {mean * given:.5g} {unit}, CV {100 * cv:.2f} % "
            f"(Weibull shape {shape:.4g}: {100 * cv_from_shape(shape):.2f} %)"
        )
    return rows


def _mean_peak_strain(scene: Scene) -> float:
    """Mean eps_p of the bars."""
    return mat.failure_strain(scene.material) * strength_by_volume(scene)


def _takers(simulation: "Simulation") -> str:
    """Who takes the steps on the CPU: one thread, or all."""
    if simulation.alone:
        return "one thread, with its contact, many steps in one launch"
    strips = simulation.dynamics.layout.strips
    return f"all threads, in {strips} strips of rows"


def _against_everything(scene: Scene, simulation: "Simulation", measured: bool) -> Table:
    """Fields, bytes and kernels of the scene, and of its lattice with all features switched on.

    Args:
        measured: add milliseconds a step, measured in processes of their own, one at a time.
    """
    full = leave_out.everything(scene)
    table = Table("", "this scene", "everything on", "share", title="what is left out saves")
    cost = leave_out.cost(simulation)
    if measured:
        with tempfile.TemporaryDirectory() as folder:
            costs = leave_out.compare({"own": scene, "all": full}, Path(folder), 3)
        for name in ("fields", "kernels"):
            table.add_row(name, *(str(getattr(costs[which], name)) for which in ("own", "all")))
        rows = (("MB", "bytes", 1e-6), ("ms a step", "ms", 1.0))
        for name, value, scale in rows:
            own, whole = (getattr(costs[which], value) for which in ("own", "all"))
            texts = [f"{scale * number:.3g}" for number in (own, whole)]
            table.add_row(name, *texts, f"{100 * own / whole:.0f} %")
        return table
    own, whole = field_bytes(scene), field_bytes(full)
    texts = [f"{1e-6 * number:.2f}" for number in (own, whole)]
    table.add_row("MB of nodes and bars", *texts, f"{100 * own / whole:.0f} %")
    table.add_row("kernels", str(cost.kernels), str(leave_out.kernels_of_everything(simulation)))
    return table


def describe(scene: Scene, measured: bool = False, fields: bool = False) -> Group:
    """Everything that ``ldem info`` prints; builds the simulation for its true numbers.

    Args:
        measured: add the time of a step, with and without all other features.
        fields: add the memory of every field.

    Raises:
        SceneError: the simulation cannot be built.
    """
    from taichi_ldem.solver import backend

    refuse_too_large(leave_out.everything(scene) if measured else scene)
    backend.start(scene.solver)
    from taichi_ldem.solver.simulation import Simulation

    simulation = Simulation(scene)
    lattice = simulation.dynamics.lattice
    rows = implied(scene) | {
        "bars, nodes": f"{lattice.bars:,}, {lattice.nodes:,}",
        "mass": f"{1e3 * scene.material.density * lattice.volume:.3f} g",
        "critical time step": f"{simulation.critical_time_step:.4g} s",
        "time step": f"{simulation.time_step:.4g} s "
        f"({simulation.time_step / simulation.critical_time_step:.2f} of the critical one)",
        "steps": f"{simulation.steps:,}",
    }
    sizes = simulation.field_bytes()
    rows |= strikers_in_words.rows(scene)
    rows |= loads_in_words(simulation)
    rows |= describe_cuts.rows(scene, lattice)
    rows |= _disorder(scene, simulation.drawn)
    if scene.scenario == "modes":  # such a scene is not stepped in time
        del rows["time step"], rows["steps"]
    else:
        expected = simulation.measure_step() * simulation.steps
        rows["time to compute"] = f"about {expected:.0f} s, as busy as the machine is"
        if scene.solver.arch == "cpu":
            rows["a step is taken by"] = _takers(simulation)
    rows["memory of all fields"] = f"{sum(sizes.values()) / 1e6:.2f} MB"
    table = Table("quantity", "value", title="what the inputs imply")
    for name, value in rows.items():
        table.add_row(name, value)
    parts: list[Table | Text] = [table, Text(LEGEND)]
    if scene.material.damage:
        parts.append(Text(LEGEND_OF_DAMAGE))
    if fields:
        memory = Table("field", "MB", title="memory")
        for name, size in sizes.items():
            memory.add_row(name, f"{size / 1e6:.2f}")
        parts.append(memory)
    if not scene.plate.angle:  # no other scenario cuts a plate at an angle
        parts.append(_against_everything(scene, simulation, measured))
    parts.append(Text(f"kernels: {', '.join(leave_out.kernels(simulation))}"))
    parts += [Text(f"left out: {line}") for line in left_out(scene)]
    parts += [Text(f"note: {line}") for line in warnings(scene, simulation.steps)]
    return Group(*parts)
