"""Half a sphere on a round shaft."""

from taichi_ldem.solver.contact.nose import Nose, quarter_circle


def surface(place, radius):
    """Distance from the axis of the shaft or, below it, from the sphere's centre."""
    place.z = min(place.z, 0.0)
    length = max(place.norm(), 1e-12 * radius)
    return length - radius, place / length


NOSE = Nose(surface, quarter_circle)
