"""The gallery's page: each problem with its findings and its figure."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from taichi_ldem.gallery.problem import Finding, Problem, Runs
from taichi_ldem.output.figures.draw import save
from taichi_ldem.storage.durable import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure


IMAGES = "images/gallery"
"""Where pictures lie beside the page, so that both can be copied into a folder of docs."""


@dataclass(frozen=True)
class Outcome:
    """What came out of a problem.

    Attributes:
        seconds: of stepping, of all its runs.
        failed: runs without a result, each with the reason.
    """

    name: str
    problem: Problem
    runs: Runs
    findings: Sequence[Finding]
    seconds: float
    failed: Mapping[str, str]

    @property
    def verdict(self) -> str:
        """One line on the problem."""
        if self.failed:
            return f"{len(self.failed)} of {len(self.failed) + len(self.runs)} runs failed"
        held = sum(finding.holds for finding in self.findings)
        total = len(self.findings)
        return f"all {total} hold" if held == total else f"{held} of {total} hold"


def judged(name: str, problem: Problem, runs: Runs, failed: Mapping[str, str]) -> Outcome:
    """The outcome of a problem; without findings where a run is missing."""
    findings = [] if failed else problem.judge(runs)
    seconds = sum(float(run.summary.get("wall_s", 0.0)) for run in runs.values())
    return Outcome(name, problem, runs, findings, seconds, failed)


def write(outcomes: Sequence[Outcome], out: Path, *, quick: bool) -> Path:
    """Write ``gallery.md``, ``gallery.json`` and a picture for each problem; returns the page."""
    parts = [_head(outcomes, quick=quick)]
    for outcome in outcomes:
        image = out / IMAGES / f"{outcome.name}.png"
        if not outcome.failed:
            image.parent.mkdir(parents=True, exist_ok=True)
            save(image, partial(_draw, outcome), size=outcome.problem.size, dpi=110)
        parts.append(_section(outcome))
    record = {
        "quick": quick,
        "problems": {
            outcome.name: {
                "verdict": outcome.verdict,
                "seconds": outcome.seconds,
                "failed": dict(outcome.failed),
                "findings": [asdict(f) | {"holds": f.holds} for f in outcome.findings],
            }
            for outcome in outcomes
        },
    }
    write_whole(out / "gallery.json", (json.dumps(record, indent=2, default=float) + "\n").encode())
    write_whole(out / "gallery.md", "".join(parts).encode())
    return out / "gallery.md"


def _draw(outcome: Outcome, figure: Figure) -> None:
    outcome.problem.draw(figure, outcome.runs)


def _head(outcomes: Sequence[Outcome], *, quick: bool) -> str:
    command = "ldem gallery --quick" if quick else "ldem gallery"
    rows = [
        f"| [{o.problem.title}](#{_anchor(o.problem.title)}) | {o.verdict} | {o.seconds:.0f} |\n"
        for o in outcomes
    ]
    note = (
        "Quick: coarser lattices and fewer runs, to see that every problem works; some miss their"
        " reference for that reason.\n\n"
        if quick
        else ""
    )
    return (
        "# Gallery\n\n"
        f"Made by `{command}`. References and tolerances come from the sources that are named, not"
        " from this program. A number counts as a hit where it lies within the reference's"
        " interval.\n\n"
        f"{note}"
        "| problem | verdict | stepping [s] |\n|---|---|---|\n" + "".join(rows)
    )


def _anchor(title: str) -> str:
    kept = "".join(c for c in title.lower() if c.isalnum() or c in " -_")
    return kept.replace(" ", "-")


def _section(outcome: Outcome) -> str:
    problem = outcome.problem
    text = f"\n## {problem.title}\n\n{problem.about}\n\nSource: {problem.source}\n\n"
    for run, reason in outcome.failed.items():
        text += f"Missing: {run}: {reason}.\n\n"
    if outcome.findings:
        text += (
            "| quantity | reference | computed | difference | verdict |\n|---|---|---|---|---|\n"
        )
        text += "".join(_row(finding) for finding in outcome.findings)
    if not outcome.failed:
        text += f"\n![{problem.title}]({IMAGES}/{outcome.name}.png)\n"
    if problem.why:
        text += f"\n{problem.why}\n"
    return text


def _row(finding: Finding) -> str:
    name = f"{finding.quantity} [{finding.unit}]" if finding.unit else finding.quantity
    name = f"{finding.run}: {name}" if finding.run else name
    computed = "none" if finding.computed is None else f"{finding.computed:.4g}"
    verdict = "holds" if finding.holds else "**misses**"
    return f"| {name} | {finding.reference} | {computed} | {finding.difference} | {verdict} |\n"
