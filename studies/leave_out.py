"""Savings by the features that scenes leave out: fields, bytes, kernels and milliseconds a step.

python -m studies.leave_out configs/*.toml [--out DIR] [--rounds 3] [--threads N]
"""

import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path

from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios.leave_out import Cost, compare, everything
from taichi_ldem.scene import load_scene


def table(costs: dict[str, tuple[Cost, Cost]]) -> str:
    """Every scene compared with all features on its lattice, as Markdown."""
    heads = ["scene", "fields", "MB", "kernels", "ms/step", "bytes", "time"]
    heads[1:5] = [f"{head}: its own, everything" for head in heads[1:5]]
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for name, (own, full) in costs.items():
        cells = [name, f"{own.fields}, {full.fields}"]
        cells.append(f"{own.bytes / 1e6:.2f}, {full.bytes / 1e6:.2f}")
        cells.append(f"{own.kernels}, {full.kernels}")
        share = f"{100 * own.bytes / full.bytes:.0f} %"
        if own.ms is None or full.ms is None:
            cells += ["", share, ""]
        else:
            cells += [f"{own.ms:.3g}, {full.ms:.3g}", share, f"{100 * own.ms / full.ms:.0f} %"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare scenes, print the table and write it."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scenes", type=Path, nargs="+")
    parser.add_argument("--out", type=Path, default=Path("outputs/leave_out"))
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--threads", type=int)
    options = parser.parse_args(arguments)
    extra = [f"solver.threads={options.threads}"] if options.threads else []
    costs = {}
    for file in options.scenes:
        try:
            scene = load_scene(file, extra)
            pair = {"own": scene, "everything": everything(scene)}
        except SceneError as error:
            print(f"{file.stem}: {error}", file=sys.stderr)
            continue
        found = compare(pair, options.out / file.stem, options.rounds)
        costs[file.stem] = (found["own"], found["everything"])
        text = table(costs)
        (options.out / "leave_out.md").write_text(text, encoding="utf-8")
        print(text.splitlines()[-1], flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
