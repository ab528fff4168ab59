"""The round edge of a tube: half a torus, as in ring-on-ring tests."""

import numpy as np

from taichi_ldem.solver.contact.nose import Nose


def surface(place, radius, middle):
    """Distance from the middle of the tube's wall or, below it, from the circle of its centres.

    Args:
        radius: half the thickness of the wall. middle: radius of the middle of the wall.
    """
    up = min(place.z, 0.0)
    place.z = 0.0
    across = max(place.norm(), 1e-12 * radius)
    out = across - middle
    length = max((out * out + up * up) ** 0.5, 1e-12 * radius)
    normal = place * (out / length / across)
    normal.z = up / length
    return length - radius, normal


def profile(radius, middle):
    """From the axis under a flat roof inside the tube, then around the wall's edge."""
    angle = np.linspace(np.pi, 0.0, 33)
    out = np.append(0.0, middle + radius * np.cos(angle))
    return out, np.append(radius, radius * (1.0 - np.sin(angle)))


def middle_of(diameter, radius):
    """Half the diameter of the middle of the wall."""
    return diameter / 2


NOSE = Nose(surface, profile, number=middle_of)
