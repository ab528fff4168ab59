"""Figures of a run from its run folder: forces, energies, stress over strain, crack map.

Where a scene is the paper's falling-weight test, the paper's and the experiments' values stand
beside the run's own (its Figs. 5, 11 and 12 and the text of Sections 3 and 5).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.analysis.paper import P1_N, P2_N, T1_S, T2_LDEM_S, T2_S, V_MAX_S, is_papers_test
from taichi_ldem.analysis.signals import SMOOTHING_WINDOW, low_pass, smooth_force
from taichi_ldem.model.lattice import dumbbell_half_width
from taichi_ldem.scene import Plate, Scene, load_scene
from taichi_ldem.storage.store import RunFolder, read_broken_bars, read_fields, read_times

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from taichi_ldem.analysis.cracks import Cracks

Series = NDArray[np.float64]

_MS = 1e3
_MM = 1e3
STYLE: dict[Any, Any] = {
    "font.size": 13,
    "lines.linewidth": 1.8,
    "axes.grid": True,
    "grid.color": "0.9",
    "axes.axisbelow": True,
    "legend.frameon": False,
}

_E_PA, _STRENGTH_PA, _SCATTER = 3.35e9, 75e6, 0.15  # its tension tests, Section 3.2
RING_SIGN = ", positive upwards"
_BEAM_WINDOW = 60e-6  # smooths the swinging of a beam of the paper's size between its contacts


@dataclass(frozen=True)
class _Run:
    """What a figure is drawn from."""

    folder: RunFolder
    scene: Scene
    history: Mapping[str, Series]
    summary: Mapping[str, Any]

    @property
    def time_ms(self) -> Series:
        return _MS * self.history["time_s"]

    @property
    def is_papers_test(self) -> bool:
        """Whether the scene has the plate, striker and speed of the paper's test."""
        return is_papers_test(self.scene)

    @cached_property
    def cracks(self) -> Cracks | None:
        """Its cracks, measured; None where no bar broke."""
        from taichi_ldem.scenarios.measure import measure_run

        return measure_run(self.folder)

    @property
    def is_beam(self) -> bool:
        """Whether it is a beam on supports, to be seen from the side."""
        return self.scene.supports is not None

    @property
    def window(self) -> float:
        """Over which forces are averaged, s."""
        return _BEAM_WINDOW if self.is_beam else SMOOTHING_WINDOW

    def number(self, key: str) -> float | None:
        """A number of the summary, None where the run has none."""
        value = self.summary.get(key)
        return float(value) if isinstance(value, (int, float)) else None


