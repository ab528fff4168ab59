"""Frequencies against the number of modules through the thickness, compared with finite elements.

Every size runs `ldem modes` in a process and a folder of its own. Finished sizes are not repeated,
so the study can be interrupted and resumed. `frequencies.md` holds the table, written after each
run:

    python -m studies.frequencies configs/modes.toml outputs/frequencies
        [--modules 3 4 6 8] [--count 30] [--refine 2 3] [--set KEY=VALUE ...]
"""

import json
import math
import subprocess
import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Scene, load_scene


def key(modules: int) -> str:
    """The override that sets the number of modules through the thickness."""
    return f"plate.modules_through_thickness={modules}"


def run(modules: int, count: int, scene: Path, folder: Path, extra: Sequence[str]) -> None:
    """Compute one size in a process of its own, unless its folder is finished already."""
    out = folder / f"{modules}_modules"
    if (out / "summary.json").exists():
        return
    command = [sys.executable, "-m", "taichi_ldem.cli", "modes", str(scene), "--out", str(out)]
    command += ["--force", "--count", str(count), *extra, "--set", key(modules)]
    print(f"{modules} modules", flush=True)
    done = subprocess.run(command, check=False)
    if done.returncode:
        print(f"{modules} modules: failed with exit code {done.returncode}", flush=True)


def reference(scene: Scene, refine: int, count: int, folder: Path) -> dict[str, list[float]]:
    """Finite-element frequencies (Hz) by name, ascending; kept in the folder."""
    file = folder / f"finite_elements_{refine}.json"
    if not file.exists():
        from taichi_ldem.studies import finite_elements as fe

        print(f"finite elements, refined {refine} times", flush=True)
        part, constants = fe.scene_part(scene, refine), fe.scene_constants(scene)
        each = max(4, count // 3)
        found = fe.plate_modes(part, constants, scene.material.density, each)
        if not scene.held:
            found += fe.plate_modes(part, constants, scene.material.density, each, bending=False)
        by_name: dict[str, list[float]] = {}
        for frequency, name in sorted(found, key=lambda item: item[0]):
            by_name.setdefault(str(name), []).append(frequency)
        if not scene.held:  # unnamed modes: one ascending list without rigid motions
            every = sorted(f for values in by_name.values() for f in values)
            by_name = {"elastic": [f for f in every if f > 1e-3 * every[-1]]}
        file.write_text(json.dumps(by_name, indent=1) + "\n")
    known: dict[str, list[float]] = json.loads(file.read_text())
    return known


def lattice(folder: Path, modules: int) -> dict[str, list[float]]:
    """A finished size's frequencies (Hz) by name, ascending; empty where it is not finished."""
    file = folder / f"{modules}_modules" / "summary.json"
    if not file.exists():
        return {}
    values = json.loads(file.read_text())
    by_name: dict[str, list[float]] = {}
    for name, frequency in zip(values["names"], values["frequencies_hz"], strict=True):
        by_name.setdefault("elastic" if name == "other" else name, []).append(frequency)
    return by_name


def pairs(found: dict[str, list[float]], exact: dict[str, list[float]]) -> dict[str, float]:
    """Relative error of each named mode against the reference: of the mean where there are two."""
    errors = {}
    for name, values in found.items():
        if name not in exact or name in ("outside", "in-plane", "rigid"):
            continue
        if name == "elastic":
            for number, (value, true) in enumerate(zip(values, exact[name], strict=False), 1):
                errors[f"{number}"] = value / true - 1
            continue
        wanted = exact[name][: len(values)]
        if len(wanted) == len(values) and (len(values) == 2 or name.startswith("(0")):
            errors[name] = float(np.mean(values) / np.mean(wanted)) - 1
    return errors


def order(errors: dict[int, float]) -> float:
    """Observed order p of error ~ modules^-p, by least squares of the logarithms."""
    sizes = [n for n, error in errors.items() if error != 0]
    if len(sizes) < 2:
        return math.nan
    slope = np.polyfit(np.log(sizes), np.log([abs(errors[n]) for n in sizes]), 1)[0]
    return float(-slope)


def table(folder: Path, modules: Sequence[int], exact: Sequence[dict[str, list[float]]]) -> str:
    """Errors of the finished sizes and their order, as Markdown."""
    best = exact[-1]
    errors = {n: pairs(lattice(folder, n), best) for n in modules if lattice(folder, n)}
    names = list(dict.fromkeys(name for found in errors.values() for name in found))
    heads = ["mode", "finite elements [kHz]", "mesh error [%]"]
    heads += [f"{n} modules: error [%]" for n in errors] + ["order"]
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for name in names:
        true, rough = _frequency(best, name), _frequency(exact[0], name)
        mine = {n: found[name] for n, found in errors.items() if name in found}
        cells = [name, f"{1e-3 * true:.3f}"]
        cells.append(f"{100 * (rough / true - 1):+.2f}" if len(exact) > 1 else "")
        cells += [f"{100 * mine[n]:+.2f}" if n in mine else "" for n in errors]
        lines.append("| " + " | ".join([*cells, f"{order(mine):.1f}"]) + " |")
    return "\n".join(lines) + "\n"


def _frequency(exact: dict[str, list[float]], name: str) -> float:
    if name.isdigit():
        return exact["elastic"][int(name) - 1]
    return float(np.mean(exact[name][:2])) if not name.startswith("(0") else exact[name][0]


def cost(folder: Path, modules: Sequence[int]) -> str:
    """Size, time and memory of the finished sizes, as Markdown."""
    heads = "| modules | degrees of freedom | modes | products | wall time [s] | memory [GB] |"
    lines = [heads, "|---" * 6 + "|"]
    for n in modules:
        file = folder / f"{n}_modules" / "summary.json"
        if file.exists():
            v = json.loads(file.read_text())
            lines.append(
                f"| {n} | {v['degrees_of_freedom']:,} | {len(v['frequencies_hz'])} | "
                f"{v['products']:,} | {v['wall_s']:.0f} | {v['peak_memory_bytes'] / 1e9:.1f} |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run what is missing and write ``frequencies.md``."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("scene", type=Path, help="base scene: configs/modes.toml")
    parser.add_argument("folder", type=Path, help="where the run folders go")
    parser.add_argument("--modules", type=int, nargs="+", default=[3, 4, 6, 8])
    parser.add_argument("--count", type=int, default=30, help="modes of each size")
    parser.add_argument("--refine", type=int, nargs="+", default=[2, 3], help="two meshes")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    try:
        scene = load_scene(options.scene, options.settings)
        exact = [reference(scene, r, options.count, options.folder) for r in options.refine]
    except SceneError as error:
        sys.exit(f"error: {error}")
    extra = [word for text in options.settings for word in ("--set", text)]
    extra += ["--threads", str(options.threads)] if options.threads else []
    for modules in options.modules:
        run(modules, options.count, options.scene, options.folder, extra)
        text = table(options.folder, options.modules, exact)
        text += "\n" + cost(options.folder, options.modules)
        (options.folder / "frequencies.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
