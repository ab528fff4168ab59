"""Do cracks follow the lattice? Number and directions of radial cracks over many specimens.

    python -m studies.bias OUT ENSEMBLE [ENSEMBLE ...] [--second-peak]

Reads the members of ensembles (``ldem ensemble``) of one specimen, at the time of their radial map
(t2), or at their second force peak: a circular crack that forms without failure cuts the radial
cracks off, so that their tips are no longer found. Those that differ in a seed or in the striker's
place only are one group. Two directions of each radial crack are folded onto 0 (along an axis of
the lattice) to 45 degrees: that of its tip from the striker's axis, and those of the pieces of its
path, weighted by length. <cos 4 theta> is 1 where all lie along the axes, -1 on the diagonals, 0
where none is preferred; its 95 % confidence interval is that of the members' means.

Writes ``bias.md``, ``bias.csv`` and ``bias.png``.
"""

import argparse
import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from taichi_ldem.analysis.cracks import RadialCrack
from taichi_ldem.ensemble.attempt import FINISHED
from taichi_ldem.ensemble.axes import CV, SEED
from taichi_ldem.ensemble.plan import MEMBERS, read_plan
from taichi_ldem.ensemble.results import Row, read_rows, statistics
from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios.measure import measure_run
from taichi_ldem.storage.folder import RunFolder

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = npt.NDArray[np.float64]

REPEATED = (SEED, "striker.position", "plate.perturbation_seed")
"""Keys whose variation makes specimens of one group."""

PIECE = 6
"""Pixels (modules) of a path whose chord is a direction of its own: long enough that
the chord of a staircase has more directions than 0, 45 and 90 degrees, and short enough to resolve
the path."""

CLOSE = 10.0
"""Degrees within which a tip counts as on an axis; two ninths of all directions do."""

BINS = np.arange(0.0, 45.1, 5.0)


@dataclass(frozen=True)
class Specimen:
    """One member's radial cracks.

    Attributes:
        tips: (n,) folded directions of the tips from the striker's axis, degrees.
        pieces: (m,) folded directions of the pieces of their paths, degrees. lengths: (m,) m.
        seconds: of stepping.
        diameter: d_r, mm; NaN where there is none.
    """

    tips: Array
    pieces: Array
    lengths: Array
    seconds: float
    diameter: float = float("nan")


def folded(vectors: Array) -> Array:
    """(n,) angle of (n, 2) vectors from the nearest axis, degrees: 0 to 45."""
    angle = np.degrees(np.arctan2(vectors[:, 1], vectors[:, 0])) % 90.0
    return np.asarray(np.minimum(angle, 90.0 - angle))


def fourfold(angles: Array, weights: Array | None = None) -> float:
    """Mean of cos 4 theta of angles in degrees; NaN of none."""
    if not len(angles):
        return float("nan")
    return float(np.average(np.cos(np.radians(4 * angles)), weights=weights))


def specimen(
    radial: Sequence[RadialCrack], axis: Array, seconds: float, diameter: float = float("nan")
) -> Specimen:
    """Directions of radial cracks seen from the striker's axis (2,), m."""
    tips = np.array([crack.tip - axis for crack in radial]).reshape(-1, 2)
    chords = [np.diff(crack.path[::PIECE], axis=0) for crack in radial]
    pieces = np.concatenate([*chords, np.zeros((0, 2))])
    lengths = np.linalg.norm(pieces, axis=1)
    return Specimen(folded(tips), folded(pieces), lengths, seconds, diameter)


def read(ensembles: Sequence[Path], second_peak: bool = False) -> dict[str, list[Specimen]]:
    """The finished members of ensembles by the label of their group.

    Args:
        second_peak: count radial cracks at the second force peak, where there is one.

    Raises:
        SceneError: a folder holds no ensemble, or a file of it cannot be read.
    """
    found: dict[str, list[Specimen]] = {}
    for ensemble in ensembles:
        for row in read_rows(read_plan(ensemble), ensemble):
            if row.state != FINISHED:
                continue
            at = row.numbers.get("second_peak_time_s") if second_peak else None
            cracks = measure_run(RunFolder(ensemble / MEMBERS / row.member.name), at)
            scene = row.member.scene
            axis = np.array(scene.striker.position if scene.striker else (0.0, 0.0))
            radial = cracks.radial if cracks is not None else ()
            circle = cracks.radial_circle if cracks is not None else None
            diameter = np.nan if circle is None else 1e3 * circle.diameter
            seconds = float(row.numbers.get("wall_s") or np.nan)
            found.setdefault(label(row), []).append(specimen(radial, axis, seconds, diameter))
    return found


