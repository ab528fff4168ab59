"""Cracks against drawn ones whose answers are known, and against a real run counted by hand."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.cracked_plates import END, PLATE, START, Drawing, tips_on_circle
from support.paths import DATA

from taichi_ldem.analysis.cracks import (
    NO_CRACKS,
    Cracks,
    broken_area,
    crack_map,
    measure,
)
from taichi_ldem.model.cell import MODULE
from taichi_ldem.model.lattice import Lattice, prism
from taichi_ldem.scenarios.measure import measure_run
from taichi_ldem.scene import Plate, parse_scene
from taichi_ldem.storage.fields import BrokenBars
from taichi_ldem.storage.folder import RunFolder

L = PLATE.spacing  # m
BEFORE_RING = 7.3e-3  # s, between END and RING of the drawings


def ray(degrees: float, length: float = 25e-3) -> np.ndarray:
    angle = np.radians(degrees)
    return length * np.array([np.cos(angle), np.sin(angle)])


def star(*degrees: float, length: float = 25e-3) -> Drawing:
    drawing = Drawing()
    for angle in degrees:
        drawing.ray(ray(angle, length))
    return drawing


def assert_tips(cracks: Cracks, tips: np.ndarray, within: float) -> None:
    """Each drawn tip has one measured tip nearby, and vice versa."""
    found = np.array([crack.tip for crack in cracks.radial])
    assert len(found) == len(tips)
    distance = np.linalg.norm(found[:, None] - tips[None], axis=2)
    assert distance.min(axis=0).max() <= within
    assert distance.min(axis=1).max() <= within


@pytest.mark.parametrize("count", [4, 5, 6, 7, 8, 9])
@pytest.mark.parametrize("spoilt", ["clean", "noise", "crushed", "all"])
def test_drawn_patterns_are_measured(count: int, spoilt: str) -> None:
    """Random angles, offset circles, and rings of which every other one lacks 30 percent."""
    rng = np.random.default_rng([count, len(spoilt)])
    centre, diameter = rng.uniform(-3e-3, 3e-3, 2), rng.uniform(46e-3, 62e-3)
    tips = tips_on_circle(count, centre, diameter, rng)
    drawing = Drawing()
    for tip in tips:
        drawing.ray(tip)
    ring_centre, ring = centre + rng.uniform(-2e-3, 2e-3, 2), rng.uniform(28e-3, 40e-3)
    begin, share = rng.uniform(0, 2 * np.pi), 0.7 if count % 2 else 1.0
    drawing.arc(ring_centre, ring / 2, begin, begin + 2 * np.pi * share)
    if spoilt in ("noise", "all"):
        drawing.noise(6000, rng)
    if spoilt in ("crushed", "all"):
        drawing.crush(5e-3, rng)
    cracks = measure(drawing.bars(), PLATE, radial_time=BEFORE_RING)

    # a tip falls within a pixel and half of another's width; circles average that
    assert_tips(cracks, tips, 1.5 * L)
    assert cracks.circular_circle is not None
    assert cracks.circular_circle.diameter == pytest.approx(ring, abs=L)
    offset = (cracks.circular_circle.x, cracks.circular_circle.y) - ring_centre
    assert np.linalg.norm(offset) < L
    assert cracks.circular_coverage == pytest.approx(share, abs=0.06)  # two sectors of 36
    angle = np.sort(np.arctan2(tips[:, 1], tips[:, 0]))
    if np.diff(np.append(angle, angle[0] + 2 * np.pi)).max() < np.pi:
        assert cracks.radial_circle is not None
        assert cracks.radial_circle.diameter == pytest.approx(diameter, abs=1.5 * L)
        offset = (cracks.radial_circle.x, cracks.radial_circle.y) - centre
        assert np.linalg.norm(offset) < L
    else:
        assert cracks.radial_circle is None


def test_rays_without_a_ring() -> None:
    cracks = measure(star(10, 80, 150, 230, 300).bars(), PLATE, radial_time=BEFORE_RING)
    assert len(cracks.radial) == 5
    assert cracks.circular_circle is None
    assert cracks.circular_coverage == 0.0
    assert cracks.summary()["circular_diameter_m"] is None


def test_a_ring_is_told_from_rays_by_direction_alone() -> None:
    drawing = star(10, 80, 150, 230, 300)
    drawing.arc(np.zeros(2), 17e-3, 0.0, 2 * np.pi)
    cracks = measure(drawing.bars(), PLATE)
    assert cracks.circular_circle is not None
    assert cracks.circular_circle.diameter == pytest.approx(34e-3, abs=L)
    assert len(cracks.radial) == 5
    # without it, the same rays hardly turn around the axis
    assert measure(star(10, 80, 150, 230, 300).bars(), PLATE).circular_circle is None


def test_a_short_arc_is_no_ring() -> None:
    drawing = star(10, 80, 150, 230, 300)
    drawing.arc(np.zeros(2), 17e-3, 0.0, 0.4 * 2 * np.pi)
    cracks = measure(drawing.bars(), PLATE, radial_time=BEFORE_RING)
    assert cracks.circular_circle is None
    assert cracks.circular_coverage == pytest.approx(0.4, abs=0.06)


def test_rays_of_unequal_length() -> None:
    lengths = np.array([28e-3, 20e-3, 26e-3, 17e-3, 24e-3, 22e-3])
    tips = np.array([ray(60.0 * n + 7, length) for n, length in enumerate(lengths)])
    drawing = Drawing()
    for tip in tips:
        drawing.ray(tip)
    cracks = measure(drawing.bars(), PLATE, radial_time=BEFORE_RING)
    assert_tips(cracks, tips, 1.5 * L)
    assert cracks.radial_circle is not None
    # at the least sum of squares the mean distance from the circle is zero (derivative by radius)
    centre = np.array([cracks.radial_circle.x, cracks.radial_circle.y])
    distance = np.linalg.norm(tips - centre, axis=1)
    assert 2 * distance.mean() == pytest.approx(cracks.radial_circle.diameter, abs=L)
    assert cracks.radial_circle.scatter == pytest.approx(distance.std(), rel=0.15)
    reach = np.linalg.norm([crack.tip for crack in cracks.radial], axis=1)
    assert list(reach) == sorted(reach, reverse=True)


def test_nothing_at_all() -> None:
    nothing = Drawing().bars()
    cracks = measure(nothing, PLATE)
    assert cracks.radial == ()
    assert cracks.radial_circle is None
    assert cracks.circular_circle is None
    assert cracks.mean_speed is None
    assert cracks.summary() == NO_CRACKS | {"radial_time_s": 0.0}
    cracks = measure(nothing, PLATE, time=np.linspace(0.0, 1e-2, 11))
    assert cracks.growth.length.max() == 0.0
    assert cracks.radial_time == 1e-2


def test_noise_alone_is_no_crack() -> None:
    drawing = Drawing()
    drawing.noise(20_000, np.random.default_rng(4))
    cracks = measure(drawing.bars(), PLATE)
    assert cracks.radial == ()
    assert cracks.circular_circle is None


def test_a_crack_parallel_to_the_plate_is_none() -> None:
    drawing = Drawing()
    drawing.delaminate(15e-3)
    assert len(drawing.bars().bar) > 10_000
    assert not np.isfinite(measure(drawing.bars(), PLATE).map.arrival).any()


@pytest.mark.parametrize(("depth", "count"), [(0.25, 0), (0.45, 5)])
def test_a_crack_counts_from_a_third_of_the_thickness_on(depth: float, count: int) -> None:
    drawing = Drawing()
    for angle in (10, 80, 150, 230, 300):
        drawing.ray(ray(angle), depth=depth)
    cracks = measure(drawing.bars(), PLATE)
    assert len(cracks.radial) == count
    assert not np.isfinite(cracks.through.arrival).any()  # two thirds are not reached


@pytest.mark.parametrize(("fork", "count"), [(0.75, 3), (0.3, 4)])
def test_a_fork_counts_twice_if_its_prongs_are_most_of_it(fork: float, count: int) -> None:
    drawing = star(130, 250)
    trunk = fork * ray(10)
    share = np.linspace(0.0, 1.0, 4000)[:, None]
    for side in (-40, 40):
        prong = trunk + share * (1 - fork) * ray(10 + side)
        whole = np.vstack([share * trunk, prong])
        drawing.curve(whole, np.linspace(START, END, len(whole)))
    assert len(measure(drawing.bars(), PLATE).radial) == count


@pytest.mark.parametrize("turn", [0.0, 27.0])
@pytest.mark.parametrize("wide", [(90, 270), (0, 90, 180, 270), (180,)])
def test_a_wide_arm_is_an_arm(wide: tuple[int, ...], turn: float) -> None:
    """A cross with arms of two and a half thicknesses: before, these were core."""
    drawing, tips = Drawing(), [ray(angle + turn, 20e-3) for angle in (0, 90, 180, 270)]
    for angle, tip in zip((0, 90, 180, 270), tips, strict=True):
        drawing.wide_ray(tip, 8e-3) if angle in wide else drawing.ray(tip)
    cracks = measure(drawing.bars(), PLATE, radial_time=BEFORE_RING)
    assert len(cracks.radial) == 4
    assert cracks.radial_circle is not None
    # the skeleton of a wide arm ends up to half of its width off the middle of its end
    assert cracks.radial_circle.diameter == pytest.approx(40e-3, abs=4e-3)


def test_no_circle_through_tips_on_one_side() -> None:
    cracks = measure(star(0, 50, 100).bars(), PLATE)
    assert len(cracks.radial) == 3
    assert cracks.radial_circle is None
    assert measure(star(0, 180).bars(), PLATE).radial_circle is None


def test_the_axis_may_be_anywhere() -> None:
    drawing, axis = Drawing(), np.array([6e-3, -9e-3])
    tips = np.array([axis + ray(angle, 20e-3) for angle in (15, 100, 190, 280)])
    for tip in tips:
        share = np.linspace(0.0, 1.0, 4000)
        line = axis + share[:, None] * (tip - axis)
        drawing.curve(line, START + share * (END - START))
    cracks = measure(drawing.bars(), PLATE, (float(axis[0]), float(axis[1])))
    assert_tips(cracks, tips, 1.5 * L)
    assert cracks.radial_circle is not None
    assert cracks.radial_circle.diameter == pytest.approx(40e-3, abs=1.5 * L)


def test_a_tip_is_followed_in_time() -> None:
    """The longest ray, 26 mm in END - START, is followed; the others only add length."""
    drawing = star(100, 190, 280, length=18e-3)
    drawing.ray(ray(20, 26e-3))
    time = np.arange(0.0, 8e-3, 1e-5)
    cracks = measure(drawing.bars(), PLATE, radial_time=BEFORE_RING, time=time)
    growth, speed = cracks.growth, 26e-3 / (END - START)
    drawn = speed * (time - START)
    known = np.isfinite(growth.tip_radius)
    # a plate's thickness is core; its outermost pixel belongs to the crack's path
    assert not known[time < START + (3.2e-3 - 1.5 * L) / speed].any()
    assert not known[time > BEFORE_RING].any()
    going = known & (time < END)
    assert np.abs(growth.tip_radius - drawn)[going].max() < 1.2 * L
    assert abs((growth.tip_radius - drawn)[going].mean()) < 0.2 * L
    assert cracks.mean_speed == pytest.approx(speed, rel=0.03)  # it stands still from END on
    # a mean of slopes over 0.2 ms, in steps of a pixel
    inner = (time > 3e-3) & (time < 6.5e-3)
    assert growth.tip_speed[inner].mean() == pytest.approx(speed, rel=0.03)
    assert np.all(np.diff(growth.length) >= 0)
    # from a plate's thickness off the axis on; a raster's line is up to 8 % longer than a straight
    # one (cos + (sqrt 2 - 1) sin at 22.5 deg), and thinning takes about a pixel off each end
    drawn_length = 3 * 18e-3 + 26e-3 - 4 * 3.2e-3
    assert 0.94 * drawn_length < growth.length[-1] < 1.08 * drawn_length


def test_a_column_cracks_when_a_third_of_its_levels_has() -> None:
    """Bars along x at x = 0.5 L, y = 0 (one column on either side), levels broken in turn."""
    height = np.arange(13) * L / 2
    corner = np.arange(13) % 2 == 0
    x = np.where(corner, 0.5, 1.0) * L  # between corner nodes 0, 1; between centres 1/2, 3/2
    y = np.where(corner, 0.0, 0.5) * L
    bars = BrokenBars(
        1e-3 * (1.0 + np.arange(13)),
        np.stack([x, y, height], axis=1),
        np.where(corner, 0, 3).astype(np.uint8),
    )
    arrival = crack_map(bars, PLATE).arrival
    # column (87, 87) has its corner at (0, 0): 5 of 13 levels have broken with the fifth bar
    assert arrival[87, 87] == pytest.approx(5e-3)
    # the column below shares the corner bars alone: levels 0, 2, 4, 6, 8 with the ninth bar
    assert arrival[87, 86] == pytest.approx(9e-3)
    assert np.isfinite(arrival).sum() == 3  # and (88, 87): the six centre bars
    assert "0-2 corner edges along x, y, z; 3-5 centre-to-centre" in MODULE.numbering


def test_broken_area_of_a_plane_is_its_area() -> None:
    """Bars cut by a plane normal to x: weights of faces and edges add up to the cross-section."""
    lattice = Lattice(prism(6, 6, 3), 1e-3)
    wide = ((-1.0, -1.0), (1.0, 1.0))
    cut = lattice.bars_crossing(0, 0.5e-3, *wide)
    site, bar = [], []
    for number in range(14):
        found = np.argwhere(cut >> number & 1)
        site.append(found)
        bar.append(np.full(len(found), number))
    place = lattice.bar_midpoints(np.concatenate(site), np.concatenate(bar))
    kind = np.concatenate(bar).astype(np.uint8)
    bars = BrokenBars(np.linspace(1e-3, 2e-3, len(kind)), place, kind)
    text = {
        "scenario": "impact",
        "plate": {"size": [6e-3, 6e-3, 3e-3], "modules_through_thickness": 3},
        "material": {
            "youngs_modulus": 3.35e9,
            "poisson_ratio": 0.25,
            "density": 1190.0,
            "fracture_energy": 1034.0,
            "failure_factor": 31.45,
        },
        "solver": {"duration": 1e-3},
    }
    area = broken_area(bars, parse_scene(text), np.array([0.5e-3, 3e-3]))
    assert area[0] == 0.0
    assert area[1] == pytest.approx(6e-3 * 3e-3, rel=1e-12)


@pytest.mark.filterwarnings("error")
def test_any_broken_bars_can_be_measured() -> None:
    """Hail of bars on plates of any shape: a finished run must not fail at its last step."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        modules = rng.integers(1, (40, 40, 7))
        spacing = 10 ** rng.uniform(-4, -1)
        x, y, z = (float(n) for n in modules * spacing)
        plate = Plate(size=(x, y, z), modules_through_thickness=int(modules[2]))
        count = int(rng.choice([0, 1, 2, 5, 500, 20_000]))
        place = rng.integers(0, 2 * modules + 1, (count, 3)) * spacing / 2 - [x / 2, y / 2, 0]
        if rng.random() < 0.3:
            place[:, 0] = 0.0
        bars = BrokenBars(
            np.sort(rng.uniform(0, 1e-2, count)), place, rng.integers(0, 14, count).astype(np.uint8)
        )
        axis = (rng.uniform(-x / 2, x / 2), rng.uniform(-y / 2, y / 2))
        cracks = measure(bars, plate, axis, rng.choice([None, 5e-3]), np.linspace(0, 1e-2, 20))
        assert cracks.summary().keys() == NO_CRACKS.keys()
        assert 0.0 <= cracks.circular_coverage <= 1.0
        reach = cracks.growth.tip_radius[np.isfinite(cracks.growth.tip_radius)]
        assert np.all(np.diff(reach) >= 0)
        assert np.all(reach <= np.hypot(x, y))


