"""Figures of a run with a pulse, and of the lattice's wave speeds over wavelength and direction."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.errors import DamagedFile
from taichi_ldem.model import waves
from taichi_ldem.output.loaded import LoadedRun
from taichi_ldem.scene import Material, Scene
from taichi_ldem.storage.history import read_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]
Rows = Iterable[Mapping[str, Any]]

POISSON_RATIOS = (0.20, 0.25, 0.30)
_SHORT = (8, 4)  # wavelengths in modules that are drawn with the long-wave limit
_LONG = 1000
POLARISATIONS = {"P": "longitudinal", "S1": "shear in the plane", "S2": "shear along [001]"}
_EXACT, _RUN = "C3", "C0"


def draw_pulse(figure: "Figure", run: LoadedRun) -> None:
    """Snapshots of the pulse along its axis, from profiles.csv, with the exact ones."""
    from taichi_ldem.scenarios.wave import PROFILES, Packet

    file = run.folder.path / "profiles.csv"
    table = read_table(file)
    packet = Packet(run.scene)
    times = np.unique(table["time_s"])
    if len(times) > PROFILES:
        raise DamagedFile(f"'{file}' has {len(times)} times, and a run writes {PROFILES} at most")
    fine = np.linspace(*packet.ends, 401)
    exact = packet.signal(fine, run.positive("time_step_s"), times)
    scale = np.abs(exact[0]).max()
    exact /= scale
    panels = np.atleast_1d(figure.subplots(len(times), 1, sharex=True, sharey=True))
    for axes, at, line in zip(panels, times, exact, strict=True):
        rows = {name: values[table["time_s"] == at] for name, values in table.items()}
        axes.plot(1e3 * fine, line, color=_EXACT, lw=2.5, alpha=0.5)
        axes.plot(1e3 * rows["position_m"], rows["displacement_m"] / scale, ".", color=_RUN, ms=5)
        for probe in packet.pulse.probes:
            axes.axvline(1e3 * probe, color="0.5", lw=0.9, ls=":")
        worst = np.abs(rows["displacement_m"] - rows["exact_m"]).max() / scale
        label = f"{1e6 * at:.3g} µs, run and exact differ by {worst:.0e} at most"
        axes.set_title(label, fontsize=11, loc="right", pad=3)
    panels[0].plot([], [], color=_EXACT, lw=2.5, alpha=0.5, label="exact waves of the lattice")
    panels[0].plot([], [], ".", color=_RUN, ms=5, label="run, planes of corner nodes")
    panels[0].plot([], [], color="0.5", lw=0.9, ls=":", label="probes")
    figure.suptitle(f"{packet.pulse.kind} pulse along {packet.pulse.axis}", fontsize=13)
    figure.supylabel("displacement over its maximum at t = 0 [-]", fontsize=13)
    panels[-1].set_xlabel(f"{packet.pulse.axis} [mm]")
    panels[-1].set_xlim(1e3 * fine[0], 1e3 * fine[-1])
    figure.legend(loc="outside lower center", ncols=3, fontsize=12)


def draw_dispersion(figure: "Figure", run: LoadedRun) -> None:
    """Phase speed over wavelength, between the probes and exact, and the error below."""
    scene, summary = run.scene, run.summary
    upper, lower = _two_panels(figure)
    rows, spacing = _measured(run), scene.plate.spacing
    step = run.positive("time_step_s")
    shortest = min((r["wavelength_modules"] for r in rows), default=4.0)
    modules = np.geomspace(200, 0.85 * shortest, 60)
    k = 2 * np.pi / (modules * spacing)
    for omega, style, label in _branches(scene, k):
        discrete = waves.discrete_frequency(omega, step)
        upper.plot(modules, discrete / k, style, label=label)
    name, speed = summary["long_wave_formula"], run.positive("long_wave_speed_m_s")
    upper.axhline(speed, color="0.4", lw=1, ls="--", label=f"continuum, {name} = {speed:.0f} m/s")
    if scene.pulse is not None and scene.pulse.kind == "bar":
        _rayleigh_love(upper, scene, k, modules, speed)
    measured = [r["measured_m_s"] for r in rows]
    at = [r["wavelength_modules"] for r in rows]
    upper.plot(at, measured, "o", color=_RUN, ms=8, label="run: phase between the probes")
    upper.set_ylim(0.93 * min(measured, default=speed), 1.02 * speed)
    lower.plot(at, [100 * r["error"] for r in rows], "o-", color=_RUN)
    figure.legend(loc="outside lower center", ncols=2, fontsize=11)


def _measured(run: LoadedRun) -> list[dict[str, float]]:
    """The summary's rows on dispersion; DamagedFile where they are no such rows."""
    rows = run.summary["dispersion"]
    names = {"wavelength_modules", "measured_m_s", "error"}
    for row in rows if isinstance(rows, list) else [rows]:
        whole = isinstance(row, dict) and names <= row.keys()
        if not whole or not all(type(row[name]) in (int, float) for name in names):
            raise DamagedFile(f"'{run.folder.summary_file}': dispersion is no list of measurements")
        if not 1 <= row["wavelength_modules"] <= _LONG:
            raise DamagedFile(f"'{run.folder.summary_file}': dispersion has an impossible length")
    return list(rows)


