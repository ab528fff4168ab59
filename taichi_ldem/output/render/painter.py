"""The painter: an invisible window of Taichi's GGUI that turns triangles into images."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.output.render.views import HEIGHT, SIZE_PX, WIDTH
from taichi_ldem.solver import backend

FloatArray = NDArray[np.floating[Any]]

_SUPERSAMPLING = 2  # GGUI has no anti-aliasing


def _clear_texture_coordinates() -> None:
    """Make GGUI start from zeroed vertices.

    Taichi 1.7 does not initialise the texture coordinates of a mesh; where they are NaN, the whole
    mesh is missing from the picture.
    """
    scene = import_module("taichi.ui.scene")
    uncleared = scene.get_vbo_field_v2

    def cleared(vertices: Any) -> Any:
        buffer = uncleared(vertices)
        buffer.fill(0.0)
        return buffer

    scene.get_vbo_field_v2 = cleared  # type: ignore[attr-defined]


class Painter:
    """An invisible GGUI window that turns triangles into images."""

    def __init__(self) -> None:
        backend.start_for_pictures()
        import taichi as ti

        _clear_texture_coordinates()
        self._ti = ti
        self._size = round(HEIGHT * SIZE_PX[1]), round(WIDTH * SIZE_PX[0])
        height, width = (_SUPERSAMPLING * side for side in self._size)
        self._window = ti.ui.Window("plate", (width, height), show_window=False)
        self._fields: tuple[Any, Any] | None = None

    def paint(self, triangles: FloatArray, colours: FloatArray, aspect: float) -> FloatArray:
        """An image (rows, columns, 3) from triangles in the panel's coordinates.

        Args:
            triangles: (T, 3, 3), x in -1..1 across the panel, y to the same scale, z in -1..1
                towards the eye.
            colours: (T, 3) RGB.
            aspect: height over width of the image, at most the window's.
        """
        places, shades = self._buffers(3 * len(triangles))
        for field, rows in (
            (places, triangles.reshape(-1, 3)),
            (shades, colours.repeat(3, axis=0)),
        ):
            # the remaining vertices form empty triangles
            padded = np.zeros((field.shape[0], 3), dtype=np.float32)
            padded[: len(rows)] = rows
            field.from_numpy(padded)
        scene, canvas = self._window.get_scene(), self._window.get_canvas()
        scene.set_camera(self._camera())
        # the colours hold light and shade already; without any light GGUI reads a null buffer
        scene.ambient_light((1.0, 1.0, 1.0))
        scene.point_light((0.0, 0.0, 3.0), (0.0, 0.0, 0.0))
        canvas.set_background_color((1.0, 1.0, 1.0))
        scene.mesh(places, normals=places, per_vertex_color=shades)
        canvas.scene(scene)
        image = self._window.get_image_buffer_as_numpy()[..., :3].transpose(1, 0, 2)
        n, height, width = _SUPERSAMPLING, *self._size
        image = image.reshape(height, n, width, n, 3).mean(axis=(1, 3))
        spare = (height - round(aspect * width)) // 2
        return image[spare : height - spare]

    def _camera(self) -> Any:
        camera = self._ti.ui.Camera()
        reach = self._size[0] / self._size[1]
        camera.position(0.0, 0.0, 3.0)
        camera.lookat(0.0, 0.0, 0.0)
        camera.up(0.0, 1.0, 0.0)
        camera.projection_mode(self._ti.ui.ProjectionMode.Orthogonal)
        for set_edge, value in (
            (camera.left, -1.0),
            (camera.right, 1.0),
            (camera.bottom, -reach),
            (camera.top, reach),
            (camera.z_near, 1.0),
            (camera.z_far, 5.0),
        ):
            set_edge(value)
        return camera

    def _buffers(self, vertices: int) -> tuple[Any, Any]:
        """Fields of places and colours with room for `vertices`.

        Taichi never frees a field, so the same ones serve all pictures while they are large enough.
        """
        if not self._fields or vertices > self._fields[0].shape[0]:
            room, make = max(3, 4 * vertices // 3), self._ti.Vector.field
            self._fields = (make(3, self._ti.f32, room), make(3, self._ti.f32, room))
        return self._fields
