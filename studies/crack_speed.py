"""How fast does a crack run, and when does it branch? A long strip that is pulled while it cracks.

    python -m studies.crack_speed --out FOLDER [--lattice module] [--fracture crack]

The strip of configs/tension_strip.toml, 80 mm long and with modules of 0.533 mm, is pulled apart at
several speeds. The crack starts near G_f; while it runs the grips move on, so that the energy that
the strip offers, G = E' delta^2 / (2 H), rises to several G_f. Each 4 mm of its way give a point:

- its speed over that of Rayleigh waves, to compare with v = c_R (1 - G_f / G) (Freund 1990);
- the crack surface: area of the bars that failed there over that of one flat crack;
- the width of the cracked band in modules, and the number of cracks side by side. Damage that
  spreads makes the band wider; branches part, with whole bars between them.

Prints a table, writes it with two figures to FOLDER, and stores the points in points.json.
"""

import argparse
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.model.cell import CELLS
from taichi_ldem.model.material import bars_of
from taichi_ldem.scene import Scene, load_scene, parse_scene
from taichi_ldem.studies.toughness.strip import ALL_OVER, free_height, geometry, rayleigh_speed

Array = npt.NDArray[np.float64]

SCENE = Path("configs/tension_strip.toml")
SPEEDS = (0.3, 1.0, 3.0, 6.0)
"""Of the grips, m/s."""
LENGTH, EDGE = 0.08, 0.01
"""Length of the strip, and what is left out at its free end, m."""
PIECE = 4e-3
"""Part of the way that gives a point, m."""
GAP = 2.0
"""Distance across, in modules, beyond which failed bars belong to another crack."""


@dataclass(frozen=True)
class Point:
    """A crack on a piece of its way.

    Attributes:
        pull: speed of the grips, m/s. place: distance from the notch's tip, m.
        released: G over G_f. speed: over that of Rayleigh waves. surface: see the module.
        width: modules. cracks: side by side, mean over slices of a module along the way.
    """

    pull: float
    place: float
    released: float
    speed: float
    surface: float
    width: float
    cracks: float


def scene(pull: float, lattice: str, fracture: str) -> Scene:
    """The long strip, pulled at a speed (m/s)."""
    data = load_scene(SCENE).model_dump(by_alias=True, exclude_none=True)
    thickness, start = data["plate"]["size"][2], -LENGTH / 2
    data["plate"] |= {"size": [0.016, LENGTH, thickness], "lattice": lattice}
    data["material"]["fracture"] = fracture
    data["grips"] |= {"velocity": pull, "ramp": 2e-5}
    (notch,) = data["notch"]
    data["notch"] = [notch | {"from": [start, 0.0], "to": [start + 0.015, thickness]}]
    data["solver"] |= {"duration": 1.2e-3 / pull**0.5, "damping": 0.0, "precision": "f32"}
    data["output"] |= {"history_interval": 5e-7}
    return parse_scene(data)


def points(simulation: Any) -> tuple[list[Point], Array]:
    """Run a strip until its crack comes near the free end.

    Returns:
        what it did on each piece of its way, and the (n, 2) places of its failed bars, m: along the
        way, and across.
    """
    scene, dynamics = simulation.scene, simulation.dynamics
    tip, plane, far = geometry(scene)
    rows: list[tuple[float, float]] = []
    when, places, kinds = [], [], []
    for sample in simulation.samples():
        sites, bars = dynamics.new_broken()
        place = dynamics.lattice.bar_midpoints(sites, bars)
        near = np.abs(place[:, 0] - plane) < ALL_OVER * scene.plate.size[0]
        place, bars = place[near], bars[near]
        when += [len(rows)] * len(bars)
        places.append(place)
        kinds.append(bars)
        rows.append((sample.time, sample.observed["grip_displacement_m"]))
        if (place[:, 1] - tip > far - EDGE).any():
            break
    place, kind, row = np.concatenate(places), np.concatenate(kinds), np.array(when, dtype=int)
    time, separation = np.array(rows).T
    found = _pieces(scene, place, kind, row, time, separation, free_height(simulation))
    return found, np.stack([place[:, 1] - tip, place[:, 0]], axis=1)


def side_by_side(along: Array, across: Array, spacing: float) -> float:
    """Number of cracks next to each other, mean over the slices of a module that have any."""
    counts = []
    for number in np.unique(np.floor(along / spacing)):
        slice_ = np.sort(across[np.floor(along / spacing) == number])
        counts.append(1 + np.count_nonzero(np.diff(slice_) > GAP * spacing))
    return float(np.mean(counts)) if counts else math.nan


