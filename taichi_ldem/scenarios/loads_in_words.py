"""What ``ldem info`` says about the loads, the start and the probes of a scene."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

UNITS = {"velocity": "m/s", "displacement": "m", "traction": "Pa", "force": "N"}


def loads_in_words(simulation: "Simulation") -> dict[str, str]:
    """A line for each load, for the start and for each probe: name -> what is built."""
    scene, rows = simulation.scene, {}
    body = simulation.body("loads")
    for n, load in enumerate(scene.loads):
        nodes = int(np.count_nonzero(body.found.which == n))
        direction = ", ".join(f"{value + 0.0:.3g}" for value in load.unit)
        text = f"{load.kind} {load.value:g} {UNITS[load.kind]} along ({direction}) on {nodes} nodes"
        if load.kind == "traction":
            area = body.found.areas[n]
            text += f", {1e6 * area:.4g} mm2: {load.value * area:.4g} N"
        rows[f"load {load.name}"] = f"{text}, {load.course}"
    if scene.start is not None:
        rows["at the start"] = ", ".join(name for name, value in scene.start if value is not None)
    for n, probe in enumerate(scene.probes):
        counts = zip(simulation.sampler.probes.counts(n), ("node", "module"), strict=True)
        parts = [f"{count} {kind}{'s' if count > 1 else ''}" for count, kind in counts if count]
        rows[f"probe {probe.name}"] = f"{', '.join(probe.quantities)} of {' and '.join(parts)}"
    return rows
