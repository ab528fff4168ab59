"""The report of the reproduction, in Markdown."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence

from taichi_ldem.errors import SceneError
from taichi_ldem.reproduction.runs import NEEDS
from taichi_ldem.reproduction.sections import Context, Item, Section


def write(
    items: Sequence[Item], context: Context, failed: Mapping[str, str], quick: bool = False
) -> str:
    """The report in Markdown, from the run folders; pictures are copied into its folder.

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
    for item in items:
        parts.append(f"\n## {item.title}\n\n")
        reason = next((failed[name] for name in item.needs if name in failed), None)
        try:
            if reason is not None:
                raise SceneError(reason)
            parts.append(_section(item, item.make(context), context))
        except (SceneError, OSError, KeyError, StopIteration) as error:
            parts.append(f"Missing: {error or 'a file of the run is not there'}.\n")
    parts.append(_costs(context))
    return "".join(parts)


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
        summary = json.loads(file.read_text(encoding="utf-8"))
        wall, sha = summary.get("wall_s"), summary.get("provenance", {}).get("scene_sha256", "")
        spent = "" if wall is None else f"{wall:.0f}"
        rows.append(f"| {name} | {spent} | `{sha[:12]}` |\n")
    if not rows:
        return ""
    return "\n## Cost\n\n| run | stepping [s] | scene |\n|---|---|---|\n" + "".join(rows)