def _pieces(
    scene: Scene,
    place: Array,
    kind: npt.NDArray[np.int64],
    row: npt.NDArray[np.int64],
    time: Array,
    separation: Array,
    height: float,
) -> list[Point]:
    material, (tip, _, far) = scene.material, geometry(scene)
    assert scene.grips is not None
    assert material.fracture_energy is not None
    modulus = material.youngs_modulus / (1 - material.poisson_ratio**2)
    wave = rayleigh_speed(material.youngs_modulus, material.poisson_ratio, material.density)
    areas = np.array([f.fracture_area for f in bars_of(scene)])
    area = areas[np.array(CELLS[scene.plate.lattice].family)[kind]]
    along = place[:, 1] - tip
    front = np.zeros(len(time))
    np.maximum.at(front, row, along)
    front = np.maximum.accumulate(front)
    found = []
    for begin in np.arange(PIECE, far - EDGE - PIECE, PIECE):
        first, last = np.searchsorted(front, (begin, begin + PIECE))
        if last >= len(time) or last == first:
            break
        here = (along >= begin) & (along < begin + PIECE)
        middle = (first + last) // 2
        released = modulus * separation[middle] ** 2 / (2 * height) / material.fracture_energy
        across = place[here, 0]
        found.append(
            Point(
                pull=scene.grips.velocity,
                place=float(begin + PIECE / 2),
                released=float(released),
                speed=float((front[last] - front[first]) / (time[last] - time[first]) / wave),
                surface=float(area[here].sum() / (PIECE * scene.plate.size[2])),
                width=float(np.ptp(across) / scene.plate.spacing) if len(across) else math.nan,
                cracks=side_by_side(along[here], across, scene.plate.spacing),
            )
        )
    return found


def table(found: list[Point]) -> str:
    """The points in Markdown."""
    lines = [
        "| pull [m/s] | way [mm] | G / G_f | speed / c_R | 1 - G_f / G | surface | width [L] "
        "| cracks |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {p.pull:g} | {1e3 * p.place:.0f} | {p.released:.2f} | {p.speed:.2f} "
        f"| {max(0.0, 1 - 1 / p.released):.2f} | {p.surface:.2f} | {p.width:.1f} "
        f"| {p.cracks:.1f} |"
        for p in found
    ]
    return "\n".join(lines)


def draw(found: list[Point], file: Path) -> None:
    """Speed and surface over G."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, (upper, lower) = plt.subplots(2, 1, figsize=(7, 7), sharex=True, layout="constrained")
    for number, pull in enumerate(dict.fromkeys(p.pull for p in found)):
        mine = [p for p in found if p.pull == pull]
        released = [p.released for p in mine]
        style = f"C{number}o"
        upper.plot(released, [p.speed for p in mine], style, label=f"pulled at {pull:g} m/s")
        lower.plot(released, [p.surface for p in mine], style)
    line = np.linspace(1, max(p.released for p in found), 200)
    upper.plot(line, 1 - 1 / line, "k-", label="1 - G_f / G (Freund)")
    upper.axhline(1.0, color="0.5", ls=":")
    upper.set(ylabel="crack speed / c_R [-]", ylim=(0, 1.1))
    lower.set(xlabel="G / G_f [-]", ylabel="area of failed bars / flat crack [-]")
    upper.legend()
    figure.savefig(file, dpi=130)


def draw_bars(bars: dict[float, Array], file: Path) -> None:
    """The failed bars of each strip."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    size = (10, 1.9 * len(bars))
    figure, axes = plt.subplots(len(bars), 1, figsize=size, sharex=True, layout="constrained")
    for axis, (pull, places) in zip(np.atleast_1d(axes), bars.items(), strict=True):
        axis.plot(*(1e3 * places.T), "k,")
        axis.set(title=f"pulled at {pull:g} m/s", ylabel="across [mm]", ylim=(-8, 8))
        axis.set_aspect("equal")
    axis.set(xlabel="way of the crack [mm]")
    figure.savefig(file, dpi=130)


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--lattice", default="module")
    parser.add_argument("--fracture", default="crack")
    options = parser.parse_args()
    from taichi_ldem.solver import backend

    options.out.mkdir(parents=True, exist_ok=True)
    simulation, found, bars = None, [], {}
    for pull in SPEEDS:
        strip = scene(pull, options.lattice, options.fracture)
        if simulation is None:
            backend.start(strip.solver)
            from taichi_ldem.solver.simulation import Simulation

            simulation = Simulation(strip)
        else:
            simulation.reset(strip)
        more, bars[pull] = points(simulation)
        found += more
        text = json.dumps([asdict(p) for p in found], indent=1)
        (options.out / "points.json").write_text(text)
    text = table(found)
    (options.out / "crack_speed.md").write_text(text + "\n")
    draw(found, options.out / "crack_speed.png")
    draw_bars(bars, options.out / "crack_speed_bars.png")
    print(text)


if __name__ == "__main__":
    main()