def plot_run(folder: RunFolder) -> list[Path]:
    """Draw the figures of `_FIGURES` into the run folder, one PNG each.

    A beam on supports has `force_displacement.png` besides, and its map is from the side. A figure
    that the run has no data for is left out.

    Returns:
        The pictures written.

    Raises:
        SceneError: a file of the run cannot be read.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    scene = load_scene(folder.scene_file)
    run = _Run(folder, scene, folder.read_history(), folder.read_summary())
    written = []
    for name, size, needs, draw in _FIGURES:
        if not needs(run):
            continue
        with rc_context(STYLE):
            figure = Figure(figsize=size, dpi=150, layout="constrained")
            FigureCanvasAgg(figure)
            draw(figure, run)
            written.append(folder.path / f"{name}.png")
            figure.savefig(written[-1], metadata=folder.picture_metadata())
    return written


def _has(column: str) -> Callable[[_Run], bool]:
    return lambda run: len(run.history.get(column, ())) > 1


def _has_section(run: _Run) -> bool:
    return len(run.history.get("gauge_strain", ())) > 1 and "net_section_m2" in run.summary


def _has_cracks(run: _Run) -> bool:
    return run.scene.material.damage and run.folder.fields_file.is_file()


def _has_pulse(run: _Run) -> bool:
    return run.scene.pulse is not None and "dispersion" in run.summary


def _of_pulse(name: str) -> _Draw:
    def draw(figure: Figure, run: _Run) -> None:
        from taichi_ldem.output.figures import wave as plots_wave

        getattr(plots_wave, f"draw_{name}")(figure, run.folder.path, run.scene, run.summary)

    return draw


def _has_measured_cracks(run: _Run) -> bool:
    return run.scene.scenario == "impact" and run.cracks is not None


def _has_growth(run: _Run) -> bool:
    return len(run.history["time_s"]) > 1 and _has_measured_cracks(run)


def _draw_force(figure: Figure, run: _Run) -> None:
    axes = figure.add_subplot(xlabel="time [ms]", ylabel="force [N]")
    time, force = run.history["time_s"], run.history["striker_force_n"]
    smooth = smooth_force(time, force, run.window)
    average = f"mean over {_MS * run.window:g} ms"
    axes.plot(run.time_ms, force, color="0.75", linewidth=0.6, label="striker, as sampled")
    axes.plot(run.time_ms, smooth, color="C0", linewidth=2.4, label=f"striker, {average}")
    for number, cutoff in enumerate(run.scene.output.filter_frequencies):
        filtered = low_pass(time, force, cutoff, run.number("first_peak_time_s"))
        label = f"striker, low-pass at {cutoff / 1e3:g} kHz after $t_1$"
        axes.plot(run.time_ms, filtered, f"C{(1, 4, 5, 6)[number % 4]}", linewidth=2.0, label=label)
    shown = [force if run.is_beam else smooth]  # a beam swings rather than rattles
    for name in ("ring", "support"):
        if f"{name}_force_n" in run.history:
            other = smooth_force(time, run.history[f"{name}_force_n"], run.window)
            label = f"{name}s, {average}{RING_SIGN if name == 'ring' else ''}"
            axes.plot(run.time_ms, other, color="C2", lw=1.0, label=label)
            shown.append(other)
    axes.axhline(0.0, color="0.4", linewidth=0.8)
    _mark_peaks(axes, run)
    _mark_times(axes, run, "force")
    if run.is_papers_test:
        _mark_papers_force(axes)
        shown.append(np.array(P2_N))
    _fit_force(axes, np.concatenate(shown), force)
    _finish(figure, run)


def _fit_force(axes: Axes, shown: Series, sampled: Series) -> None:
    """Limits that hold all curves; single samples may run out of the picture, a note tells."""
    low, high = min(0.0, float(shown.min())), max(float(shown.max()), 1e-9)
    bottom, top = low - 0.05 * (high - low), high + 0.08 * (high - low)
    axes.set_ylim(bottom, top)
    if sampled.max() > top or sampled.min() < bottom:
        note = f"samples reach from {sampled.min():.0f} to {sampled.max():.0f} N"
        axes.set_title(note, loc="right", color="0.5", fontsize=11, y=-0.14)


def _draw_force_displacement(figure: Figure, run: _Run) -> None:
    """Force over the striker's way, with the work up to the peak as an area."""
    axes = figure.add_subplot(xlabel="striker displacement [mm]", ylabel="force [N]")
    time, force = run.history["time_s"], run.history["striker_force_n"]
    way = _MM * run.history["striker_displacement_m"]
    average = f"mean over {_MS * run.window:g} ms"
    smooth = smooth_force(time, force, run.window)
    support = smooth_force(time, run.history["support_force_n"], run.window)
    axes.plot(way, force, color="0.75", linewidth=0.6, label="striker, as sampled")
    axes.plot(way, smooth, color="C0", linewidth=2.4, label=f"striker, {average}")
    axes.plot(way, support, color="C2", linewidth=1.0, label=f"supports, {average}")
    at, work = run.number("peak_time_s"), run.number("peak_work_j")
    if at is not None and work is not None:
        upto = time <= at
        label = f"work until the crack runs, {1e3 * work:.2f} mJ"
        axes.fill_between(way[upto], force[upto], color="C0", alpha=0.15, lw=0, label=label)
    axes.set_ylim(bottom=min(0.0, force.min()))
    axes.set_xlim(0.0, float(way.max()))
    figure.legend(loc="outside lower center", ncols=2, fontsize=12)


def _mark_peaks(axes: Axes, run: _Run) -> None:
    """The peaks as points; their values stand in the legend, where they hide no curve."""
    for name, shape, peak, at in (
        ("$P_1$", "o", run.number("first_peak_force_n"), run.number("first_peak_time_s")),
        ("$P_2$", "s", run.number("second_peak_force_n"), run.number("second_peak_time_s")),
    ):
        if peak is not None and at is not None:
            label = f"{name} = {peak:.0f} N at {_MS * at:.2f} ms"
            style: dict[str, Any] = {"color": "C0", "markeredgecolor": "white", "markersize": 9}
            axes.plot(_MS * at, peak, shape, label=label, zorder=5, linestyle="none", **style)


