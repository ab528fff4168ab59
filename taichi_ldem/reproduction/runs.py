"""The runs that the paper's figures and tables need, and the commands that make them."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from taichi_ldem.analysis.paper import DISORDER_CVS
from taichi_ldem.reading import read_object
from taichi_ldem.scenarios.interrupts import run_child
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.place import refuse_moved
from taichi_ldem.studies.bending import SPECIMENS

CVS = ",".join(f"{cv:g}" for cv in (0.0, *DISORDER_CVS))
"""Coefficients of variation of G_f in the ensemble, as the command takes them."""


@dataclass(frozen=True)
class Need:
    """A run folder and the command that makes it.

    Attributes:
        words: after the interpreter; "{out}" stands for the folder.
        quick: words added for a quick run.
        quick_scene: stands for the scene in a quick run, if another.
        done: the file that a finished run has.
        resume: words that continue a folder that was begun.
    """

    name: str
    words: tuple[str, ...]
    quick: tuple[str, ...] = ()
    done: str = "summary.json"
    resume: tuple[str, ...] = ()
    quick_scene: str = ""

    def command(self, folder: Path, *, quick: bool, again: bool) -> list[str]:
        """Words after the interpreter, to begin or to continue."""
        words = self.resume if again else self.words
        if quick and words[2:3] != ("resume",):
            scene = self.quick_scene or words[3]
            words = (*words[:3], scene, *words[4:], *self.quick)
        return [word.format(out=folder) for word in words]


_LDEM = ("-m", "taichi_ldem.cli")
_RESUME = (*_LDEM, "resume", "{out}", "--quiet")
# Single precision shortens thirteen runs and a first look most (docs/error-vs-run-time.md gives the
# error that this adds).
_FASTER = ("--precision", "f32")
_FIVE = ("--set", "plate.modules_through_thickness=5", *_FASTER)
_TO_OUT = ("--out", "{out}", "--quiet", "--force")
_STUDY = ("-m", "taichi_ldem.studies.bending", "configs/bend.toml", "{out}", "--spacings", "5e-4")

_MANY = (
    *(*_LDEM, "ensemble", "configs/impact_measured_strength.toml", "--cv", CVS),
    *("--seeds", "0:4", *_FASTER),
)

NEEDS: dict[str, Need] = {
    need.name: need
    for need in (
        Need("impact", (*_LDEM, "impact", "configs/impact.toml", *_TO_OUT), _FIVE, resume=_RESUME),
        Need(
            "measured",
            (*_LDEM, "impact", "configs/impact_measured_strength.toml", *_TO_OUT),
            _FIVE,
            resume=_RESUME,
        ),
        Need(
            "tension",
            (*_LDEM, "tension", "configs/tension_dumbbell.toml", *_TO_OUT),
            ("--set", "plate.modules_through_thickness=5"),
            resume=_RESUME,
        ),
        Need(
            "bending",
            (*_STUDY, "--set", "solver.duration=0.8e-3"),
            ("--set", "plate.size=[0.030, 0.001, 0.0065]"),
            resume=(*_STUDY, "--set", "solver.duration=0.8e-3"),
        ),
        Need(
            "modes",
            (*_LDEM, "modes", "configs/modes.toml", *_TO_OUT),
            ("--set", "plate.modules_through_thickness=3"),
        ),
        Need(
            "ensemble",
            (*_MANY, *_TO_OUT[:-1]),
            ("--seeds", "0:2"),
            quick_scene="configs/impact_small.toml",
            done="ensemble.json",
            resume=(*_MANY, *_TO_OUT[:-1], "--resume"),
        ),
    )
}


def conduct(
    names: Sequence[str], out: Path, *, quick: bool, resume: bool, tell: Callable[[str], None]
) -> dict[str, str]:
    """Carry out the runs that are not finished, each in a process of its own.

    Args:
        names: of ``NEEDS``. out: the folder of the reproduction.
        tell: is called with a line on each run.

    Returns:
        The runs without a result, each with the reason.

    Raises:
        Signalled: a signal has ended the run that was going on.
    """
    failed: dict[str, str] = {}
    for name in names:
        refuse_moved(out)  # commands are given its path
        need, folder = NEEDS[name], out / "runs" / name
        begun = folder.is_dir() and any(folder.iterdir())
        if begun and (folder / need.done).is_file() and _is_whole(need, folder):
            tell(f"{name}: finished already")
            continue
        again = begun and resume and bool(need.resume) and _can_resume(need, folder)
        command = [sys.executable, *need.command(folder, quick=quick, again=again)]
        tell(f"{name}: {' '.join(command[1:])}")
        started = time.perf_counter()
        (out / "logs").mkdir(parents=True, exist_ok=True)
        with (out / "logs" / f"{name}.log").open("w", encoding="utf-8") as log:
            code = run_child(command, stdout=log, stderr=subprocess.STDOUT)
        tell(f"{name}: {time.perf_counter() - started:.0f} s")
        if code:
            log_file = out / "logs" / f"{name}.log"
            last = log_file.read_text(encoding="utf-8", errors="replace").strip()
            failed[name] = f"ended with exit code {code}: {(last.splitlines() or [''])[-1]}"
    return failed


def _can_resume(need: Need, folder: Path) -> bool:
    return need.resume[2:3] != ("resume",) or RunFolder(folder).has_checkpoint


def _is_whole(need: Need, folder: Path) -> bool:
    """Whether a study or an ensemble has all of its specimens."""
    if need.name not in ("bending", "ensemble"):
        return True
    record = read_object(folder / need.done)
    if need.name == "ensemble":
        return bool(record.get("finished") == record.get("members"))
    specimens = record.get("specimens")
    return isinstance(specimens, list) and len(specimens) >= len(SPECIMENS)
