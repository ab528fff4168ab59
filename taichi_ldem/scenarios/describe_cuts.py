"""What ``ldem info`` says of a plate's shape, its holes and its notches."""

import numpy as np

from taichi_ldem.model import outlines
from taichi_ldem.model.lattice import Lattice
from taichi_ldem.scene import Scene


def rows(scene: Scene, lattice: Lattice) -> dict[str, str]:
    """Quantities of what the scene has of these: name -> value with unit."""
    from scipy.ndimage import label

    plate, found = scene.plate, {}
    if plate.file is not None:
        _, pieces = label(lattice.mask)
        share = 100 * lattice.mask.mean()
        parts = "" if pieces == 1 else f", in {pieces} parts that share no face of a module"
        found["shape"] = f"{plate.file.name}: {share:.1f} % of the plate's box{parts}"
    if scene.hole:
        whole = outlines.outline(plate)
        built = 1e6 * (whole & ~lattice.mask).sum() / plate.modules[2] * plate.spacing**2
        drawn = 1e6 * sum(outlines.hole_area(hole) for hole in scene.hole)
        found["holes"] = f"{len(scene.hole)}, {built:.2f} mm2 in modules, {drawn:.2f} mm2 as drawn"
    if scene.notch:
        times = sorted({notch.opens_at for notch in scene.notch})
        late = [f"{1e6 * time:g}" for time in times if time > 0]
        opens = f", opening at {', '.join(late[:5])} us" if late else ""
        found["notches"] = f"{len(scene.notch)}{opens}"
    return found


def remarks(scene: Scene) -> list[str]:
    """Remarks on notches that never open."""
    late = [n.opens_at for n in scene.notch if n.opens_at > scene.solver.duration]
    if not late:
        return []
    return [
        f"notch.time = {np.max(late):g} is after solver.duration = {scene.solver.duration:g}: "
        "the notch never opens"
    ]
