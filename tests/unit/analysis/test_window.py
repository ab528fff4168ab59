"""The window of smoothed forces follows the specimen's own oscillation."""

import numpy as np
import pytest
from support.paths import CONFIGS

from taichi_ldem.analysis import signals
from taichi_ldem.analysis.modeshapes import Name, thin_plate_frequency
from taichi_ldem.analysis.window import CLAMPED, in_words, smoothing_window
from taichi_ldem.scene import Scene, load_scene, scene_to_toml


def _scaled(scene: Scene, factor: float) -> Scene:
    """The scene with all lengths and times multiplied."""
    data = scene.model_dump(by_alias=True, exclude_none=True)
    for table, keys in {
        "plate": ["size"],
        "striker": ["diameter"],
        "clamp": ["inner_diameter", "outer_diameter"],
        "solver": ["duration"],
        "output": ["history_interval", "field_interval"],
    }.items():
        for key in keys:
            value = data[table][key]
            data[table][key] = [factor * v for v in value] if key == "size" else factor * value
    data["output"]["image_times"] = data["output"]["filter_frequencies"] = []
    data["material"]["damage"] = False  # modules of 5 mm would be too coarse
    return Scene.model_validate(data)


def test_the_papers_plate_has_its_fifth_of_a_millisecond() -> None:
    for path in sorted(CONFIGS.glob("impact*.toml")):
        others = ("small", "convergence", "shatter", "drop", "indent", "strikers")
        others += ("hole", "drawing")
        if any(word in path.name for word in others):
            continue
        assert smoothing_window(load_scene(path)) == 0.2e-3, path
    assert in_words(smoothing_window(load_scene(CONFIGS / "bend.toml"))) == "0.06 ms"
    # half the plate has twice the frequency
    assert smoothing_window(load_scene(CONFIGS / "impact_small.toml")) == pytest.approx(0.1e-3)


def test_the_window_follows_the_period_of_thin_plate_theory() -> None:
    paper = load_scene(CONFIGS / "impact.toml")
    glass = paper.changed(
        "material.youngs_modulus=70e9",
        "material.poisson_ratio=0.22",
        "material.density=2500",
        "material.damage=false",
        "clamp.inner_diameter=0.05",
    )
    first = Name("plate", 0, 0)
    periods = [
        1 / thin_plate_frequency(first, s.clamp.inner_diameter / 2, 3.2e-3, m.youngs_modulus,
                                 m.poisson_ratio, m.density)
        for s in (glass, paper)
        if s.clamp is not None and (m := s.material)
    ]  # fmt: skip
    assert smoothing_window(glass) == pytest.approx(0.2e-3 * periods[0] / periods[1], rel=1e-6)
    free = paper.changed("clamp.kind=free", "plate.shape=disc", "plate.diameter=0.076")
    assert smoothing_window(free) == pytest.approx(0.2e-3 * CLAMPED / 9.0)


def test_peaks_scale_when_all_lengths_and_times_do() -> None:
    """Before, P1, P2, t1 and t2 of a record ten times as large were those of another window."""
    scene = load_scene(CONFIGS / "impact.toml")
    large = _scaled(scene, 10.0)
    time = np.arange(0.0, 10e-3, 1e-5)
    corners = [(0, 0), (1.5, 600), (1.6, 420), (2.2, 640), (2.5, 450), (6.5, 750), (6.6, 10)]
    at, level = np.array([*corners, (10, 10)]).T
    force = np.interp(time, 1e-3 * at, level) + 150 * np.sin(2 * np.pi * 4e3 * time)
    velocity = 1.065 - np.append(0.0, np.cumsum(force[:-1])) * 1e-5 / 18.49
    way = np.append(0.0, np.cumsum(velocity[1:])) * 1e-5
    found = []
    for factor, own in ((1.0, scene), (10.0, large)):
        window, clock = smoothing_window(own), factor * time
        # forces grow with the square of lengths, the striker's mass with their cube
        peaks = signals.force_peaks(clock, factor**2 * force, 1e-3 * factor, window)
        load = signals.puncture(clock, factor**2 * force, factor * way, window)
        failure = signals.velocity_failure(clock, velocity, 1e-3 * factor, window)
        assert failure is not None
        found.append(
            (peaks.first_time / factor, peaks.first_force / factor**2,
             peaks.second_time / factor, peaks.second_force / factor**2,
             peaks.failure_time / factor, failure / factor,
             load.peak_load / factor**2, load.peak_deflection / factor)
        )  # fmt: skip
    assert found[1] == pytest.approx(found[0], rel=1e-9)


def test_a_key_sets_the_window_and_a_scene_without_it_is_written_as_before() -> None:
    scene = load_scene(CONFIGS / "impact.toml")
    assert "smoothing_window" not in scene_to_toml(scene)
    assert smoothing_window(scene.changed("output.smoothing_window=1e-4")) == 1e-4