def _mark_papers_force(axes: Axes) -> None:
    from matplotlib.patches import Rectangle

    first = f"experiments, $P_1$ ~ {P1_N:.0f} N at {_MS * T1_S:g} ms"
    axes.plot(_MS * T1_S, P1_N, "D", color="C3", markersize=9, fillstyle="none", label=first)
    corner = (_MS * T2_S[0], P2_N[0])
    sides = (_MS * (T2_S[1] - T2_S[0]), P2_N[1] - P2_N[0])
    second = "experiments, $P_2$ and $t_2$"
    axes.add_patch(Rectangle(corner, *sides, color="C3", alpha=0.15, linewidth=0, label=second))
    label = f"paper's LDEM, $t_2$ ~ {_MS * T2_LDEM_S:g} ms"
    axes.axvline(_MS * T2_LDEM_S, color="C3", linestyle="--", linewidth=1.2, label=label)


def _draw_velocity(figure: Figure, run: _Run) -> None:
    axes = figure.add_subplot(xlabel="time [ms]", ylabel="striker velocity [m/s]")
    velocity = run.history["striker_velocity_m_s"]
    axes.plot(run.time_ms, velocity, color="C0", label="striker, positive towards the plate")
    _mark_times(axes, run, "velocity")
    if run.is_papers_test:
        label = f"experiments, largest velocity at ~{_MS * V_MAX_S:g} ms"
        axes.axvline(_MS * V_MAX_S, color="C3", linestyle=":", linewidth=1.5, label=label)
        label = f"experiments, $t_1$ ~ {_MS * T1_S:g} ms"
        axes.axvline(_MS * T1_S, color="C3", linestyle="-.", linewidth=1.2, label=label)
        label = f"experiments, $t_2$ from {_MS * T2_S[0]:g} to {_MS * T2_S[1]:g} ms"
        axes.axvspan(_MS * T2_S[0], _MS * T2_S[1], color="C3", alpha=0.12, label=label)
    _finish(figure, run)


def _draw_energy(figure: Figure, run: _Run) -> None:
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    for label, energy, style in _energies(run.history):
        upper.plot(run.time_ms, energy, style, label=label)
    upper.set_ylabel("energy [J]")
    lower.set_title("imbalance of energies over initial energy and external work", fontsize=12)
    _mark_times(upper, run, "energy")
    error = np.abs(run.history["energy_error"])
    lower.semilogy(run.time_ms, np.where(error > 0, error, np.nan), color="black", linewidth=1.0)
    lower.set_ylabel("|error| [-]")
    lower.set_xlabel("time [ms]")
    _finish(figure, run)


def _energies(history: Mapping[str, Series]) -> Iterator[tuple[str, Series, str]]:
    """Label, energy [J] and line style of each curve that the run has."""
    if "kinetic_striker_j" in history:
        kinetic = history["kinetic_striker_j"]
        work = history.get("external_j", np.zeros_like(kinetic))
        name = "given up by the striker" if "external_j" not in history else "striker and gravity"
        yield name, kinetic[0] - kinetic + work, "C7--"
    elif "external_j" in history:
        yield "work of the grips", history["external_j"], "C7--"
    for column, label, style in (
        ("strain_j", "strain", "C0-"),
        ("fracture_j", "fracture", "C3-"),
        ("kinetic_plate_j", "kinetic, plate", "C1-"),
        ("contact_j", "contact", "C2-"),
        ("damping_j", "damping", "C4-"),
    ):
        if column in history:
            yield label, history[column], style


