"""Half a cylinder along y on a flat shaft; longer than the plate is wide."""

from taichi_ldem.solver.contact.nose import Nose, quarter_circle


def surface(place, radius):
    """Distance from the middle plane of the shaft or, below it, from the cylinder's axis."""
    place.z = min(place.z, 0.0)
    place.y = 0.0
    length = max(place.norm(), 1e-12 * radius)
    return length - radius, place / length


NOSE = Nose(surface, quarter_circle, along_y=True)
