"""A cone with a sharp tip on a round shaft."""

import math

import numpy as np

from taichi_ldem.solver.contact.nose import Nose


def surface(place, radius, slope):
    """Distance from the flank or the shaft and, outside, from the tip or the edge above the flank.

    A place on the axis has no nearest point on one side of it, so it leaves through the tip.

    Args:
        slope: tangent of the half angle between axis and flank.
    """
    height = place.z + radius  # above the tip
    place.z = 0.0
    across = max(place.norm(), 1e-12 * radius)
    length = (1.0 + slope * slope) ** 0.5
    sine, cosine = slope / length, 1.0 / length
    flank, along = across * cosine - height * sine, across * sine + height * cosine
    side, above = across - radius, height - radius / slope
    distance, out, up = flank, flank * 0.0 + cosine, flank * 0.0 - sine
    if across <= 1e-9 * radius and height > 0:
        distance, out, up = -height, out * 0.0, up * 0.0 - 1.0
    elif max(flank, side) <= 0:  # inside
        if side > flank:
            distance, out, up = side, out * 0.0 + 1.0, up * 0.0
    elif along < 0:  # below the tip
        distance = (across * across + height * height) ** 0.5
        out, up = across / distance, height / distance
    elif along * sine > radius:  # beyond the edge, or beside the shaft
        up = min(above, 0.0)
        distance = (side * side + up * up) ** 0.5
        out, up = side / distance, up / distance
    normal = place * (out / across)
    normal.z = up
    return distance, normal


def profile(radius, slope):
    """From the tip along the flank to its edge."""
    return np.array([0.0, radius]), np.array([0.0, radius / slope])


def slope_of(angle, radius):
    """The tangent of a half angle in degrees."""
    return math.tan(math.radians(angle))


NOSE = Nose(surface, profile, number=slope_of)
