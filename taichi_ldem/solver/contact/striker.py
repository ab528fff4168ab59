"""Declaration of the strikers, and their drawing."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_ldem.analysis.signals import smooth_force
from taichi_ldem.analysis.window import smoothing_window
from taichi_ldem.scene import MOST_STRIKERS, Scene
from taichi_ldem.scene import Striker as Table
from taichi_ldem.solver.contact.declaration import Body, Observable
from taichi_ldem.solver.contact.drawing import Drawing, Floats, between, turned
from taichi_ldem.solver.contact.noses import nose_of

if TYPE_CHECKING:
    from taichi_ldem.solver.contact.kernels.striker import Striker as Kernels
    from taichi_ldem.solver.dynamics import Dynamics

SHAFT = 0.7
"""Length of the shaft that is drawn above the nose, in diameters."""


class Striker(Body):
    """A rigid nose on a shaft that hits the plate from above.

    Attributes:
        number: of the striker in the scene, from 0.
    """

    def __init__(self, number: int):
        self.number = number
        self.name = name = f"striker{number + 1}" if number else "striker"
        self.words = f"striker {number + 1}" if number else "striker"
        self.absent = "" if number else "striker contact (no [striker])"
        self.felt = f"{name}_force_n"  # column of the force on it
        self.force = self.felt
        words, towards = self.words, "towards the plate"
        self.observables = (
            Observable(f"{name}_displacement_m", f"{words} displacement", "m", towards),
            Observable(f"{name}_velocity_m_s", f"{words} velocity", "m/s", towards),
            Observable(self.felt, f"force on the {words}", "N", "against its motion"),
            Observable(f"kinetic_{name}_j", f"kinetic energy of the {words}", "J", energy=True),
        )

    def table(self, scene: Scene) -> Table | None:
        """The table [striker], or the one of this number among [[striker]]."""
        return scene.strikers[self.number] if self.number < len(scene.strikers) else None

    def without_friction(self, scene: Scene) -> str:
        """How ``ldem info`` names the friction that the striker could have; or nothing."""
        return super().without_friction(scene).replace(self.name, self.words, 1)

    def works(self, scene: Scene) -> bool:
        """Whether gravity acts on the striker, or something keeps its velocity."""
        table = self.table(scene)
        return table is not None and (table.gravity > 0 or table.is_prescribed)

    def observables_in(self, scene: Scene) -> tuple[Observable, ...]:
        """Those of every striker; along x and y, too, where it has no guide."""
        table = self.table(scene)
        if table is None or table.guided:
            return self.observables
        return (*self.observables, *self._sideways())

    def _sideways(self) -> Iterator[Observable]:
        """The motion along x and along y; then the forces, as ``Sampler`` has them."""
        for axis in "xy":
            for what, ending, unit in (("displacement", "m", "m"), ("velocity", "m_s", "m/s")):
                label = f"{self.words} {what} along {axis}"
                yield Observable(f"{self.name}_{what}_{axis}_{ending}", label, unit)
        for axis in "xy":
            label = f"force on the {self.words} along {axis}"
            yield Observable(f"{self.name}_force_{axis}_n", label, "N")

    def kernels(self) -> "type[Kernels]":
        """The class of the kernels of a striker on a guide."""
        from taichi_ldem.solver.contact.kernels.striker import Striker as Kernels

        return Kernels

    def make(self, dynamics: "Dynamics", scene: Scene) -> "Kernels":
        """The striker with its kernels, on a guide or without one."""
        if scene.strikers[self.number].guided:
            return self.kernels()(dynamics, scene, self.number)
        from taichi_ldem.solver.contact.kernels.unguided import UnguidedStriker

        return UnguidedStriker(dynamics, scene, self.number)

    def warnings(self, scene: Scene, history: list[dict[str, Any]]) -> list[str]:
        """A line where the striker has never touched the plate, with the reason."""
        striker = self.table(scene)
        if striker is None or any(row[self.felt] for row in history):
            return []
        key = "striker" if len(scene.strikers) == 1 else f"striker[{self.number}]"
        way = max(row[f"{self.name}_displacement_m"] for row in history)
        if way <= striker.gap:
            why = (
                f"it has come {way:.4g} m of {key}.gap = {striker.gap:g} in "
                f"solver.duration = {scene.solver.duration:g}"
            )
        else:
            size = striker.diameter / scene.plate.spacing
            why = (
                f"it has passed the top face by {way - striker.gap:.4g} m beside all nodes; see "
                f"{key}.position and {key}.diameter, {size:.3g} modules"
            )
        return [f"the {self.words} never touched the plate: {why}"]

    def drawing(self, scene: Scene, history: Mapping[str, Floats], time: float) -> Drawing | None:
        """The striker where the history has it at a time; not above a beam on supports."""
        table, path = self.table(scene), history.get(f"{self.name}_displacement_m", ())
        if table is None or scene.is_beam or not len(path):
            return None
        times = np.asarray(history["time_s"], dtype=float)

        def at(column: str) -> float:
            values = history.get(f"{self.name}_{column}")
            return 0.0 if values is None else float(np.interp(time, times, values))

        _, width, thickness = scene.plate.actual_size
        tip = thickness + table.gap - at("displacement_m")
        sideways = at("displacement_x_m"), at("displacement_y_m"), 0.0
        sampled = np.asarray(history[self.felt], dtype=float)
        force = smooth_force(times, sampled, smoothing_window(scene))
        size = abs(round(float(np.interp(time, times, force))))
        label = str(self.number + 1) if len(scene.strikers) > 1 else ""
        words = f"striker {label}" if label else f"the {self.words}"
        faces = striker_faces(table, width, tip) + np.array(sideways)
        return Drawing(f"blue: {words}, force on it {size:.0f} N", faces, label=label)


def striker_faces(striker: Table, width: float, tip: float) -> Floats:
    """(F, 4, 3) of the nose and a piece of its shaft, the tip at height ``tip``, m.

    Args:
        width: of the plate along y, m; a nose along y is longer.
    """
    radius, nose = striker.diameter / 2, nose_of(striker.shape)
    out, up = nose.profile(radius, *nose.numbers(striker.nose_number, radius))
    out = np.append(out, [out[-1], 0.0])  # up the shaft, and inwards to its axis
    up = np.append(up, [up[-1] + 2 * SHAFT * radius] * 2)
    if nose.along_y:
        across = np.concatenate([-out[::-1], out])
        height = np.concatenate([up[::-1], up])
        half = 0.55 * width + float(out.max())
        rows = [np.stack([across, np.full_like(across, y), height], axis=1) for y in (half, -half)]
    else:
        return turned(out, up) + np.array((*striker.position, tip))
    return between(rows) + np.array((*striker.position, tip))


STRIKERS = tuple(Striker(number) for number in range(MOST_STRIKERS))
"""All strikers that a scene may have, in the order of its tables."""
