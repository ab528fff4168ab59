"""Fracture energy from a series of notched bending tests: U against B W phi (Fig. 7 of the paper).

    ldem bend configs/bend.toml --series                     # on the scene's own module size
    python -m taichi_ldem.studies.bending configs/bend.toml outputs/bending [--spacings 5e-4 2.5e-4]

Widths and notches span the paper's; the notches are rounded to where the lattice has its crack tips
(``bend.notch_depth``). Every specimen runs in a process and a folder of its own. Finished
specimens are not repeated, so the study can be interrupted and resumed.

U is the energy that the specimen has absorbed when its crack begins to run (the peak of ``bend``),
less the elastic energy of the dents at striker and supports, for which ISO 17281 corrects. Their
share of the strain energy is their share of the lattice's compliance. phi is
``compliance.calibration``. The energy dissipated by the whole test over the ligament is a second
measure; its share in bars away from the notch's plane is damage that a flat crack does not cause.
"""

import json
import sys
from argparse import ArgumentParser
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from taichi_ldem.model import material as mat
from taichi_ldem.model.cell import CELLS
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.reading import read_object
from taichi_ldem.scenarios.bend import notch_depth
from taichi_ldem.scenarios.interrupts import Signalled, run_child
from taichi_ldem.scene import Scene, load_scene, parse_scene, scene_to_toml
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.place import refuse_moved
from taichi_ldem.streams import courteous
from taichi_ldem.studies import compliance

# W and a, m, over the paper's ranges of 6.21 to 7.26 mm and 1.9 to 6.38 mm; it gives no pairs
SPECIMENS = (
    (6.5e-3, 2.0e-3),
    (6.5e-3, 2.6e-3),
    (6.5e-3, 3.2e-3),
    (6.5e-3, 3.9e-3),
    (6.5e-3, 4.6e-3),
    (7.0e-3, 2.4e-3),
    (7.0e-3, 4.4e-3),
    (7.0e-3, 6.0e-3),
)
SPACINGS = (5e-4, 2.5e-4)
MEASURED, SCATTER = 930.0, 120.0
"""G_IC of the paper's fourteen specimens, J/m2."""

Row = dict[str, Any]


@dataclass(frozen=True)
class Specimen:
    """A beam of width W with a notch of about ``notch``, on a lattice of a given module edge; m."""

    width: float
    notch: float
    spacing: float

    @property
    def depth(self) -> float:
        """Depth of the notch as built, m: where the lattice has the crack's tip (``bend``)."""
        return (round(self.notch / self.spacing - 0.75) + 0.75) * self.spacing

    @property
    def name(self) -> str:
        """Name of its folder."""
        parts = (1e6 * self.spacing, 1e6 * self.width, 1e6 * self.depth)
        return "L{:.0f}_W{:.0f}_a{:.0f}".format(*parts)

    def scene(self, base: Scene) -> Scene:
        """The base scene with this beam and this notch."""
        data = base.model_dump(by_alias=True, exclude_none=True)
        x, y, _ = base.plate.size
        modules = round(self.width / self.spacing)
        data["plate"] |= {"size": (x, y, self.width), "modules_through_thickness": modules}
        notch = {"normal": "x", "position": 0.0, "from": (-y / 2, 0.0), "to": (y / 2, self.depth)}
        data["notch"] = [notch]
        return parse_scene(data, self.name)


def run(specimen: Specimen, base: Scene, folder: Path, extra: Sequence[str]) -> int:
    """Run a specimen in a process of its own and its statics here, unless they are finished.

    Returns:
        the process's exit code.
    """
    scene, out = specimen.scene(base), folder / specimen.name
    if not (out / "summary.json").exists():
        file = folder / f"{specimen.name}.toml"
        file.write_text(scene_to_toml(scene))
        print(specimen.name, flush=True)
        command = [sys.executable, "-m", "taichi_ldem.cli", "bend", str(file), "--out", str(out)]
        code = run_child([*command, "--force", *extra])
        if code:
            print(f"{specimen.name}: failed with exit code {code}", flush=True)
            return code
    if not (out / "statics.json").exists():
        (out / "statics.json").write_text(json.dumps(statics(scene)))
    return 0