def _draw_stress_strain(figure: Figure, run: _Run) -> None:
    from taichi_ldem.scenarios.tension import curve, rows_until_parted

    axes = figure.add_subplot(xlabel="gauge strain [%]", ylabel="nominal stress [MPa]")
    c = curve(dict(run.history))
    stress = c.force / run.summary["net_section_m2"]
    end = rows_until_parted(c.force)
    peak = int(np.argmax(stress[:end]))
    for rows, width, label in (
        (slice(peak + 1), 2.2, "computed"),
        (slice(peak, end + 1), 0.8, "after the peak, until the specimen parts"),
    ):
        axes.plot(100 * c.strain[rows], 1e-6 * stress[rows], "C0", lw=width, label=label)
    modulus, strength = run.number("youngs_modulus"), run.number("strength")
    if strength is not None:
        place = (100 * c.strain[peak], 1e-6 * stress[peak])
        axes.plot(*place, "o", color="C0", markeredgecolor="white", markersize=9)
        text = f"{1e-6 * strength:.1f} MPa"
        paper = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
        axes.annotate(text, place, (-70, 8), textcoords="offset points", bbox=paper)
    if math.isclose(run.scene.material.youngs_modulus, _E_PA):
        strain = 100 * _STRENGTH_PA / _E_PA
        label = f"measured, E = {1e-9 * _E_PA:g} GPa"
        axes.plot((0, strain), (0, 1e-6 * _STRENGTH_PA), "C3--", lw=1.2, label=label)
        low, high = (1e-6 * _STRENGTH_PA * (1 + sign * _SCATTER) for sign in (-1, 1))
        label = f"measured strength, {1e-6 * _STRENGTH_PA:g} MPa ± {100 * _SCATTER:g} %"
        axes.axhspan(low, high, color="C3", alpha=0.12, lw=0, label=label)
    ratio = run.number("poisson_ratio")
    if modulus is not None and ratio is not None:
        axes.set_title(f"E = {1e-9 * modulus:.3f} GPa, nu = {ratio:.3f}", fontsize=13)
    axes.set_ylim(bottom=0.0)
    figure.legend(loc="outside lower center", ncols=2, fontsize=12)


def _draw_crack_map(figure: Figure, run: _Run) -> None:
    from matplotlib.colors import PowerNorm

    plate = run.scene.plate
    across, deep = (2, 1) if run.is_beam else (1, 2)  # axes: upwards and into the picture
    half_x, half_y = (_MM * plate.actual_size[axis] / 2 for axis in (0, across))
    middle = half_y if run.is_beam else 0.0
    if not run.is_beam:
        figure.set_figheight(min(7.8, 7.0 * half_y / half_x + 4.0))
    bars = read_broken_bars(run.folder.fields_file)
    place = _MM * bars.position_m[:, [0, across]] - (0.0, middle)
    modules = plate.modules[0], plate.modules[across]
    share = _broken_share(place, modules, (half_x, half_y)) / plate.modules[deep]
    if not plate.is_prism:
        share[~_columns(run, modules, (half_x, half_y))] = np.nan

    axes = figure.add_subplot(xlabel="x [mm]", ylabel=f"{'xyz'[across]} [mm]", aspect="equal")
    axes.grid(False)
    image = axes.imshow(
        share.T,
        extent=(-half_x, half_x, middle - half_y, middle + half_y),
        origin="lower",
        cmap="Greys",
        norm=PowerNorm(0.5, 0.0, 0.5),  # a single broken bar must show beside a whole crack
        interpolation="nearest",
    )
    bar = figure.colorbar(
        image,
        ax=axes,
        extend="max",
        shrink=0.8,
        orientation="horizontal" if run.is_beam else "vertical",
    )
    bar.set_label("share of bars broken, mean through the thickness")
    if run.is_beam:
        figure.set_size_inches(9.0, 5.6)
        _draw_supports(axes, run.scene)
    else:
        _draw_outlines(axes, run.scene)
        # Looking up with y upwards, x points to the left.
        axes.set_xlim(1.03 * half_x, -1.03 * half_x)
        axes.set_ylim(-1.03 * half_y, 1.03 * half_y)
    times = read_times(run.folder.fields_file)
    end = max(run.history["time_s"].max(initial=0.0), times.max(initial=0.0))
    side = "the side" if run.is_beam else "below"
    axes.set_title(
        f"Broken bars seen from {side}: {len(bars.bar):,} at t = {_MS * end:.2f} ms", fontsize=14
    )


