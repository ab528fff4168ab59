"""Headless pictures of the deformed, cracked plate from a run folder, drawn by Taichi's GGUI.

Drawing happens in a child process, in a temporary working directory: a Vulkan driver that aborts
then ends only the child, and GGUI's settings file does not land in the user's directory. The
plate is the exterior of its modules at true scale, coloured by the share of a module's bars that
have failed (or by speed or strain energy). Modules that are cut in two or torn are left out, so
that cracks appear as gaps. The striker is drawn over it, translucent, with the clamp's circles.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.errors import SceneError
from taichi_ldem.output.render.names import EXIT_NO_DEVICE, milliseconds, shot_name, view_name
from taichi_ldem.output.render.views import VIEWS, Shot
from taichi_ldem.storage.durable import write_whole
from taichi_ldem.storage.fields import read_fields, read_times
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.place import current, unlink

NO_DEVICE = (
    "no pictures: there is no Vulkan device; "
    "a software one comes with `apt install libvulkan1 mesa-vulkan-drivers` (Debian)"
)
TIMEOUT_S = 120.0
TIMEOUT_PER_PICTURE_S = 20.0
_SAME_TIME_S = 5e-6  # times whose captions do not differ


def render_run(folder: RunFolder, times: list[float] | None = None) -> list[Path]:
    """Draw the plate from below, from above and cut open: one PNG for each view and time.

    Args:
        folder: a run, finished or not.
        times: s; the nearest stored steps are drawn. None: the scene's image times and the last
            step.

    Returns:
        The pictures written, `crack_<ms>ms_<view>.png`. Without a Vulkan device, or if drawing
        fails, one line on stderr says so and the pictures that exist are returned.

    Raises:
        SceneError: the run folder's fields or scene cannot be read.
    """
    steps = _steps(folder, times)
    names = [view_name(time, view) for _, time in steps for view in VIEWS]
    folder.claim(names)
    for name in names:
        unlink(folder.path / name)
    with tempfile.TemporaryDirectory() as scratch:
        into = Path(scratch)
        failure = _draw_in_child(folder, [number for number, _ in steps], len(names), "", into)
        if current(folder.path) != folder.path:  # who knows what has been drawn
            failure, names = f"no pictures: '{folder.path}' was renamed meanwhile", []
        drawn = [name for name in names if (into / name).is_file()]
        for name in drawn:
            write_whole(folder.path / name, (into / name).read_bytes())
    if failure:
        print(failure, file=sys.stderr)
    return [folder.path / name for name in drawn]


def render_shot(
    folder: RunFolder, shot: Shot, into: Path, times: Sequence[float] | None = None
) -> list[tuple[float, Path]]:
    """Draw one picture of each stored step, all with the same colour scale and frame.

    Args:
        into: an existing folder for the pictures, `shot_00012.png`.
        times: as for `render_run`; None: every stored step.

    Returns:
        Time (s) and picture of each.

    Raises:
        SceneError: the run cannot be read, or drawing failed.
    """
    if times is None:
        steps = list(enumerate(float(time) for time in read_times(folder.fields_file)))
    else:
        steps = _steps(folder, times)
    numbers = [number for number, _ in steps]
    failure = _draw_in_child(folder, numbers, len(numbers), json.dumps(asdict(shot)), into)
    drawn = [(time, into / shot_name(number)) for number, time in steps]
    drawn = [(time, picture) for time, picture in drawn if picture.is_file()]
    if failure or not drawn:
        raise SceneError(failure or f"'{folder.path}' holds no fields to draw")
    return drawn


def render_shots_into(
    folder: RunFolder, shot: Shot, times: Sequence[float] | None = None
) -> list[Path]:
    """Draw a shot at some times into the run folder, `shot_<ms>ms_<name>.png`.

    Args, errors: as for `render_shot`; None: the times of `render_run`.
    """
    if times is None:
        stored = read_times(folder.fields_file)
        times = [*folder.read_scene().output.image_times, *map(float, stored[-1:])]
    with tempfile.TemporaryDirectory() as scratch:
        drawn = {
            f"shot_{milliseconds(time)}ms_{shot.name}.png": picture
            for time, picture in render_shot(folder, shot, Path(scratch), times)
        }
        folder.claim(drawn)
        for name, picture in drawn.items():
            write_whole(folder.path / name, picture.read_bytes())
    return [folder.path / name for name in drawn]


def _steps(folder: RunFolder, times: Sequence[float] | None) -> list[tuple[int, float]]:
    """Stored steps (number, time) nearest to the wanted times, in order, each once."""
    stored = read_times(folder.fields_file)
    if not stored.size:
        return []
    if times is None:
        times = [*folder.read_scene().output.image_times, float(stored[-1])]
    _warn_of_other_times(stored, times)
    nearest = sorted({int(np.abs(stored - time).argmin()) for time in times})
    return [(step, float(stored[step])) for step in nearest]


def _warn_of_other_times(stored: NDArray[np.float64], times: Sequence[float]) -> None:
    """One line on stderr for each wanted time that is not among the stored ones."""
    for time in times:
        near = float(stored[np.abs(stored - time).argmin()])
        if abs(near - time) > _SAME_TIME_S:
            wanted, found = milliseconds(time), milliseconds(near)
            print(
                f"no fields are stored at {wanted} ms: drawn at the nearest time, {found} ms"
                " (output.field_interval and output.image_times say when they are stored)",
                file=sys.stderr,
            )


def _read_ahead(folder: RunFolder, steps: Sequence[int]) -> None:
    """Read what the child will read: a file that is damaged is refused here, by its name."""
    folder.read_scene()
    folder.processes()
    if folder.history_file.exists():
        folder.read_history()
    for step in steps:
        fields = read_fields(folder.fields_file, step)
        if fields.fault:
            name = f"'{folder.fields_file}' is damaged at {milliseconds(fields.time)} ms"
            print(f"warning: {name}: {fields.fault}; the picture says so", file=sys.stderr)


def _draw_in_child(
    folder: RunFolder, steps: Sequence[int], count: int, shot: str, into: Path
) -> str:
    """Draw in a child process. Returns one line on what went wrong, or nothing.

    Raises:
        SceneError: a file of the run cannot be read.
    """
    _read_ahead(folder, steps)
    command = [
        sys.executable,
        "-m",
        "taichi_ldem.output.render",
        str(folder.path.resolve()),
        shot,
        str(into.resolve()),
        *map(str, steps),
    ]
    timeout = TIMEOUT_S + TIMEOUT_PER_PICTURE_S * count
    # The child has another working directory, through which this package may have been found.
    package = str(Path(__file__).resolve().parents[3])
    path = os.pathsep.join(filter(None, (package, os.environ.get("PYTHONPATH"))))
    with tempfile.TemporaryDirectory() as scratch:
        try:
            child = subprocess.run(
                command,
                cwd=scratch,
                env={**os.environ, "PYTHONPATH": path},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
                errors="replace",
                timeout=timeout,
            )
        except subprocess.TimeoutExpired:
            return f"pictures are missing: drawing took more than {timeout:.0f} s"
        except OSError as error:
            return f"no pictures: cannot start a process to draw them: {error.strerror}"
    if child.returncode == EXIT_NO_DEVICE:
        return NO_DEVICE
    if child.returncode:
        last = (child.stderr.strip().splitlines() or ["it gave no reason"])[-1]
        return f"pictures are missing: drawing ended with code {child.returncode}: {last}"
    return ""
