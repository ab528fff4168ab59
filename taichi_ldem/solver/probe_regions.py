"""The region of a probe: which nodes, or which modules, it looks at."""

from taichi_ldem.errors import SceneError
from taichi_ldem.model import regions
from taichi_ldem.scene import Probe
from taichi_ldem.scene.values import show


def region_of(places: regions.Places, probe: Probe, number: int, kind: str) -> regions.Chosen:
    """The nodes or modules of a probe.

    Args:
        number: of the probe in its scene. kind: what the places are, in words.

    Raises:
        SceneError: there are none.
    """
    if probe.point is not None:
        return regions.nearest(places, probe.point)
    if probe.box is not None:
        key, value, region = "box", show(probe.box), regions.in_box(places, probe.box)
    else:
        assert probe.plane is not None
        assert probe.position is not None
        region = regions.near_plane(places, probe.plane, probe.position)
        key, value = "position", show(probe.position)
    if not region.any():
        raise SceneError(f"probe[{number}].{key} = {value}: holds no {kind} of the plate")
    return region
