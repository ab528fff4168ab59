"""What a toughness study found: a table, and its figure over direction and module size."""

import csv
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from taichi_ldem.model.material import characteristic_length
from taichi_ldem.scene import Scene
from taichi_ldem.studies.toughness.plan import Strip
from taichi_ldem.studies.toughness.strip import Reading

Found = Mapping[Strip, Reading]
Places = dict[tuple[float, float], list[Reading]]
"""Readings by module edge and angle."""


def report(scene: Scene, found: Found, out: Path) -> None:
    """Write the table, the CSV file and the figures."""
    places: Places = defaultdict(list)
    for strip, reading in found.items():
        places[strip.spacing(scene), strip.angle].append(reading)
    text = table(scene, places)
    (out / "toughness.md").write_text(text, encoding="utf-8")
    print(text, end="")
    _write_csv(scene, found, out / "toughness.csv")
    if found:
        figures(scene, places, out)


def _write_csv(scene: Scene, found: Found, file: Path) -> None:
    with file.open("w", newline="", encoding="utf-8") as stream:
        rows = [
            {"angle_deg": strip.angle, "spacing_m": strip.spacing(scene), "seed": strip.seed}
            | asdict(reading)
            for strip, reading in found.items()
        ]
        writer = csv.DictWriter(stream, list(rows[0]) if rows else ["angle_deg"])
        writer.writeheader()
        writer.writerows(rows)


def values(readings: Sequence[Reading], name: str) -> list[float]:
    """The values of a quantity that were measured."""
    return [value for reading in readings if (value := getattr(reading, name)) is not None]


def _cell(readings: Sequence[Reading], name: str, form: str = ".2f") -> str:
    """Mean and standard deviation."""
    seen = values(readings, name)
    if not seen:
        return ""
    scatter = f" ± {np.std(seen, ddof=1):{form}}" if len(seen) > 1 else ""
    return f"{np.mean(seen):{form}}{scatter}"


def bias(places: Places, spacing: float) -> float | None:
    """Half the range of the mean costs over all angles, over their mean: 0 has no direction."""
    means = [
        float(np.mean(seen))
        for (edge, _), readings in places.items()
        if edge == spacing and (seen := values(readings, "run"))
    ]
    if len(means) < 2:
        return None
    return (max(means) - min(means)) / (max(means) + min(means))


HEADS = (
    "L [mm]",
    "L / l_ch",
    "angle",
    "strips",
    "start: G / G_f",
    "run: G / G_f",
    "in bars",
    "radiated, damped",
    "deviation [degrees]",
    "speed / c_R",
    "strain / eps_p",
)


def table(scene: Scene, places: Places) -> str:
    """All means and standard deviations as Markdown."""
    length = characteristic_length(scene.material)
    lines = ["| " + " | ".join(HEADS) + " |", "|" + "---|" * len(HEADS)]
    for (spacing, angle), readings in sorted(places.items(), reverse=True):
        cells = [
            f"{1e3 * spacing:.3g}",
            f"{spacing / length:.2f}",
            f"{angle:g}",
            f"{len(values(readings, 'run'))} of {len(readings)}",
            _cell(readings, "start"),
            _cell(readings, "run"),
            _cell(readings, "bars"),
            _cell(readings, "radiated"),
            _cell(readings, "deviation", ".1f"),
            _cell(readings, "speed"),
            _cell(readings, "strain"),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    lines.append("")
    number = bias(places, scene.plate.spacing)
    if number is not None:
        lines.append(f"Bias of direction: ± {100 * number:.0f} % of the mean cost.")
    worst = max((r.energy_error for rs in places.values() for r in rs), default=0.0)
    lines.append(f"Largest imbalance of energy: {100 * worst:.2f} % of what the strip held.")
    return "\n".join(lines) + "\n"


def figures(scene: Scene, places: Places, out: Path) -> None:
    """Draw the cost over the direction and, where there are several, over the module size."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    panels = 2 if len({edge for edge, _ in places}) > 1 else 1
    figure = plt.figure(figsize=(5.5 * panels, 5), layout="constrained")
    _polar(figure.add_subplot(1, panels, 1, projection="polar"), places, scene.plate.spacing)
    if panels > 1:
        _sizes(figure.add_subplot(1, panels, 2), places, characteristic_length(scene.material))
    figure.savefig(out / "toughness.png", dpi=130)
    plt.close(figure)


def _polar(axes: Any, places: Places, spacing: float) -> None:
    """G / G_f by direction; the quarter that was measured is repeated by the lattice's symmetry."""
    for name, marker, colour, label in (
        ("run", "o-", "C3", "released when a crack runs"),
        ("bars", "s--", "C0", "dissipated in bars"),
    ):
        mean = {
            angle: float(np.mean(seen))
            for (edge, angle), readings in places.items()
            if edge == spacing and angle <= 45 and (seen := values(readings, name))
        }
        turns = sorted(
            {
                (turn + side * a) % 360: a
                for turn in range(0, 360, 90)
                for side in (1, -1)
                for a in mean
            }.items()
        )
        if turns:
            around = [*turns, (turns[0][0] + 360, turns[0][1])]
            axes.plot(
                [math.radians(t) for t, _ in around],
                [mean[a] for _, a in around],
                marker,
                color=colour,
                ms=4,
                label=label,
            )
    axes.plot(np.linspace(0, 2 * math.pi, 181), np.ones(181), "k:", label="$G_f$")
    axes.set_title(f"energy per area of crack over $G_f$, L = {1e3 * spacing:.3g} mm")
    axes.set_rlabel_position(67.5)
    axes.set_ylim(0, None)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.06), fontsize=9)


def _sizes(axes: Any, places: Places, length: float) -> None:
    for number, angle in enumerate(sorted({angle for _, angle in places})):
        for name, style in (("run", "o-"), ("bars", "s--")):
            points = sorted(
                (edge / length, float(np.mean(seen)))
                for (edge, at), readings in places.items()
                if at == angle and (seen := values(readings, name))
            )
            if len(points) > 1:
                label = f"{angle:g} degrees, {'released' if name == 'run' else 'in bars'}"
                axes.plot(*zip(*points, strict=True), style, color=f"C{number}", label=label, ms=4)
    axes.axhline(1.0, color="k", ls=":")
    axes.set(xlabel="$L / l_{ch}$", ylabel="energy per area of crack over $G_f$")
    axes.set(xlim=(0, None), ylim=(0, None))
    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[0][0:]:
        axes.legend(fontsize=9)
