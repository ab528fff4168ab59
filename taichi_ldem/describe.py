"""What a scene's inputs imply, and what was built for it: the text of ``ldem info``."""

from rich.console import Group
from rich.table import Table
from rich.text import Text

from taichi_ldem import material as mat
from taichi_ldem.disorder import cv_from_shape, shape_of, varies
from taichi_ldem.scene import DISORDERED, Scene

RESOLVED = 4
"""Modules that a correlation length should span."""


def implied(scene: Scene) -> dict[str, str]:
    """What follows from the inputs, without building anything: name -> value with unit."""
    plate, m = scene.plate, scene.material
    bars = mat.bar_families(m, plate.spacing, plate.stiffness)
    nx, ny, nz = plate.modules
    x, y, z = (1e3 * side for side in plate.actual_size)
    rows = {
        "modules": f"{nx} x {ny} x {nz}, L = {1e3 * plate.spacing:.4f} mm",
        "size": f"{x:.2f} x {y:.2f} x {z:.2f} mm",
        "EA longitudinal, diagonal": f"{bars.longitudinal.axial_stiffness:.2f}, "
        f"{bars.diagonal.axial_stiffness:.2f} N",
    }
    c11, c12, c44 = mat.elastic_constants(m.youngs_modulus, m.poisson_ratio, plate.stiffness)
    rows["C11, C12, C44"] = f"{c11 / 1e9:.3f}, {c12 / 1e9:.3f}, {c44 / 1e9:.3f} GPa"
    if m.damage and m.fracture_energy is not None:
        rows |= _fracture(scene, bars, m.fracture_energy)
    return rows


def _fracture(scene: Scene, bars: mat.Bars, fracture_energy: float) -> dict[str, str]:
    m = scene.material
    families = (bars.longitudinal, bars.diagonal)
    eps_p = bars.longitudinal.peak_strain

    def pair(values: list[float], form: str = ".4f") -> str:
        return ", ".join(f"{value:{form}}" for value in values)

    # Eq. (9): R_f = eps_p sqrt(E / G_f), so 1 / R_f^2 = G_f / (E eps_p^2)
    length = fracture_energy / (m.youngs_modulus * eps_p**2)
    rows = {
        "peak strain eps_p": f"{eps_p:.5f}",
        "strength E eps_p": f"{1e-6 * m.youngs_modulus * eps_p:.1f} MPa",
        "limit strain eps_r (long., diag.)": pair([f.limit_strain for f in families], ".5f"),
        "K_r (long., diag.)": pair([f.ductility for f in families], ".3f"),
        "L_cr (long., diag.)": pair([1e3 * f.critical_length for f in families]) + " mm",
        "characteristic length 1/R_f^2": f"{1e3 * length:.3f} mm",
        "fracture energy G_f": f"{fracture_energy:.0f} J/m2",
    }
    if m.limit_strain is not None:
        excess = [f.energy_to_break / (fracture_energy * f.fracture_area) - 1 for f in families]
        rows["a broken bar dissipates"] = (
            pair([100 * e for e in excess], "+.1f") + " % against G_f A_f (given limit_strain)"
        )
    return rows


def warnings(scene: Scene) -> list[str]:
    """Remarks that a user should read before trusting a run, a line each."""
    plate, m = scene.plate, scene.material
    lines = []
    c11, c12, c44 = mat.elastic_constants(m.youngs_modulus, m.poisson_ratio, plate.stiffness)
    anisotropy = 2 * c44 / (c11 - c12)
    if not 0.2 <= m.poisson_ratio <= 0.3 or plate.stiffness == "as-printed":
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
    if scene.solver.allow_unstable:
        lines.append(
            "solver.allow_unstable = true: the time step is not held below the critical one"
        )
    return lines


def left_out(scene: Scene) -> list[str]:
    """Features that the scene does not name, and why: neither allocated nor compiled."""
    uneven = {name for name in DISORDERED if varies(scene, name)}
    absent = {
        "bar history and broken-bar record (material.damage = false)": not scene.material.damage,
        "damping (solver.damping = 0)": scene.solver.damping == 0,
        "removed bars (no [[notch]])": not scene.notch,
        "strength of every bar (no disorder of fracture_energy or youngs_modulus, or no damage)": (
            not scene.material.damage or not uneven - {"density"}
        ),
        "modulus of every bar (no disorder.youngs_modulus_cv)": "youngs_modulus" not in uneven,
        "mass of every node (no disorder.density_cv)": "density" not in uneven,
        "striker contact (no [striker])": scene.striker is None,
        "clamp contact (no [clamp], or free)": not scene.held,
        "grips and gauge (no [grips])": scene.grips is None,
        "support contact (no [supports])": scene.supports is None,
    }
    return [name for name, missing in absent.items() if missing]


def _disorder(scene: Scene, drawn: dict[str, tuple[float, float]]) -> dict[str, str]:
    """Mean and CV of the fields that were drawn, beside what was asked for."""
    rows = {}
    units = {"fracture_energy": (1.0, "J/m2"), "youngs_modulus": (1e-9, "GPa")}
    for name, (mean, cv) in drawn.items():
        shape = shape_of(scene.disorder, name)
        assert shape is not None
        scale, unit = units.get(name, (1.0, "kg/m3"))
        rows[f"drawn {name}"] = (
            f"mean {scale * mean * getattr(scene.material, name):.5g} {unit}, CV {100 * cv:.2f} % "
            f"(Weibull shape {shape:.4g}: {100 * cv_from_shape(shape):.2f} %)"
        )
    return rows


def describe(scene: Scene) -> Group:
    """Everything that ``ldem info`` prints; builds the simulation for its true numbers.

    Raises:
        SceneError: as building the simulation does.
    """
    from taichi_ldem import backend

    backend.start(scene.solver)
    from taichi_ldem.simulation import Simulation

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
    rows |= _disorder(scene, simulation.drawn)
    if scene.scenario == "modes":  # does not step in time
        del rows["time step"], rows["steps"]
    table = Table("quantity", "value", title="what the inputs imply")
    for name, value in rows.items():
        table.add_row(name, value)
    memory = Table("field", "MB", title="memory")
    sizes = simulation.field_bytes()
    for name, size in sizes.items():
        memory.add_row(name, f"{size / 1e6:.2f}")
    memory.add_row("all", f"{sum(sizes.values()) / 1e6:.2f}")
    parts: list[Table | Text] = [table, memory]
    parts += [Text(f"left out: {line}") for line in left_out(scene)]
    parts += [Text(f"note: {line}") for line in warnings(scene)]
    return Group(*parts)