def label(row: Row) -> str:
    """Name of a member's group: its disorder and perturbation, then other varied keys."""
    scene = row.member.scene
    cv = scene.disorder.fracture_energy_cv if scene.disorder else 0.0
    strength = scene.disorder.strength_cv if scene.disorder else 0.0
    words = [f"CV {100 * cv:g} %"] if cv else []
    words += [f"strength CV {100 * strength:g} %"] if strength else []
    words = words or ["homogeneous"]
    if scene.plate.perturbation:
        words.append(f"perturbed {100 * scene.plate.perturbation:g} % of L")
    own = (*REPEATED, CV, "plate.perturbation")
    varied: dict[str, Any] = {k: v for k, v in row.member.varied.items() if k not in own}
    return ", ".join([*words, *(f"{key} {value}" for key, value in varied.items())])


def _interval(values: Sequence[float], digits: int) -> str:
    """Mean and half of its 95 % confidence interval."""
    found = statistics([value for value in values if value == value])
    if found is None:
        return "-"
    half = "" if found.half_interval is None else f" ± {found.half_interval:.{digits}f}"
    return f"{found.mean:.{digits}f}{half}"


HEADS = (
    "specimen",
    "runs",
    "radial cracks",
    "d_r [mm]",
    "tips within 10° of an axis",
    "<cos 4θ> of tips",
    "<cos 4θ> of paths",
    "seconds a run",
)


def cells(name: str, group: Sequence[Specimen]) -> list[str]:
    """A group's line of the table."""
    tips = np.concatenate([s.tips for s in group])
    share = "-" if not len(tips) else f"{100 * np.mean(tips <= CLOSE):.0f} % of {len(tips)}"
    return [
        name,
        str(len(group)),
        _interval([float(len(s.tips)) for s in group], 1),
        _interval([s.diameter for s in group], 1),
        share,
        _interval([fourfold(s.tips) for s in group], 2),
        _interval([fourfold(s.pieces, s.lengths) for s in group if len(s.pieces)], 2),
        f"{np.median([s.seconds for s in group]):.0f}",
    ]


def report(groups: dict[str, list[Specimen]]) -> str:
    """The table, Markdown; 22 % of directions lie within 10 degrees of an axis by chance."""
    lines = [f"| {' | '.join(HEADS)} |", "|---" * len(HEADS) + "|"]
    lines += [f"| {' | '.join(cells(name, group))} |" for name, group in groups.items()]
    return "\n".join(lines) + "\n"


def write_csv(groups: dict[str, list[Specimen]], file: Path) -> None:
    """Shares of each bin of five degrees, of tips and (by length) of paths."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        bins = [f"{low:g} to {low + 5:g}" for low in BINS[:-1]]
        writer.writerow(["specimen", "of", *bins])
        for name, group in groups.items():
            for what, shares in (("tips", _shares(group, False)), ("paths", _shares(group, True))):
                writer.writerow([name, what, *(f"{share:.4f}" for share in shares)])


def _shares(group: Sequence[Specimen], paths: bool) -> Array:
    angles = np.concatenate([s.pieces if paths else s.tips for s in group])
    weights = np.concatenate([s.lengths for s in group]) if paths else None
    count = np.histogram(angles, BINS, weights=weights)[0].astype(float)
    return np.asarray(count / max(count.sum(), 1e-300))


def figure(groups: dict[str, list[Specimen]], file: Path) -> None:
    """Draw the histogram of every group, the share without preference as a line."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    across = min(4, len(groups))
    down = -(-len(groups) // across)
    size = (3.4 * across, 2.9 * down + 0.5)
    drawing = plt.figure(figsize=size, layout="constrained")
    panels = drawing.subplots(down, across, sharex=True, sharey=True, squeeze=False)
    for axes, (name, group) in zip(panels.ravel(), groups.items(), strict=False):
        _draw(axes, group)
        axes.set_title(f"{name} ({len(group)} runs)", fontsize=9)
    for axes in panels.ravel()[len(groups) :]:
        axes.axis("off")
    drawing.supxlabel("angle to the nearest axis of the lattice [degrees]")
    drawing.supylabel("share [%]")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    drawing.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=9)
    drawing.savefig(file, dpi=130)
    plt.close(drawing)


def _draw(axes: "Axes", group: Sequence[Specimen]) -> None:
    middle = 0.5 * (BINS[1:] + BINS[:-1])
    for shift, paths, colour, name in (
        (-1.1, False, "tab:red", "tips, from the striker's axis"),
        (1.1, True, "tab:blue", "paths, by length"),
    ):
        axes.bar(middle + shift, 100 * _shares(group, paths), 2.1, color=colour, label=name)
    axes.axhline(100 / (len(BINS) - 1), color="k", ls="--", lw=1, label="no preference")
    axes.set_xticks(BINS[::3])


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the ensembles and write table and figure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("ensembles", type=Path, nargs="+")
    parser.add_argument("--second-peak", action="store_true", help="count at the second peak")
    given = parser.parse_args(arguments)
    try:
        groups = read(given.ensembles, given.second_peak)
    except SceneError as error:
        print(error)
        return 2
    given.out.mkdir(parents=True, exist_ok=True)
    text = report(groups)
    (given.out / "bias.md").write_text(text, encoding="utf-8")
    write_csv(groups, given.out / "bias.csv")
    figure(groups, given.out / "bias.png")
    print(text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
