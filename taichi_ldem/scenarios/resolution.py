"""Remarks on rigid bodies that are finer than the lattice that they touch.

A body touches nodes only. One below a module in size meets single nodes or slips between them, so
its place in the lattice decides what it does. A body that meets no node at all is refused when it
is built, and so is a ring that is narrower than a module (``scene.checks``).
"""

from taichi_ldem.scene import Scene

_SLIPS = "it touches single nodes and may slip between them as they move"


def unresolved(scene: Scene) -> list[str]:
    """A line for each rigid body that is smaller than a module."""
    return [*_rounds(scene), *_clamp(scene), *_grips(scene)]


def _below(scene: Scene, key: str, size: float, consequence: str) -> list[str]:
    """The remark on a size (m), or nothing where it spans a module."""
    modules = size / scene.plate.spacing
    if modules >= 1 - 1e-9:
        return []
    return [f"{key} is {modules:.2g} modules: {consequence}"]


def _rounds(scene: Scene) -> list[str]:
    """The strikers and the supports."""
    found, several = [], len(scene.strikers) > 1
    for number, striker in enumerate(scene.strikers):
        key = f"striker[{number}].diameter" if several else "striker.diameter"
        found += _below(scene, key, striker.diameter, _SLIPS)
    if scene.supports is not None:
        found += _below(scene, "supports.diameter", scene.supports.diameter, _SLIPS)
    return found


def _clamp(scene: Scene) -> list[str]:
    clamp, plate = scene.clamp, scene.plate
    if clamp is None or not scene.held:
        return []
    assert clamp.inner_diameter is not None
    text = "the clamp leaves hardly a node free"
    found = _below(scene, "clamp.inner_diameter", clamp.inner_diameter, text)
    if clamp.kind == "rim":
        rim = 0.5 * ((plate.diameter or plate.width) - clamp.inner_diameter)
        text = "it holds only the nodes that happen to lie there"
        found += _below(scene, "the narrowest part of the clamp's rim", rim, text)
    return found


def _grips(scene: Scene) -> list[str]:
    grips, plate = scene.grips, scene.plate
    if grips is None:
        return []
    if plate.angle % 90:  # the ends are staircases, of which the last plane holds few nodes
        text = "at this plate.angle the grips hold only the nodes that happen to lie there"
        return _below(scene, "grips.length", grips.length, text)
    if grips.length >= 0.5 * plate.spacing * (1 - 1e-9):  # the last nodes of both kinds
        return []
    return _below(
        scene, "grips.length", grips.length, "the grips hold only the nodes of the end faces"
    )