# --- a real run -----------------------------------------------------------------------------------


def stored(name: str, plate: Plate) -> BrokenBars:
    """All broken bars of a run."""
    with np.load(DATA / f"{name}.npz") as file:
        time = 1e-5 * file["time_10us"]
        place = 0.25 * plate.spacing * file["position_quarter_modules"]
        return BrokenBars(time, place, file["bar"])


def test_a_real_run_counted_by_hand() -> None:
    """`ldem impact configs/impact_small.toml`, f64, before the step in lanes: 5594 bars.

    Answers read off a picture of the depth of broken in-plane bars, by eye and ruler.

    At 2.6 ms: six radial cracks, with tips at (-4.8, 10.1), (10.1, 4.8), (10.7, -1.6),
    (-4.8, -10.1), (-8.5, 0.5), (1.1, -8.0) mm. At the end: a circular crack from (-5, -7) over
    (-8, 0), (-5, 8), (0, 5.5), (5, 4.5) to (6, -1) mm, about 14 mm across, open at the bottom.
    2.63 ms is the largest strain energy of its history.
    """
    plate = Plate(size=(0.0464, 0.0464, 0.0016), modules_through_thickness=3)
    cracks = measure(stored("impact_small_broken", plate), plate, radial_time=2.63e-3)
    by_eye = 1e-3 * np.array(
        [(-4.8, 10.1), (10.1, 4.8), (10.7, -1.6), (-4.8, -10.1), (-8.5, 0.5), (1.1, -8.0)]
    )
    assert_tips(cracks, by_eye, 2 * plate.spacing)
    assert cracks.radial_circle is not None
    assert cracks.radial_circle.diameter == pytest.approx(20e-3, abs=1e-3)
    assert cracks.circular_circle is not None
    assert cracks.circular_circle.diameter == pytest.approx(14e-3, abs=1e-3)
    assert 0.5 <= cracks.circular_coverage <= 0.75
    # tip of the longest: 4 mm at 0.85 ms, 10 mm at 2.0 ms, read off maps at those times
    assert cracks.mean_speed == pytest.approx(6e-3 / 1.15e-3, rel=0.25)


