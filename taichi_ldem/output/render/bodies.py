"""The rigid bodies in the pictures of a run: solids as faces, circles as lines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from taichi_ldem.scene import Scene
from taichi_ldem.solver.contact import bodies_of
from taichi_ldem.solver.contact.drawing import Drawing, Floats, no_faces

_SIDEWAYS = 0.1
"""Component along z of the eye's direction, below which the plate is seen from the side."""


@dataclass(frozen=True)
class Bodies:
    """All bodies of a picture, as they are drawn at its time."""

    drawings: tuple[Drawing, ...] = ()

    @property
    def faces(self) -> Floats:
        """(F, 4, 3) of all solids, counter-clockwise from outside, m."""
        return np.concatenate([no_faces(), *(drawing.faces for drawing in self.drawings)])

    @property
    def normals(self) -> Floats:
        """(F, 3) of the faces, outward."""
        corners = self.faces
        found = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-300))

    def caption(self) -> str:
        """The words of all bodies; those of one colour stand together."""
        found: dict[str, list[str]] = {}
        for drawing in self.drawings:
            colour, _, body = drawing.caption.partition(": ")
            found.setdefault(colour, []).append(body)
        return ";  ".join(f"{colour}: {'; '.join(words)}" for colour, words in found.items())

    def outlines(self, rotation: Floats, centre: Floats) -> list[Floats]:
        """Closed outline (n, 2) of every solid in a picture's coordinates, m.

        From above, one under the plate is hidden.
        """
        above = rotation[2, 2] > _SIDEWAYS
        return [
            _outline(drawing.faces, rotation, centre)
            for drawing in self.drawings
            if len(drawing.faces) and not (above and drawing.below)
        ]

    def labels(self, rotation: Floats, centre: Floats) -> list[tuple[str, Floats]]:
        """The marks of solids that have one, and their places (2,) in a picture, m."""
        found = []
        for drawing in self.drawings:
            if drawing.label:
                outline = _outline(drawing.faces, rotation, centre)
                found.append((drawing.label, (outline.min(axis=0) + outline.max(axis=0)) / 2))
        return found

    def circles(self, rotation: Floats, centre: Floats) -> list[Floats]:
        """Lines (n, 2) of all circles in a picture, m; from the side, the places between them."""
        return [
            line for drawing in self.drawings for line in _circle_lines(drawing, rotation, centre)
        ]


def _outline(faces: Floats, rotation: Floats, centre: Floats) -> Floats:
    from scipy.spatial import ConvexHull

    seen = (faces.reshape(-1, 3) - centre) @ rotation[:2].T
    around = ConvexHull(seen).vertices
    return np.asarray(seen[[*around, around[0]]])


def _circle_lines(drawing: Drawing, rotation: Floats, centre: Floats) -> list[Floats]:
    radii, thickness = drawing.radii, drawing.thickness
    if abs(rotation[2, 2]) > _SIDEWAYS:
        angle = np.linspace(0.0, 2 * np.pi, 181)
        height = thickness if rotation[2, 2] > 0 else 0.0
        circles = [
            np.stack([r * np.cos(angle), r * np.sin(angle), np.full(181, height)], axis=1)
            for r in radii
        ]
        return [(circle - centre) @ rotation[:2].T for circle in circles]
    return [
        np.array([[side * r, z] for r in radii]) - (0.0, centre[2])
        for side in (-1, 1)
        for z in (0.0, thickness)
        if len(radii) > 1
    ]


def bodies_at(scene: Scene, history: Mapping[str, Floats], time: float) -> Bodies:
    """The bodies of a scene that are drawn at a time, s, of a run's history."""
    drawn = (body.drawing(scene, history, time) for body in bodies_of(scene))
    return Bodies(tuple(drawing for drawing in drawn if drawing is not None))
