"""The child process that draws: ``python -m taichi_ldem.output.render FOLDER SHOT INTO STEP ...``.

SHOT is a ``Shot`` as JSON; where it is empty, the three standing views are drawn.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.output.render.bodies import bodies_at
from taichi_ldem.output.render.composition import compose
from taichi_ldem.output.render.names import EXIT_NO_DEVICE, shot_name, view_name
from taichi_ldem.output.render.painter import Painter
from taichi_ldem.output.render.scales import Scale, damage_scale, scale_of
from taichi_ldem.output.render.shading import centre, panel_image
from taichi_ldem.output.render.surfaces import exterior, notched
from taichi_ldem.output.render.views import VIEWS, Shot, View, view_of
from taichi_ldem.scene import Scene
from taichi_ldem.solver.backend import vulkan_device
from taichi_ldem.storage.fields import Fields, read_fields
from taichi_ldem.storage.folder import RunFolder

FloatArray = NDArray[np.floating[Any]]


_FITS = 128
"""Characters of a line that fit on a picture in the size 15."""


@dataclass(frozen=True)
class _Run:
    """A run as it is read once for all pictures."""

    folder: RunFolder
    scene: Scene
    history: Mapping[str, FloatArray]

    @classmethod
    def read(cls, folder: RunFolder) -> _Run:
        history = folder.read_history() if folder.history_file.exists() else {}
        return cls(folder, folder.read_scene(), history)

    def fields(self, step: int) -> Fields:
        """Fields of a step; the modules that a notch cuts count as broken."""
        fields = read_fields(self.folder.fields_file, step)
        angle = math.radians(self.scene.plate.angle)
        fields.broken_fraction[notched(fields, self.scene.notch, angle)] = 1.0
        return fields


def _draw_views(painter: Painter, run: _Run, step: int, into: Path) -> None:
    """The three standing views of a step."""
    fields = run.fields(step)
    size = np.ptp(fields.points, axis=0)
    for name, make in VIEWS.items():
        view = make(size)
        if run.scene.striker is None:
            view = replace(view, title=view.title.partition(" (")[0])  # no face is the struck one
        _draw(painter, run, fields, view, damage_scale(), into / view_name(fields.time, name))


def _draw_shots(painter: Painter, run: _Run, steps: Sequence[int], shot: Shot, into: Path) -> None:
    """A shot of each step, all with one colour scale."""
    scale = scale_of(run.folder, steps, shot.colour)
    for step in steps:
        fields = run.fields(step)
        view = view_of(shot, np.ptp(fields.points, axis=0))
        _draw(painter, run, fields, view, scale, into / shot_name(step))


def _draw(
    painter: Painter, run: _Run, fields: Fields, view: View, scale: Scale, picture: Path
) -> None:
    surface = exterior(fields, view.part(fields), scale.value(fields))
    bodies = bodies_at(run.scene, run.history, fields.time)
    images, lines = [], []
    for panel in view.panels:
        middle = centre(fields, panel)
        fade = np.ptp(fields.points[:, 2]) / 4 if view.faces_its_cut else None
        images.append(panel_image(painter, surface, panel, middle, scale, bodies, fade))
        seen = panel.rotation, middle
        lines.append((bodies.outlines(*seen), bodies.circles(*seen), bodies.labels(*seen)))
    figure = compose(view, images, lines, scale)
    caption = f"t = {1e3 * fields.time:.2f} ms    {view.title}    deformation to scale"
    figure.text(0.5, 0.972, caption, ha="center", va="center", fontsize=20)
    behind = "behind the cut pale blue: faces, brown: walls of cracks" if view.faces_its_cut else ""
    explained = ";  ".join(filter(None, (bodies.caption(), behind)))
    size = min(15.0, 15.0 * _FITS / max(len(explained), 1))  # several strikers need many words
    figure.text(0.5, 0.936, explained, ha="center", va="center", fontsize=size)
    if fields.fault:
        note = f"{run.folder.fields_file.name} is damaged: {fields.fault}"
        figure.text(0.5, 0.905, note, ha="center", va="center", fontsize=14, color="red")
    figure.savefig(picture, metadata=run.folder.picture_metadata())


def main(arguments: Sequence[str]) -> int:
    """Draw; returns 0, or ``EXIT_NO_DEVICE`` without a Vulkan device."""
    if not vulkan_device():
        return EXIT_NO_DEVICE
    path, shot, into, *steps = arguments
    run = _Run.read(RunFolder.open(Path(path)))
    painter = Painter()
    if shot:
        _draw_shots(painter, run, [int(s) for s in steps], Shot(**json.loads(shot)), Path(into))
        return 0
    for step in steps:
        _draw_views(painter, run, int(step), Path(into))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