def test_a_cross_with_wide_arms_counted_by_hand() -> None:
    """`ldem impact configs/impact_small.toml`, f64, until t2 by the strain energy: 4191 bars.

    By eye on its cracks.png: a cross. The arms along x are thin, those along y seven modules wide,
    with tips at (+-12, -0.5), (0, 10), (0, -10.5) mm. Three cracks were counted of it.
    """
    plate = Plate(size=(0.0464, 0.0464, 0.0016), modules_through_thickness=3)
    cracks = measure(stored("impact_small_cross", plate), plate, radial_time=2.11e-3)
    assert_tips(cracks, 1e-3 * np.array([(12, -0.5), (-12, -0.5), (0, 10), (0, -10.5)]), 1e-3)


def test_a_run_at_full_width_counted_by_hand() -> None:
    """`ldem impact configs/impact.toml` with five modules, safety 0.7, to 8.5 ms: 20 806 bars.

    By eye on its crack_map.png (share of all broken bars, at the end): two long cracks to the
    sides, two upwards, two downwards, mirror images of each other (the striker over the middle of
    a module); tips at (+-25, -1), (+-4.5, 23), (+-2, -23) mm, so d_r about 47 mm. No circular crack
    joins them; a disc of 13 mm is punched out by the striker. 6.77 ms is the largest strain
    energy of its history.
    """
    plate = Plate(size=(0.0928, 0.0928, 0.0032), modules_through_thickness=5)
    bars = stored("impact_five_modules_broken", plate)
    cracks = measure(bars, plate, radial_time=6.77e-3)
    by_eye = 1e-3 * np.array(
        [(x * s, y) for x, y in ((25, -1), (4.5, 23), (2, -23)) for s in (1, -1)]
    )
    # the map by eye is that of the end, 1.7 ms later
    assert_tips(cracks, by_eye, 4 * plate.spacing)
    assert cracks.radial_circle is not None
    assert cracks.radial_circle.diameter == pytest.approx(47e-3, rel=0.05)
    assert abs(cracks.radial_circle.x) < 1e-4  # mirror images
    assert cracks.circular_circle is None


def test_a_run_folder_is_measured(tmp_path: Path) -> None:
    from support.synthetic import SCENE, synthetic_run

    folder = synthetic_run(tmp_path / "run", layers=6)
    cracks = measure_run(folder)
    assert cracks is not None
    # strain energy of synthetic_run is largest just before it fails at 7.5 ms
    assert cracks.radial_time == pytest.approx(7.48e-3, abs=2.1e-5)
    assert len(cracks.radial) == 5  # its five radial cracks, three quarters grown
    folder.write_scene(SCENE.format(layers=6).replace("failure_factor", "damage = false\n#"))
    assert measure_run(folder) is None
    whole = synthetic_run(tmp_path / "whole", cracked=False)
    assert measure_run(RunFolder.open(whole.path)) is None


def test_a_run_does_not_load_what_measures_it_before_its_end() -> None:
    """Neither the scenario nor this module brings SciPy, scikit-image or Matplotlib with it."""
    heavy = ("scipy", "skimage", "matplotlib", "taichi")
    code = (
        "import sys, taichi_ldem.scenarios.impact;"
        "assert 'taichi_ldem.analysis.cracks' not in sys.modules;"
        f"import taichi_ldem.analysis.cracks; assert not [m for m in {heavy} if m in sys.modules]"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
