"""A tangent ogive on a round shaft: an arc that meets the shaft without an edge, turned."""

import numpy as np

from taichi_ldem.solver.contact.nose import Nose


def surface(place, radius, arc):
    """Distance from the arc or the shaft or, below both, from the tip.

    A place on the axis has no nearest point on one side of it, so it leaves through the tip.

    Args:
        arc: radius of the arc, at least that of the shaft; with that one it is a hemisphere.
    """
    offset = arc - radius  # of the arc's centre beyond the axis
    length = (arc * arc - offset * offset) ** 0.5
    height = place.z + radius  # above the tip
    place.z = 0.0
    across = max(place.norm(), 1e-12 * radius)
    out, up = across + offset, min(height - length, 0.0)
    distance = max((out * out + up * up) ** 0.5, 1e-12 * radius)
    if across <= 1e-9 * radius and 0 < height < length:
        distance, out, up = -height, out * 0.0, up * 0.0 - 1.0
    elif -up * offset > length * out:  # below the tip
        distance = (across * across + height * height) ** 0.5
        out, up = across / distance, height / distance
    else:
        out, up = out / distance, up / distance
        distance -= arc
    normal = place * (out / across)
    normal.z = up
    return distance, normal


def profile(radius, arc):
    """Along the arc from the tip to the shaft."""
    angle = np.linspace(np.arccos((arc - radius) / arc), 0.0, 17)
    return arc * np.cos(angle) - arc + radius, arc * (np.sin(angle[0]) - np.sin(angle))


def arc_of(nose_radius, radius):
    """The radius of the arc as it is given, m."""
    return nose_radius


NOSE = Nose(surface, profile, number=arc_of)
