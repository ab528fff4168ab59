"""The report of the reproduction, in Markdown."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from taichi_ldem.errors import DamagedFile, SceneError
from taichi_ldem.reproduction.runs import NEEDS
from taichi_ldem.reproduction.sections import Context, Item, Section


class Report(NamedTuple):
    """The report in Markdown, and what is wrong with files that it should have been made from."""

    text: str
    damaged: tuple[str, ...]


def write(
    items: Sequence[Item], context: Context, failed: Mapping[str, str], quick: bool = False
) -> Report:
    """The report, from the run folders; pictures are copied into its folder.

    Args:
        failed: runs without a result, each with the reason.
        quick: whether the runs are quick ones.
    """
    command = "ldem paper --quick" if quick else "ldem paper"
    parts = [
        "# The paper, recomputed\n\n"
        f"Made by `{command}`. Every number in the columns *computed* comes from a run folder "
        "below `runs/`. The paper gives no digital curves: its and the experiments' values are "
        "those of its text and tables.\n"
    ]
    if quick:
        parts.append(
            "\nQuick: five modules through the thickness, f32 and 0.8 of the critical step for "
            "the homogeneous specimen, half the specimen with three modules and two seeds for the "
            "random ones, coarser lattices elsewhere. "
            "For a first look, not for comparison.\n"
        )
    damaged: dict[str, None] = {}
    for item in items:
        parts.append(f"\n## {item.title}\n\n")
        reason = next((failed[name] for name in item.needs if name in failed), None)
        try:
            if reason is not None:
                raise SceneError(reason)
            parts.append(_section(item, item.make(context), context))
        except (SceneError, OSError, StopIteration) as error:
            parts.append(f"Missing: {error or 'a file of the run is not there'}.\n")
            damaged |= {str(error): None} if isinstance(error, DamagedFile) else {}
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            runs = ", ".join(f"'{context.folder(name)}'" for name in item.needs)
            text = f"files of {runs} do not fit together: {type(error).__name__}: {error}"
            parts.append(f"Missing: {text}.\n")
            damaged[text] = None
    parts.append(_costs(context))
    return Report("".join(parts), tuple(damaged))


def _section(item: Item, section: Section, context: Context) -> str:
    parts = []
    if section.rows:
        head = ("quantity", "computed", "paper", "experiments", "difference")
        parts.append(f"| {' | '.join(head)} |\n{'|---' * len(head)}|\n")
        parts += [f"| {' | '.join(row.cells())} |\n" for row in section.rows]
        parts.append("\n")
    if section.markdown:
        parts.append(section.markdown.rstrip() + "\n\n")
    for number, (file, caption) in enumerate(section.pictures):
        copy = context.picture(f"{item.key}_{number}" if len(section.pictures) > 1 else item.key)
        copy.parent.mkdir(parents=True, exist_ok=True)
        if file != copy:
            shutil.copyfile(file, copy)
        parts.append(f"![{item.title}: {caption}](images/{copy.name})\n")
    if section.why:
        parts.append(f"\n{section.why}\n")
    return "".join(parts)


def _costs(context: Context) -> str:
    rows = []
    for name in NEEDS:
        file = context.folder(name) / "summary.json"
        if not file.is_file():
            continue
        try:
            summary = context.summary(name)
        except DamagedFile:  # named at the items that need it
            continue
        record = summary.get("provenance")
        sha = str(record.get("scene_sha256", "")) if isinstance(record, dict) else ""
        wall = summary.get("wall_s")
        spent = "" if wall is None else f"{wall:.0f}"
        rows.append(f"| {name} | {spent} | `{sha[:12]}` |\n")
    if not rows:
        return ""
    return "\n## Cost\n\n| run | stepping [s] | scene |\n|---|---|---|\n" + "".join(rows)
