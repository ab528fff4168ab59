"""Compares readings of the paper with its figures; each differs in one quantity.

The paper's printed numbers contradict its equations (docs/reproduction.md). Every reading runs in a
process and a folder of its own. Finished readings are not repeated, so the study can be interrupted
and resumed:

    python -m studies.readings configs/impact.toml outputs/readings [--only NAME ...]
"""

import json
import subprocess
import sys
from argparse import ArgumentParser
from dataclasses import dataclass
from pathlib import Path

MEASURED = "material.failure_strain=0.02238805970149254"  # 75 MPa / 3.35 GPa
BRITTLE = "material.limit_strain=0.02238805970149254"
FULL = "plate.surface_weights=false"
PRINTED = ("material.failure_strain=0.01818", "material.limit_strain=0.02238")
# to save time: the energy error of brittle bars is smaller than that of others
FASTER = "solver.safety=0.7"
# past the first peak, with a larger step than the default to save time: compare with "early"
EARLY = ("solver.duration=2.5e-3", "solver.safety=0.9", "output.image_times=[]")
MIDDLE = "striker.position=[0.0002666666666666667, 0.0002666666666666667]"  # half of L


@dataclass(frozen=True)
class Reading:
    """A named set of overrides of the base scene, with its description."""

    name: str
    overrides: tuple[str, ...]
    meaning: str

    @property
    def early(self) -> bool:
        """Whether it stops soon after the first peak."""
        return EARLY[0] in self.overrides


READINGS = (
    Reading("derived", (), "derived defaults"),
    Reading(
        "full-measured",
        (FULL, MEASURED, BRITTLE, FASTER),
        "full face bars, eps_p = eps_r = 75 MPa / E",
    ),
    Reading("early", EARLY, "derived defaults, larger step"),
    Reading("full", (FULL, *EARLY), "full face bars"),
    Reading("printed-strains", (FULL, *PRINTED, *EARLY), "full face bars, printed strains"),
    Reading(
        "as-printed",
        (FULL, *PRINTED, "plate.stiffness=as-printed", "material.fracture_areas=paper", *EARLY),
        "full face bars, printed strains and EA_d",
    ),
    Reading("bonded", ("clamp.kind=bonded", *EARLY), "bonded rings"),
    Reading("measured", (MEASURED, BRITTLE, *EARLY), "eps_p = eps_r = 75 MPa / E"),
    Reading(
        "eight-measured",
        ("plate.modules_through_thickness=8", MEASURED, *EARLY),
        "eight modules, eps_p = 75 MPa / E",
    ),
    Reading("eight", ("plate.modules_through_thickness=8", *EARLY), "eight modules"),
    Reading("middle", (MIDDLE, *EARLY), "striker over the middle of a module"),
    Reading("gravity", ("striker.gravity=9.81", *EARLY), "gravity on the striker"),
    Reading(
        "full-measured-middle",
        (FULL, MEASURED, BRITTLE, MIDDLE, FASTER),
        "full face bars, 75 MPa / E, striker over the middle of a module",
    ),
)

BEFORE_END = 3  # columns that a run which stops early can fill
COLUMNS = (
    ("onset [ms]", "damage_onset_time_s", 1e3, ".2f"),
    ("P1 [N]", "first_peak_force_n", 1, ".0f"),
    ("t1 [ms]", "first_peak_time_s", 1e3, ".2f"),
    ("P2 [N]", "second_peak_force_n", 1, ".0f"),
    ("t2 [ms]", "failure_time_s", 1e3, ".2f"),
    ("v end [m/s]", "striker_velocity_end_m_s", 1, ".3f"),
    ("fracture [J]", "fracture_j", 1, ".3f"),
    ("energy error of plate [%]", "energy_error_of_plate", 100, ".2f"),
)


def run(reading: Reading, scene: Path, folder: Path, extra: list[str]) -> None:
    """Run a reading in a process of its own, unless it is finished already."""
    out = folder / reading.name
    if (out / "summary.json").exists():
        return
    settings = [word for text in reading.overrides for word in ("--set", text)]
    command = [sys.executable, "-m", "taichi_ldem.cli", "impact", str(scene), "--out", str(out)]
    print(f"{reading.name}: {reading.meaning}", flush=True)
    done = subprocess.run([*command, "--force", *settings, *extra], check=False)
    if done.returncode:
        print(f"{reading.name}: failed with exit code {done.returncode}", flush=True)


def table(folder: Path) -> str:
    """The finished readings as a Markdown table."""
    lines = [
        "| reading | " + " | ".join(title for title, *_ in COLUMNS) + " |",
        "|---" * (len(COLUMNS) + 1) + "|",
    ]
    for reading in READINGS:
        file = folder / reading.name / "summary.json"
        if file.exists():
            values = json.loads(file.read_text())
            said = BEFORE_END if reading.early else len(COLUMNS)
            cells = [
                "-" if number >= said or values[key] is None else format(values[key] * scale, form)
                for number, (_, key, scale, form) in enumerate(COLUMNS)
            ]
            lines.append(f"| {reading.meaning} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def figure(folder: Path, file: Path) -> None:
    """Draw the smoothed force of every reading, finished or not, with the paper's marks."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    from taichi_ldem.analysis.signals import smooth_force
    from taichi_ldem.analysis.window import PLATE_WINDOW, in_words
    from taichi_ldem.storage.folder import RunFolder

    drawing = plt.figure(figsize=(10, 6), layout="constrained")
    axes = drawing.add_subplot()
    for reading in READINGS:
        if (folder / reading.name / "history.csv").exists():
            history = RunFolder(folder / reading.name).read_history()
            force = smooth_force(history["time_s"], history["striker_force_n"], PLATE_WINDOW)
            width = 1.0 if reading.early else 2.2
            axes.plot(1e3 * history["time_s"], force, lw=width, label=reading.meaning)
    axes.plot(1.75, 600, "D", mfc="none", mec="tab:red", ms=9, label="experiments, P1, t1")
    axes.fill_between([6.4, 9.4], 600, 830, color="tab:red", alpha=0.15, lw=0)
    axes.text(7.9, 800, "experiments, P2 and t2", color="tab:red", ha="center", va="top")
    axes.axvline(7.5, color="tab:red", ls="--", lw=1, label="paper's LDEM, t2")
    quantity = f"striker force, mean over {in_words(PLATE_WINDOW)} [N]"
    axes.set(xlabel="time [ms]", ylabel=quantity, xlim=(0, 10))
    axes.set_ylim(bottom=0)
    axes.grid(alpha=0.3)
    drawing.legend(loc="outside lower center", ncols=2, fontsize=9)
    drawing.savefig(file, dpi=130)
    plt.close(drawing)


def main() -> None:
    """Run what is missing, write ``readings.md`` and ``readings.png``."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scene", type=Path, help="base scene: configs/impact.toml")
    parser.add_argument("folder", type=Path, help="where the run folders go")
    parser.add_argument("--only", nargs="*", choices=[r.name for r in READINGS], metavar="NAME")
    parser.add_argument("--threads", type=int)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    extra = ["--threads", str(options.threads)] if options.threads else []
    for reading in READINGS:
        if not options.only or reading.name in options.only:
            run(reading, options.scene, options.folder, extra)
        (options.folder / "readings.md").write_text(table(options.folder))
        figure(options.folder, options.folder / "readings.png")


if __name__ == "__main__":
    main()