def _two_panels(figure: "Figure") -> tuple["Axes", "Axes"]:
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    upper.set_ylabel("phase speed [m/s]")
    lower.set(ylabel="error [%]", ylim=(-0.6, 0.6))
    lower.axhspan(-0.5, 0.5, color="C2", alpha=0.12, lw=0)
    lower.set_title("run over exact relation, less one; band: the target of 0.5 %", fontsize=12)
    _wavelength_axis(lower)
    return upper, lower


def _branches(scene: Scene, k: Array) -> list[tuple[Array, str, str]]:
    """Frequencies over k (falling wavelengths), line style and name of the lattice's branches."""
    assert scene.pulse is not None
    from taichi_ldem.scenarios.wave import Packet

    packet = Packet(scene)
    if scene.pulse.kind == "bar":
        return [(packet.guide.longitudinal(k)[0], "C3-", "exact, bar of the lattice")]
    direction = np.eye(3)[packet.axis]
    omega = packet.medium.straight(k[:, None] * direction, np.eye(3)[packet.polarisation])[0]
    return [(omega, "C3-", "exact, lattice (with the run's time step)")]


def _rayleigh_love(axes: "Axes", scene: Scene, k: Array, modules: Array, speed: float) -> None:
    assert scene.pulse is not None
    sides = [
        s for a, s in zip("xyz", scene.plate.actual_size, strict=True) if a != scene.pulse.axis
    ]
    polar = (sides[0] ** 2 + sides[1] ** 2) / 12  # squared radius of gyration about the axis
    love = speed / np.sqrt(1 + scene.material.poisson_ratio**2 * polar * k**2)
    axes.plot(modules, love, "k:", lw=1.3, label="continuum, Rayleigh-Love rod")


def draw_directions(
    figure: "Figure", scene: Scene, rows: Rows, directions: Mapping[str, Any]
) -> None:
    """Phase speed over wavelength along some directions, exact and measured; P, S, and errors."""
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(3, 3, 2))
    plate = scene.plate
    medium = waves.bulk(scene.material, plate.spacing, plate.stiffness, plate.lattice)
    modules = np.geomspace(60, 3.7, 120)
    k = 2 * np.pi / (modules * scene.plate.spacing)
    rows = list(rows)
    for number, (name, vector) in enumerate(directions.items()):
        style = {"color": f"C{number}", "mfc": "none", "ms": 7}
        mark = "osD^"[number]
        unit = np.array(vector) / np.linalg.norm(vector)
        for branch in medium.phase_velocities(k[:, None] * unit).T:
            panel = panels[0] if branch[0] > 1.3 * medium.fastest / np.sqrt(3) else panels[1]
            panel.plot(modules, branch, color=style["color"], lw=1.3)
        for row in (r for r in rows if r["direction"] == name):
            at = row["wavelength_modules"]
            panel = panels[0] if row["polarisation"] == "P" else panels[1]
            panel.plot(at, row["measured_continuous_m_s"], mark, **style)
            panels[2].plot(at, 100 * abs(row["error"]), mark, **style)
        panels[0].plot([], [], mark, **style, label=f"{name}, run")
    panels[0].plot([], [], color="0.4", lw=1.3, label="exact relation")
    for panel, speed, name in zip(panels, isotropic_speeds(scene.material), "PS", strict=False):
        panel.axhline(speed, color="0.5", ls="--", lw=1)
        panel.set_title(f"{name} waves; dashed: continuum, {speed:.0f} m/s", fontsize=12)
        panel.set_ylabel("phase speed [m/s]")
    panels[2].axhline(0.5, color="C2", lw=1.5)
    panels[2].set_title(
        "difference of run and exact relation; line: the target, 0.5 %", fontsize=12
    )
    panels[2].set(ylabel="|error| [%]", yscale="log", ylim=(1e-10, 10))
    _wavelength_axis(panels[2])
    panels[2].set_xlim(modules[-1], modules[0])
    figure.legend(loc="outside lower center", ncols=5, fontsize=12)