def series(
    specimens: Sequence[Specimen],
    base: Scene,
    folder: Path,
    extra: Sequence[str] = (),
    others: Sequence[Row] = (),
) -> int:
    """Run what is missing and report after every specimen; the last exit code that is not 0."""
    code = 0
    with RunFolder.held(folder):
        for specimen in specimens:
            code = run(specimen, base, folder, extra) or code
            refuse_moved(folder)
            report(read(specimens, base, folder), base, folder, others)
    return code


def run_series(scene: Scene, out: Path | None, name: str, *, quiet: bool) -> int:
    """Run the paper's eight beams on a scene's module size; returns the exit code.

    Args:
        out: where the run folders go; None: outputs/NAME_series.
    """
    specimens = [Specimen(*beam, scene.plate.spacing) for beam in SPECIMENS]
    folder = Path("outputs", f"{name}_series") if out is None else out
    return series(specimens, scene, folder, ["--quiet"] if quiet else [])


def statics(scene: Scene) -> dict[str, float]:
    """Compliance of a scene's beam with and without its notch, on the lattice, m/N."""
    plate, supports, (notch,) = scene.plate, scene.supports, scene.notch
    assert supports is not None  # the scene refuses a bending test without them
    cell = CELLS[plate.lattice]
    lattice = Lattice(prism(*plate.modules), plate.spacing, plate.surface_weights, cell=cell)
    stiffness = tuple(family.axial_stiffness for family in mat.bars_of(scene))
    (a, b), (c, d) = notch.bounds
    cut = lattice.bars_crossing(notch.axes[0], notch.place, (a, c), (b, d))
    none = np.zeros_like(cut)
    return {
        name: compliance.lattice_compliance(lattice, stiffness, removed, supports.across)
        for name, removed in (("whole_m_n", none), ("notched_m_n", cut))
    }


def evaluate(
    scene: Scene, summary: Mapping[str, Any], static: Mapping[str, float]
) -> dict[str, float]:
    """U, B W phi and the terms that they consist of (see the module), SI units."""
    supports, (notch,) = scene.supports, scene.notch
    assert supports is not None
    _, thickness, width = scene.plate.actual_size
    cell = CELLS[scene.plate.lattice]
    lattice = Lattice(prism(*scene.plate.modules), scene.plate.spacing, cell=cell)
    depth = notch_depth(notch, lattice)
    alpha, beta = depth / width, supports.across / width
    unit = scene.material.youngs_modulus * thickness
    dents = static["whole_m_n"] - compliance.whole_beam(beta) / unit
    in_dents = summary["peak_strain_j"] * dents / static["notched_m_n"]
    area = thickness * width * compliance.calibration(alpha, beta)
    energy = summary["absorbed_j"] - in_dents
    return {
        "spacing_m": scene.plate.spacing,
        "thickness_m": thickness,
        "width_m": width,
        "notch_depth_m": depth,
        "alpha": alpha,
        "b_w_phi_m2": area,
        "work_j": summary["peak_work_j"],
        "kinetic_j": summary["peak_kinetic_j"],
        "contact_j": summary["peak_contact_j"],
        "fracture_j": summary["peak_fracture_j"],
        "dents_j": in_dents,
        "energy_j": energy,
        "energy_over_b_w_phi_j_m2": energy / area,
        "fracture_per_ligament_j_m2": summary["fracture_per_ligament_j_m2"],
        "added_compliance": unit * (static["notched_m_n"] - static["whole_m_n"]),
        "added_compliance_published": compliance.added_by_notch(alpha, beta),
        "peak_time_s": summary["peak_time_s"],
        "beside_plane": summary["fracture_beside_plane_j"] / summary["fracture_j"],
        "left_strain_j": summary["strain_end_j"],
        "left_kinetic_j": summary["kinetic_end_j"],
    }


