"""f32 compared with f64 over whole runs, and with the spread between seeds, from run folders.

    python -m studies.precision --double outputs/impact --single outputs/impact_f32
        [--seeds outputs/impact_cv10/* ...] [--out docs/...md]

The folders are those of `ldem impact SCENE --out DIR --precision f32`. The spread is
the standard deviation between the folders of --seeds (random specimens, or the striker a fraction
of a module to the side); a much smaller difference is insignificant.
"""

import json
import statistics
import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path

from taichi_ldem.errors import SceneError

QUANTITIES = (
    ("first peak time t1 [ms]", "first_peak_time_s", 1e3),
    ("first peak force P1 [N]", "first_peak_force_n", 1.0),
    ("second peak force P2 [N]", "second_peak_force_n", 1.0),
    ("failure time t2 [ms]", "failure_time_s", 1e3),
    ("fracture energy [J]", "fracture_j", 1.0),
    ("contact loss [J]", "contact_j", 1.0),
    ("striker's velocity at the end [m/s]", "striker_velocity_end_m_s", 1.0),
    ("energy error of the plate [%]", "energy_error_of_plate", 100.0),
    ("seconds of stepping", "wall_s", 1.0),
)


def summary(folder: Path) -> dict[str, float | None]:
    """The numbers of a finished run.

    Raises:
        SceneError: the folder holds none.
    """
    file = folder / "summary.json"
    if not file.is_file():
        raise SceneError(f"'{folder}' holds no finished run (no summary.json)")
    found: dict[str, float | None] = json.loads(file.read_text(encoding="utf-8"))
    return found


def table(double: Path, single: Path, seeds: Sequence[Path]) -> str:
    """Both precisions, their difference, and the spread between seeds, as Markdown."""
    one, other = summary(double), summary(single)
    spread = [summary(folder) for folder in seeds]
    heads = ["quantity", "f64", "f32", "difference", "deviation between seeds", "share of it"]
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for title, key, scale in QUANTITIES:
        first, second = one.get(key), other.get(key)
        if first is None or second is None:
            lines.append(f"| {title} | - | - | - | - | - |")
            continue
        difference = scale * (second - first)
        cells = [f"{scale * first:.4g}", f"{scale * second:.4g}", f"{difference:+.2g}"]
        values = [value for s in spread if (value := s.get(key)) is not None]
        deviation = scale * statistics.stdev(values) if len(values) > 1 else None
        cells.append("-" if deviation is None else f"{deviation:.2g} ({len(values)} runs)")
        cells.append(f"{abs(difference) / deviation:.2f}" if deviation else "-")
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table, and write it."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--double", type=Path, required=True, metavar="DIR")
    parser.add_argument("--single", type=Path, required=True, metavar="DIR")
    parser.add_argument("--seeds", type=Path, nargs="*", default=[], metavar="DIR")
    parser.add_argument("--out", type=Path, metavar="FILE.md")
    options = parser.parse_args(arguments)
    try:
        text = table(options.double, options.single, options.seeds)
    except SceneError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(text, end="")
    if options.out:
        options.out.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