def _columns(run: _Run, modules: tuple[int, int], half: tuple[float, float]) -> NDArray[np.bool_]:
    """Where there are modules; (nx, ny)."""
    fields = read_fields(run.folder.fields_file, 0)
    x, y = _MM * fields.points[fields.hexahedra].mean(axis=1)[:, :2].T
    limits = ((-half[0], half[0]), (-half[1], half[1]))
    return np.asarray(np.histogram2d(x, y, bins=modules, range=limits)[0] > 0)


def _draw_cracks(figure: Figure, run: _Run) -> None:
    from taichi_ldem.output.figures.cracks import overlay

    assert run.cracks is not None
    clamp = run.scene.clamp
    inner = clamp.inner_diameter if clamp is not None and run.scene.held else None
    outlines = partial(_draw_outlines, scene=run.scene, legend=False)
    overlay(figure, run.cracks, outlines, 0.55 * (inner or 0.0))


def _draw_crack_growth(figure: Figure, run: _Run) -> None:
    from taichi_ldem.analysis.cracks import broken_area
    from taichi_ldem.output.figures.cracks import growth

    assert run.cracks is not None
    bars = read_broken_bars(run.folder.fields_file)
    area = broken_area(bars, run.scene, run.history["time_s"])
    for number, axes in enumerate(growth(figure, run.cracks, area)):
        axes.set_xlim(0.0, float(run.time_ms[-1]))
        _mark_times(axes, run, "energy", named=number == 0)


def _broken_share(
    position: Series, modules: tuple[int, int], half: tuple[float, float]
) -> NDArray[np.float64]:
    """Broken bars per bar of a module, summed through the thickness; (nx, ny).

    A bar on the border of two columns counts half in each, which keeps the map symmetric.
    """
    nudge = 1e-6 * min(half)
    counts = np.zeros(modules)
    for shift in ((-nudge, -nudge), (-nudge, nudge), (nudge, -nudge), (nudge, nudge)):
        # Bars on the rim must not be nudged off the plate.
        x, y = np.clip(position + shift, np.negative(half), half).T
        limits = ((-half[0], half[0]), (-half[1], half[1]))
        counts += np.histogram2d(x, y, bins=modules, range=limits)[0] / 4
    return counts / 14


def _draw_outlines(axes: Axes, scene: Scene, *, legend: bool = True) -> None:
    """The specimen's edge and the clamp's inner circle."""
    from matplotlib.patches import Circle, Patch, Polygon, Rectangle

    plate, clamp = scene.plate, scene.clamp
    if plate.diameter is not None:
        outline: Patch = Circle((0.0, 0.0), _MM * plate.diameter / 2)
    elif not plate.is_prism:
        outline = Polygon(_MM * _outline(plate))
    else:
        x, y = (_MM * side for side in plate.actual_size[:2])
        outline = Rectangle((-x / 2, -y / 2), x, y)
    outline.set(fill=False, edgecolor="black", linewidth=1.5)
    axes.add_patch(outline)
    if clamp is not None and clamp.kind != "free" and clamp.inner_diameter is not None:
        angle = np.linspace(0.0, 2.0 * np.pi, 361)
        radius = _MM * clamp.inner_diameter / 2
        label = f"clamp, inner diameter {2 * radius:g} mm"
        axes.plot(radius * np.cos(angle), radius * np.sin(angle), ":", color="0.3", label=label)
        if legend:
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), fontsize=12)


def _outline(plate: Plate) -> Series:
    """Corners (n, 2) of a specimen in tension as it is meant, before it is made of modules, m."""
    x = np.linspace(-plate.size[0] / 2, plate.size[0] / 2, 401)
    y = np.full_like(x, plate.size[1] / 2)
    if plate.narrow_width and plate.narrow_length and plate.fillet_radius:
        narrow = (plate.narrow_width, plate.narrow_length, plate.fillet_radius)
        y = dumbbell_half_width(x, plate.size[1], *narrow)
    corners = np.stack([np.concatenate([x, x[::-1]]), np.concatenate([y, -y[::-1]])], axis=1)
    angle = math.radians(plate.angle)
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.asarray(corners @ [[cosine, sine], [-sine, cosine]])


