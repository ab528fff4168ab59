"""What ``ldem info`` says about the strikers of a scene, and about the time of averaged forces."""

import math

from taichi_ldem.analysis.window import in_words, smoothing_window
from taichi_ldem.model import outlines
from taichi_ldem.scene import Scene
from taichi_ldem.scene.strikers import Striker


def rows(scene: Scene) -> dict[str, str]:
    """A line for each striker and, in an impact test, one for the window: name -> value."""
    found = {}
    for number, striker in enumerate(scene.strikers, start=1):
        name = "striker" if len(scene.strikers) == 1 else f"striker {number}"
        found[name] = _in_words(striker)
    if scene.scenario == "impact" and scene.strikers:
        window = smoothing_window(scene)
        share = 100 * window / scene.solver.duration
        found["forces averaged over"] = f"{in_words(window)}, {share:.2g} % of the duration"
    return found


def _in_words(striker: Striker) -> str:
    """The nose, the place, the mass, the speed with its direction, and the kinetic energy."""
    x, y = (1e3 * value for value in striker.position)
    nose = f"{striker.shape} of {1e3 * striker.diameter:.4g} mm at ({x:g}, {y:g}) mm"
    speed = f"{striker.speed:.4g} m/s"
    *across, _ = striker.vector
    if any(across):
        angle = math.degrees(math.acos(-striker.vector[2] / striker.speed))
        speed += f" at {angle:.1f} degrees to the vertical"
    if striker.motion == "prescribed":
        return f"{nose}, kept at {speed}"
    assert striker.mass is not None
    energy = 0.5 * striker.mass * striker.speed**2
    return f"{nose}, {1e3 * striker.mass:.4g} g, {speed}, {energy:.4g} J"


def remarks(scene: Scene) -> list[str]:
    """A line for each striker whose axis goes through a hole."""
    found = []
    for number, striker in enumerate(scene.strikers):
        for which, hole in enumerate(scene.hole):
            if outlines.hole_covers(hole, *striker.position):
                key = "striker" if len(scene.strikers) == 1 else f"striker[{number}]"
                found.append(
                    f"{key}.position is in hole[{which}]: the tip meets no part of the plate"
                )
    return found