def fit(rows: Sequence[Row]) -> Row:
    """Straight line through U against B W phi: slope, its 95 % confidence, intercept."""
    from scipy import stats

    x = np.array([row["b_w_phi_m2"] for row in rows])
    y = np.array([row["energy_j"] for row in rows])
    line = stats.linregress(x, y)
    return {
        "spacing_m": rows[0]["spacing_m"],
        "thickness_m": rows[0]["thickness_m"],
        "specimens": len(rows),
        "fracture_energy_slope": float(line.slope),
        "confidence_95": float(stats.t.ppf(0.975, len(x) - 2) * line.stderr),
        "intercept_j": float(line.intercept),
        "slope_through_origin": float(x @ y / (x @ x)),
        "fracture_per_ligament": float(np.mean([r["fracture_per_ligament_j_m2"] for r in rows])),
        "beside_plane": float(np.mean([r["beside_plane"] for r in rows])),
    }


def read(specimens: Sequence[Specimen], base: Scene, folder: Path) -> list[Row]:
    """Rows of the finished specimens."""
    rows = []
    for specimen in specimens:
        files = [folder / specimen.name / name for name in ("summary.json", "statics.json")]
        if all(file.exists() for file in files):
            summary, static = map(read_object, files)
            rows.append(evaluate(specimen.scene(base), summary, static))
    return rows


COLUMNS = (
    ("L [mm]", "spacing_m", 1e3, ".3g"),
    ("B [mm]", "thickness_m", 1e3, ".3g"),
    ("W [mm]", "width_m", 1e3, ".2f"),
    ("a [mm]", "notch_depth_m", 1e3, ".3f"),
    ("a/W", "alpha", 1, ".3f"),
    ("B W phi [mm2]", "b_w_phi_m2", 1e6, ".2f"),
    ("peak [ms]", "peak_time_s", 1e3, ".3f"),
    ("work [mJ]", "work_j", 1e3, ".2f"),
    ("kinetic [mJ]", "kinetic_j", 1e3, ".2f"),
    ("contact loss [mJ]", "contact_j", 1e3, ".3f"),
    ("dents [mJ]", "dents_j", 1e3, ".2f"),
    ("U [mJ]", "energy_j", 1e3, ".2f"),
    ("of it fracture [mJ]", "fracture_j", 1e3, ".2f"),
    ("U/(B W phi) [J/m2]", "energy_over_b_w_phi_j_m2", 1, ".0f"),
    ("fracture/ligament [J/m2]", "fracture_per_ligament_j_m2", 1, ".0f"),
    ("of it beside the plane [%]", "beside_plane", 100, ".1f"),
    ("strain left [mJ]", "left_strain_j", 1e3, ".2f"),
    ("kinetic left [mJ]", "left_kinetic_j", 1e3, ".2f"),
    ("E B (C - C0), lattice", "added_compliance", 1, ".2f"),
    ("published", "added_compliance_published", 1, ".2f"),
)
FITS = (
    ("L [mm]", "spacing_m", 1e3, ".3g"),
    ("B [mm]", "thickness_m", 1e3, ".3g"),
    ("specimens", "specimens", 1, "d"),
    ("slope [J/m2]", "fracture_energy_slope", 1, ".0f"),
    ("95 % [J/m2]", "confidence_95", 1, ".0f"),
    ("intercept [mJ]", "intercept_j", 1e3, ".2f"),
    ("slope through 0 [J/m2]", "slope_through_origin", 1, ".0f"),
    ("fracture/ligament, mean [J/m2]", "fracture_per_ligament", 1, ".0f"),
    ("of it beside the plane, mean [%]", "beside_plane", 100, ".1f"),
)