def _wavelength_axis(axes: "Axes") -> None:
    from matplotlib.ticker import NullLocator, ScalarFormatter

    axes.set(xlabel="wavelength [module edges]", xscale="log")
    axes.xaxis.set_major_formatter(ScalarFormatter())
    axes.set_xticks([4, 5, 6, 8, 10, 12, 15, 20, 30, 40, 60, 100, 200])
    axes.xaxis.set_minor_locator(NullLocator())


def speeds_over_angle(
    material: Material,
    spacing: float,
    angle: Array,
    modules: float,
    variant: str = "equation-2",
    lattice: str = "module",
) -> dict[str, Array]:
    """Phase speeds (m/s) in the (001) plane by polarisation, at a wavelength in module edges.

    Args:
        angle: to [100], radians, (n,).
    """
    medium = waves.bulk(material, spacing, variant, lattice)
    still = np.zeros_like(angle)
    along = np.stack([np.cos(angle), np.sin(angle), still], axis=-1)
    across = np.stack([-np.sin(angle), np.cos(angle), still], axis=-1)
    k = 2 * np.pi / (modules * spacing)
    wanted = {"P": along, "S1": across, "S2": np.broadcast_to([0.0, 0.0, 1.0], along.shape)}
    return {
        name: np.array([medium.branch(k * a, u)[0] for a, u in zip(along, shape, strict=True)]) / k
        for name, shape in wanted.items()
    }


def draw_anisotropy(figure: "Figure", scene: Scene, points: Rows = ()) -> None:
    """Wave speeds in the (001) plane over the isotropic solid's.

    Bars of the paper's lattice are isotropic at nu = 0.25 only, so three Poisson's ratios are drawn
    for them. Otherwise the scene's is.

    Args:
        points: measured (rows of ``studies.wave_speeds``); long waves are those of 40 modules.
    """
    points = [p for p in points if "degrees" in p["direction"]]
    angle, plate = np.radians(np.linspace(0, 90, 91)), scene.plate
    bars_alone = plate.lattice == "module" and plate.stiffness != "volumetric"
    ratios = POISSON_RATIOS if bars_alone else (scene.material.poisson_ratio,)
    size = (len(POLARISATIONS), len(ratios))
    panels = figure.subplots(*size, sharex=True, sharey="row", squeeze=False)
    for column, nu in zip(panels.T, ratios, strict=True):
        material = scene.material.model_copy(update={"poisson_ratio": nu})
        c_p, c_s = isotropic_speeds(material)
        for modules, style in zip((_LONG, *_SHORT), ("-", "--", ":"), strict=True):
            speeds = speeds_over_angle(
                material, plate.spacing, angle, modules, plate.stiffness, plate.lattice
            )
            for axes, (name, speed) in zip(column, speeds.items(), strict=True):
                whole = c_p if name == "P" else c_s
                label = "long waves" if modules == _LONG else f"wavelength {modules} L"
                axes.plot(np.degrees(angle), speed / whole, style, color=_EXACT, label=label)
                mine = [
                    p
                    for p in points
                    if (p["poisson_ratio"], p["polarisation"]) == (nu, name)
                    and min(p["wavelength_modules"], 40) == min(modules, 40)
                ]
                mark = {_LONG: "o", 8: "s", 4: "D"}[modules]
                _mark(axes, mine, mark, f"run, wavelength {min(modules, 40)} L")
        column[0].set_title(f"nu = {nu:.2f}", fontsize=13)
        column[-1].set_xlabel("angle to [100] [degrees]")
        column[-1].set_xticks([0, 15, 30, 45, 60, 75, 90])
    for axes, name in zip(panels[:, 0], POLARISATIONS.values(), strict=True):
        axes.set_ylabel(f"{name}\nover isotropic [-]", fontsize=12)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.suptitle("Phase speed in the (001) plane over that of the isotropic solid", fontsize=14)
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=12)


def _mark(axes: "Axes", points: list[Mapping[str, Any]], mark: str, label: str) -> None:
    if points:
        at = [p["angle_deg"] for p in points]
        value = [p["over_isotropic"] for p in points]
        axes.plot(at, value, mark, color=_RUN, ms=6, mfc="none", label=label)


def isotropic_speeds(material: Material) -> tuple[float, float]:
    """P and S speeds of the isotropic solid of E, nu and rho, m/s."""
    e, nu, rho = material.youngs_modulus, material.poisson_ratio, material.density
    shear = e / (2 * (1 + nu))
    return (
        float(np.sqrt(2 * shear * (1 - nu) / (1 - 2 * nu) / rho)),
        float(np.sqrt(shear / rho)),
    )
