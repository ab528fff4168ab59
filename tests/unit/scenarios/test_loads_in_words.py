"""What `ldem info` says about loads, starts and probes."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from support.blocks import block_scene

from taichi_ldem.scenarios.describe import left_out
from taichi_ldem.scenarios.loads_in_words import loads_in_words

ABSENT = [
    "loads (no [[load]])",
    "motion and strain at the start (no [start])",
    "probes (no [[probe]])",
]


def test_info_names_the_loads_the_start_and_the_probes_that_are_built() -> None:
    loads = [
        {"face": "+x", "traction": 2e6, "direction": "-x"},
        {"face": "-x", "velocity": 0.5, "direction": [0, 3, 4], "name": "drag"},
    ]
    probes = [
        {"point": [0, 0, 0]},
        {"point": [0, 0, 0], "quantities": ["velocity", "stress"], "name": "tip"},
    ]
    scene = block_scene(6, 4, 2, load=loads, start={"expansion": 3.0}, probe=probes)
    found = SimpleNamespace(which=np.array([0, 0, 1]), areas=(2e-6, 0.0))
    counts = SimpleNamespace(counts=lambda n: [(2, 0), (1, 8)][n])
    simulation: Any = SimpleNamespace(
        scene=scene,
        body=lambda name: SimpleNamespace(found=found),
        sampler=SimpleNamespace(probes=counts),
    )
    assert loads_in_words(simulation) == {
        "load load1": "traction 2e+06 Pa along (-1, 0, 0) on 2 nodes, 2 mm2: 4 N, constant",
        "load drag": "velocity 0.5 m/s along (0, 0.6, 0.8) on 1 nodes, constant",
        "at the start": "expansion",
        "probe probe1": "displacement, velocity of 2 nodes",
        "probe tip": "velocity, stress of 1 node and 8 modules",
    }
    assert not {*left_out(scene)} & {*ABSENT}


def test_info_names_what_is_left_out_of_a_scene_without_them() -> None:
    scene = block_scene(6, 4, 2)
    assert {*left_out(scene)} > {*ABSENT}
    simulation: Any = SimpleNamespace(scene=scene, body=lambda name: None)
    assert loads_in_words(simulation) == {}