def _draw_supports(axes: Axes, scene: Scene) -> None:
    """A beam's edge, its notch, and the rigid bodies as they were at the start, from the side."""
    from matplotlib.patches import Circle, Rectangle

    supports, striker = scene.supports, scene.striker
    assert supports is not None
    length, _, height = (_MM * side for side in scene.plate.actual_size)
    edge: dict[str, Any] = {"fill": False, "edgecolor": "black", "linewidth": 1.5}
    axes.add_patch(Rectangle((-length / 2, 0.0), length, height, **edge))
    body: dict[str, Any] = {"facecolor": "C0", "alpha": 0.3, "linewidth": 0}
    radius = _MM * supports.diameter / 2
    for side in (-1, 1):
        axes.add_patch(Circle((side * _MM * supports.span / 2, -radius), radius, **body))
    top = height
    if striker is not None:
        radius = _MM * striker.diameter / 2
        place = _MM * striker.position[0], height + _MM * striker.gap + radius
        axes.add_patch(Circle(place, radius, **body))
        top = place[1] + radius
    for notch in scene.notch:
        if notch.normal == "x":
            z = np.clip(_MM * np.array(notch.bounds[1]), 0.0, height)
            axes.plot([_MM * notch.position] * 2, z, color="C1", linewidth=2.5, label="notch")
    axes.legend(loc="upper right", fontsize=12)
    axes.set_xlim(-0.52 * length, 0.52 * length)
    axes.set_ylim(-1.05 * _MM * supports.diameter, top + 0.1 * height)


FAILURES = {
    "force": ("failure_time_s", "$t_2$ (force)"),
    "velocity": ("failure_time_velocity_s", "$t_2$ (velocity)"),
    "energy": ("failure_time_energy_s", "$t_2$ (energy)"),
}
"""Key and name of the failure time by what it is read off (``signals``)."""
_CROWDED = 0.11  # names closer than this share of the axes' width stand in two rows


def _mark_times(axes: Axes, run: _Run, failure: str, *, named: bool = True) -> None:
    """Damage onset, first peak and failure as thin lines, named above the axes.

    Args:
        failure: what the failure time is read off, of ``FAILURES``.
    """
    keys = (
        ("damage_onset_time_s", "onset"),
        ("first_peak_time_s", "$t_1$"),
        FAILURES[failure],
        ("peak_time_s", "peak"),
    )
    found = sorted((at, name) for key, name in keys if (at := run.number(key)) is not None)
    last, row = -math.inf, 0
    for at, name in found:
        axes.axvline(_MS * at, color="0.4", linewidth=0.8)
        row = 1 - row if _MS * at - last < _CROWDED * run.time_ms[-1] else 0
        last = _MS * at
        if named:
            place, above = (last, 1.0), (-4 * row, 4 + 16 * row)
            side = "left" if row else "center"
            style: dict[str, Any] = {"ha": side, "va": "bottom", "fontsize": 12}
            xy: Any = ("data", "axes fraction")
            axes.annotate(name, place, above, xycoords=xy, textcoords="offset points", **style)


def _finish(figure: Figure, run: _Run) -> None:
    for axes in figure.axes:
        axes.set_xlim(0.0, float(run.time_ms[-1]))
    figure.legend(loc="outside lower center", ncols=2, fontsize=12)


_Needs = Callable[[_Run], bool]
_Draw = Callable[["Figure", _Run], None]
_FIGURES: tuple[tuple[str, tuple[float, float], _Needs, _Draw], ...] = (
    ("force", (9.0, 6.4), _has("striker_force_n"), _draw_force),
    ("force_displacement", (9.0, 6.4), _has("support_force_n"), _draw_force_displacement),
    ("velocity", (9.0, 6.4), _has("striker_velocity_m_s"), _draw_velocity),
    ("energy", (9.0, 7.0), _has("energy_error"), _draw_energy),
    ("stress_strain", (9.0, 6.4), _has_section, _draw_stress_strain),
    ("crack_map", (9.0, 7.8), _has_cracks, _draw_crack_map),
    ("pulse", (9.0, 9.0), _has_pulse, _of_pulse("pulse")),
    ("dispersion", (9.0, 7.0), _has_pulse, _of_pulse("dispersion")),
    ("anisotropy", (12.0, 9.0), _has_pulse, _of_pulse("anisotropy")),
    ("cracks", (15.0, 9.7), _has_measured_cracks, _draw_cracks),
    ("crack_growth", (9.0, 8.0), _has_growth, _draw_crack_growth),
)
