"""A flat end with a sharp edge on a round shaft."""

import numpy as np

from taichi_ldem.solver.contact.nose import Nose


def surface(place, radius):
    """Distance from the end, from the side or, outside both, from the edge between them."""
    end = -radius - place.z
    place.z = 0.0
    across = max(place.norm(), 1e-12 * radius)
    side = across - radius
    distance = max(side, end)
    out, down = side, end
    if distance <= 0:  # inside: the nearer of end and side
        if side > end:
            out, down = side * 0.0 + 1.0, end * 0.0
        else:
            out, down = side * 0.0, end * 0.0 + 1.0
    else:  # the way from the nearest point of end, side or edge
        out, down = max(side, 0.0), max(end, 0.0)
        distance = (out * out + down * down) ** 0.5
        out, down = out / distance, down / distance
    normal = place * (out / across)
    normal.z = -down
    return distance, normal


def profile(radius):
    """Along the end to its edge."""
    return np.array([0.0, radius]), np.array([0.0, 0.0])


NOSE = Nose(surface, profile)