def table(rows: Sequence[Row], columns: Sequence[tuple[str, str, float, str]]) -> str:
    """Rows as a Markdown table."""
    lines = ["| " + " | ".join(title for title, *_ in columns) + " |", "|---" * len(columns) + "|"]
    for row in rows:
        cells = (format(row[key] * scale, form) for _, key, scale, form in columns)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def figure(rows: Sequence[Row], fits: Sequence[Row], given: float, file: Path) -> None:
    """Draw U/B against W phi with the lines, the input's slope and the measured band."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(9, 6.5), dpi=130, layout="constrained")
    FigureCanvasAgg(drawing)
    axes = drawing.add_subplot(
        xlabel=r"$W \phi$ [mm]", ylabel="U / B [mJ/mm]: energy absorbed when the crack runs"
    )
    largest = max(row["b_w_phi_m2"] / row["thickness_m"] for row in rows)
    ends = np.array([0.0, 1.1e3 * largest])
    low, high = (1e-3 * g * ends for g in (MEASURED - SCATTER, MEASURED + SCATTER))
    label = f"experiments (paper): {MEASURED:.0f} +- {SCATTER:.0f} J/m2"
    axes.fill_between(ends, low, high, color="tab:red", alpha=0.15, lw=0, label=label)
    axes.plot(ends, 1e-3 * given * ends, "k--", lw=1, label=f"input G_f: {given:.0f} J/m2")
    for number, line in enumerate(fits):
        mine = [row for row in rows if row["spacing_m"] == line["spacing_m"]]
        x, y = (
            np.array([row[key] / row["thickness_m"] for row in mine])
            for key in ("b_w_phi_m2", "energy_j")
        )
        axes.plot(1e3 * x, y, "os^D"[number % 4], color=f"C{number}", ms=8)
        slope, error = line["fracture_energy_slope"], line["confidence_95"]
        fitted = 1e-3 * slope * ends + line["intercept_j"] / line["thickness_m"]
        label = (
            f"L = {1e3 * line['spacing_m']:.3g} mm, B = {1e3 * line['thickness_m']:.3g} mm: "
            f"slope {slope:.0f} +- {error:.0f} J/m2 (95 %)"
        )
        axes.plot(ends, fitted, color=f"C{number}", label=label)
    axes.set_xlim(*ends)
    axes.set_ylim(bottom=min(0.0, *(line["intercept_j"] / line["thickness_m"] for line in fits)))
    axes.grid(alpha=0.3)
    axes.legend(loc="upper left")
    drawing.savefig(file)


def report(rows: Sequence[Row], base: Scene, folder: Path, others: Sequence[Row] = ()) -> None:
    """Write ``summary.json``, ``bending.md`` and ``bending.png`` for lattices of three or more.

    Args:
        others: rows of other series, on other modules, for comparison.
    """
    rows = [*rows, *others]
    groups = [[r for r in rows if r["spacing_m"] == s] for s in {r["spacing_m"]: 0 for r in rows}]
    fits = [fit(group) for group in groups if len(group) > 2]
    if not fits:
        return
    finest = min(fits, key=lambda line: float(line["spacing_m"]))
    numbers = {
        "fracture_energy_slope": finest["fracture_energy_slope"],
        "lattices": fits,
        "specimens": rows,
    }
    (folder / "summary.json").write_text(json.dumps(numbers, indent=2) + "\n")
    (folder / "bending.md").write_text(table(fits, FITS) + "\n" + table(rows, COLUMNS))
    assert base.material.fracture_energy is not None
    figure(rows, fits, base.material.fracture_energy, folder / "bending.png")


def main() -> None:
    """Run what is missing and report after every specimen."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scene", type=Path, help="base scene: configs/bend.toml")
    parser.add_argument("folder", type=Path, help="where the run folders go")
    parser.add_argument("--spacings", nargs="*", type=float, default=SPACINGS, metavar="M")
    every = range(len(SPECIMENS))
    parser.add_argument(
        "--specimens", nargs="+", type=int, default=every, choices=every, metavar="N",
        help="numbers from 0 of those to run: all eight",
    )  # fmt: skip
    parser.add_argument("--set", action="append", default=[], metavar="SECTION.KEY=VALUE")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--beside", nargs="+", type=Path, default=[], help="finished series")
    options = parser.parse_args()
    base = load_scene(options.scene, options.set)
    beams = [SPECIMENS[number] for number in options.specimens]
    specimens = [Specimen(*beam, spacing) for spacing in options.spacings for beam in beams]
    extra = ["--threads", str(options.threads)] if options.threads else []
    finished = [read_object(folder / "summary.json") for folder in options.beside]
    others = [row for numbers in finished for row in numbers["specimens"]]
    with courteous():
        try:
            code = series(specimens, base, options.folder, extra, others)
        except Signalled as signalled:
            code = 128 + signalled.number
    sys.exit(code)


if __name__ == "__main__":
    main()
