"""Striker and clamp in the pictures of a run: where they stand at a time, as faces and lines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.analysis.signals import smooth_force
from taichi_ldem.scene import Clamp, Scene, Striker

Floats = NDArray[np.floating[Any]]

SHAFT = 0.7  # of the striker that is drawn above the nose, in diameters
_ARC, _TURN = 16, 64  # faces along the nose and around the axis
_SIDEWAYS = 0.1  # of the eye's direction along z: below it the plate is seen from the side


@dataclass(frozen=True)
class Bodies:
    """Rigid bodies at a time.

    Attributes:
        faces: (F, 4, 3) of the striker, counter-clockwise from outside, m; empty without one.
        force: on the striker, mean over 0.2 ms, N; None where there is no record.
        radii: of the clamp's circles, m. thickness: of the plate, m.
    """

    faces: Floats = field(default_factory=lambda: np.empty((0, 4, 3)))
    force: float | None = None
    radii: tuple[float, ...] = ()
    thickness: float = 0.0

    @property
    def normals(self) -> Floats:
        """(F, 3), outward."""
        corners = self.faces
        found = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-300))

    def caption(self) -> str:
        """What is drawn beside the plate, and how hard it is pressed."""
        parts = []
        if len(self.faces):
            felt = "" if self.force is None else f", force on it {self.force:.0f} N"
            parts.append(f"blue: the striker{felt}")
        if self.radii:
            parts.append("dashed: the clamp")
        return ";  ".join(parts)

    def outline(self, rotation: Floats, centre: Floats) -> Floats:
        """(n, 2) closed outline of the striker in a picture's coordinates, m; empty without one."""
        if not len(self.faces):
            return np.empty((0, 2))
        from scipy.spatial import ConvexHull

        seen = (self.faces.reshape(-1, 3) - centre) @ rotation[:2].T
        around = ConvexHull(seen).vertices
        return np.asarray(seen[[*around, around[0]]])

    def clamp_lines(self, rotation: Floats, centre: Floats) -> list[Floats]:
        """Lines (n, 2) of the clamp in a picture: its circles, or its places seen from the side."""
        if not self.radii:
            return []
        if abs(rotation[2, 2]) > _SIDEWAYS:
            angle = np.linspace(0.0, 2 * np.pi, 181)
            height = self.thickness if rotation[2, 2] > 0 else 0.0
            circles = [
                np.stack([r * np.cos(angle), r * np.sin(angle), np.full(181, height)], axis=1)
                for r in self.radii
            ]
            return [(circle - centre) @ rotation[:2].T for circle in circles]
        return [
            np.array([[side * r, z] for r in self.radii]) - (0.0, centre[2])
            for side in (-1, 1)
            for z in (0.0, self.thickness)
            if len(self.radii) > 1
        ]


def bodies_at(scene: Scene, history: Mapping[str, Floats], time: float) -> Bodies:
    """Striker and clamp at a time, s; a beam on supports has none."""
    if scene.supports is not None:
        return Bodies()
    thickness = scene.plate.actual_size[2]
    radii = _radii(scene.clamp) if scene.held else ()
    way = history.get("striker_displacement_m", ())
    if scene.striker is None or not len(way):
        return Bodies(radii=radii, thickness=thickness)
    times = np.asarray(history["time_s"], dtype=float)
    tip = thickness + scene.striker.gap - float(np.interp(time, times, way))
    force = smooth_force(times, np.asarray(history["striker_force_n"], dtype=float))
    faces = striker_faces(scene.striker, scene.plate.actual_size[1], tip)
    return Bodies(faces, abs(round(float(np.interp(time, times, force)))), radii, thickness)


def _radii(clamp: Clamp | None) -> tuple[float, ...]:
    if clamp is None:
        return ()
    both = (clamp.inner_diameter, clamp.outer_diameter if clamp.kind != "rim" else None)
    return tuple(diameter / 2 for diameter in both if diameter is not None)


def striker_faces(striker: Striker, width: float, tip: float) -> Floats:
    """(F, 4, 3) of the nose and a piece of its shaft, the tip at height ``tip``, m.

    Args:
        width: of the plate along y, m, over which a cylinder reaches.
    """
    radius = striker.diameter / 2
    angle = np.linspace(0.0, np.pi / 2, _ARC + 1)
    out = radius * np.append(np.sin(angle), [1.0, 0.0])  # up along the nose and shaft, and inwards
    up = radius * np.append(1.0 - np.cos(angle), [1 + 2 * SHAFT, 1 + 2 * SHAFT])
    if striker.shape == "cylinder":
        across = np.concatenate([-out[::-1], out])
        height = np.concatenate([up[::-1], up])
        rows = [
            np.stack([across, np.full_like(across, y), height], axis=1) for y in _ends(width, out)
        ]
    else:
        turn = np.linspace(0.0, 2 * np.pi, _TURN + 1)
        rows = [np.stack([out * np.cos(a), out * np.sin(a), up], axis=1) for a in -turn]
    grid = np.array(rows) + np.array((*striker.position, tip))
    faces = [grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]]
    return np.asarray(np.stack(faces, axis=2).reshape(-1, 4, 3))


def _ends(width: float, out: Floats) -> tuple[float, float]:
    half = 0.55 * width + float(out.max())
    return half, -half
