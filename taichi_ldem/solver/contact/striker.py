"""Declaration of the striker, and its drawing."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_ldem.analysis.signals import smooth_force
from taichi_ldem.analysis.window import smoothing_window
from taichi_ldem.scene import Scene
from taichi_ldem.scene import Striker as Table
from taichi_ldem.solver.contact.declaration import Body, Observable
from taichi_ldem.solver.contact.drawing import Drawing, Floats
from taichi_ldem.solver.contact.noses import nose_of

if TYPE_CHECKING:
    from taichi_ldem.solver.contact.kernels.striker import Striker as Kernels

SHAFT = 0.7
"""Length of the shaft that is drawn above the nose, in diameters."""

TURN = 64
"""Faces that are drawn around the axis."""


class Striker(Body):
    """A rigid nose on a shaft that hits the plate from above."""

    name = "striker"
    absent = "striker contact (no [striker])"
    observables = (
        Observable("striker_displacement_m", "striker displacement", "m", "towards the plate"),
        Observable("striker_velocity_m_s", "striker velocity", "m/s", "towards the plate"),
        Observable("striker_force_n", "force on the striker", "N", "against its motion"),
        Observable("kinetic_striker_j", "kinetic energy of the striker", "J", energy=True),
    )
    force = "striker_force_n"

    def table(self, scene: Scene) -> Table | None:
        """The table [striker]."""
        return scene.striker

    def works(self, scene: Scene) -> bool:
        """Whether gravity acts on the striker."""
        return scene.striker is not None and scene.striker.gravity > 0

    def kernels(self) -> "type[Kernels]":
        """The kernels' class."""
        from taichi_ldem.solver.contact.kernels.striker import Striker as Kernels

        return Kernels

    def warnings(self, scene: Scene, history: list[dict[str, Any]]) -> list[str]:
        """A line where the striker has never touched the plate, with the reason."""
        striker = scene.striker
        if striker is None or any(row["striker_force_n"] for row in history):
            return []
        way = max(row["striker_displacement_m"] for row in history)
        if way <= striker.gap:
            why = (
                f"it has come {way:.4g} m of striker.gap = {striker.gap:g} in "
                f"solver.duration = {scene.solver.duration:g}"
            )
        else:
            size = striker.diameter / scene.plate.spacing
            why = (
                f"it has passed the top face by {way - striker.gap:.4g} m beside all nodes; see "
                f"striker.position and striker.diameter, {size:.3g} modules"
            )
        return [f"the striker never touched the plate: {why}"]

    def drawing(self, scene: Scene, history: Mapping[str, Floats], time: float) -> Drawing | None:
        """The striker where the history has it at a time; not above a beam on supports."""
        path = history.get("striker_displacement_m", ())
        if scene.striker is None or scene.supports is not None or not len(path):
            return None
        times = np.asarray(history["time_s"], dtype=float)
        _, width, thickness = scene.plate.actual_size
        tip = thickness + scene.striker.gap - float(np.interp(time, times, path))
        sampled = np.asarray(history["striker_force_n"], dtype=float)
        force = smooth_force(times, sampled, smoothing_window(scene))
        felt = abs(round(float(np.interp(time, times, force))))
        return Drawing(
            f"blue: the striker, force on it {felt:.0f} N",
            striker_faces(scene.striker, width, tip),
        )


def striker_faces(striker: Table, width: float, tip: float) -> Floats:
    """(F, 4, 3) of the nose and a piece of its shaft, the tip at height ``tip``, m.

    Args:
        width: of the plate along y, m; a nose along y is longer.
    """
    radius, nose = striker.diameter / 2, nose_of(striker.shape)
    out, up = nose.profile(radius)
    out = np.append(out, [radius, 0.0])  # up the shaft, and inwards to its axis
    up = np.append(up, [radius * (1 + 2 * SHAFT)] * 2)
    if nose.along_y:
        across = np.concatenate([-out[::-1], out])
        height = np.concatenate([up[::-1], up])
        half = 0.55 * width + float(out.max())
        rows = [np.stack([across, np.full_like(across, y), height], axis=1) for y in (half, -half)]
    else:
        turn = np.linspace(0.0, 2 * np.pi, TURN + 1)
        rows = [np.stack([out * np.cos(a), out * np.sin(a), up], axis=1) for a in -turn]
    grid = np.array(rows) + np.array((*striker.position, tip))
    faces = [grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]]
    return np.asarray(np.stack(faces, axis=2).reshape(-1, 4, 3))


STRIKER = Striker()
