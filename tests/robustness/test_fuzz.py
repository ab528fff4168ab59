"""Mutated scene files and checkpoints: refused in one line or valid; no traceback, no hang.

``pytest -m slow tests/test_fuzz.py`` takes 20 000 scenes and 2 000 checkpoints, the plain run 200
and 60.
"""

import io
import math
import sys
import time
from typing import TYPE_CHECKING

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from support.blocks import DAMAGE, block_scene
from support.scenes import GOOD

from taichi_ldem.errors import SceneError
from taichi_ldem.model.material import check
from taichi_ldem.scene import parse_scene_text, scene_to_toml
from taichi_ldem.solver import memory
from taichi_ldem.storage import checkpoint as cp
from taichi_ldem.storage.durable import MemoryFile
from taichi_ldem.storage.provenance import scene_hash

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

WHOLE = (
    GOOD.replace("[plate]\n", "[plate]\nperturbation = 0.05\nperturbation_seed = 2\n")
    + """
time_step = "auto"
damping = 1.0
precision = "f32"
[output]
history_interval = 1e-5
field_interval = 1e-4
image_times = [1e-3, 2e-3]
checkpoint_interval = 60
[[notch]]
normal = "x"
position = 0.001
from = [0.0, 0.0]
to = [0.01, 0.002]
[disorder]
fracture_energy_cv = 0.25
youngs_modulus_data = [3.1e9, 3.3e9, 3.6e9]
density_cv = 0.1
correlation_length = 0.004
seed = 3
"""
)
LINES = WHOLE.splitlines()
ODD = (
    *("0", "-0.0", "1", "-1", "1e308", "-1e308", "5e-324", "1e-20", "1e20", "nan", "inf", "-inf"),
    *("true", "false", "''", '"x"', "[]", "[[]]", "{}", "[1]", "[1, 2]", "[1, 2, 3]", "[nan, 1]"),
    *("{a = 1}", "1979-05-27", "0x10", "99999999999999999999", "'rings'", "'free'", "'rim'"),
    *("'disc'", "'f64'", "'metal'", '"../../x"', "'/etc/passwd'"),
)
LIMIT_S = 5.0


def _one_line(error: Exception) -> None:
    assert 0 < len(str(error)) <= 1000
    assert "\n" not in str(error)


def _verify(text: str | bytes) -> None:
    """What the command line does with a scene before Taichi starts, timed."""
    started = time.monotonic()
    try:
        if isinstance(text, bytes):
            text = text.decode("utf-8-sig")
        scene = parse_scene_text(text, "scene.toml")
        check(scene)
        memory.refuse_too_large(scene)
    except UnicodeDecodeError:
        return
    except SceneError as error:
        _one_line(error)
    else:
        # what is accepted is whole: it comes back from its own text with the same hash
        again = parse_scene_text(scene_to_toml(scene), "again")
        assert scene_hash(again) == scene_hash(scene)
        assert all(math.isfinite(time_s) for time_s in scene.field_times)
    assert time.monotonic() - started < LIMIT_S


@st.composite
def changed_values(draw: st.DrawFn) -> str:
    """The scene with odd values, lines taken out, doubled, or put elsewhere."""
    lines = list(LINES)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(lines) - 1))
        kind = draw(st.sampled_from(("value", "value", "value", "drop", "double", "move", "key")))
        key, equals, _ = lines[at].partition("=")
        if kind == "value" and equals:
            value = draw(
                st.one_of(st.sampled_from(ODD), st.floats().map(repr), st.text().map(repr))
            )
            lines[at] = f"{key}= {value}"
        elif kind == "drop" and len(lines) > 1:
            del lines[at]
        elif kind == "double":
            lines.insert(at, lines[at])
        elif kind == "move":
            lines.insert(draw(st.integers(0, len(lines))), lines[at])
        elif kind == "key" and equals:
            lines[at] = f"{draw(st.text(max_size=12))} = {lines[at].partition('=')[2]}"
    return "\n".join(lines)


@st.composite
def changed_bytes(draw: st.DrawFn) -> bytes:
    """The scene with bytes changed, put in and cut out."""
    content = bytearray(WHOLE.encode())
    for _ in range(draw(st.integers(1, 8))):
        at = draw(st.integers(0, max(len(content) - 1, 0)))
        stop = at + draw(st.integers(0, 9))
        content[at:stop] = draw(st.binary(max_size=9))
    return bytes(content)


SCENES = st.one_of(changed_values(), changed_bytes(), st.text(max_size=200))
QUIET = {"deadline": None, "derandomize": True, "database": None}


@settings(max_examples=200, suppress_health_check=[HealthCheck.too_slow], **QUIET)
@given(SCENES)
@example(WHOLE)
def test_a_mutated_scene_is_refused_or_valid(text: str | bytes) -> None:
    _verify(text)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss has other units elsewhere")
def test_20_000_mutated_scenes() -> None:
    import resource

    count = [0]

    @settings(max_examples=20_000, suppress_health_check=list(HealthCheck), **QUIET)
    @given(SCENES)
    def verify(text: str | bytes) -> None:
        count[0] += 1
        _verify(text)

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    verify()
    assert count[0] >= 20_000
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000  # KiB


# -- checkpoints -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plate(taichi: None) -> "tuple[Simulation, bytes]":
    """A small plate under a striker, some steps on, and its checkpoint."""
    from taichi_ldem.solver.simulation import Simulation

    scene = block_scene(
        8,
        8,
        2,
        spacing=0.3e-3,
        material=DAMAGE,
        striker={"diameter": 1e-3, "mass": 1e-3, "velocity": 6.0},
        clamp={"kind": "rings", "inner_diameter": 1.5e-3, "outer_diameter": 2.2e-3},
        output={"history_interval": 1e-6},
    )
    simulation = Simulation(scene)
    simulation.compile()
    samples = simulation.samples()
    history = [{"time_s": next(samples).time, "broken_bars": 0} for _ in range(3)]
    state = simulation.saved_state()
    content = cp.encode(cp.Checkpoint(scene, state, history, simulation.time, 1.0, 1, 0))
    simulation.restore_state(cp.decode(content).state)
    return simulation, content


def _resume(simulation: "Simulation", content: bytes) -> bool:
    """Whether a checkpoint is taken; what is taken must run on or be stopped by the guard."""
    from taichi_ldem.errors import SimulationStopped, TooManyNodes

    started = time.monotonic()
    try:
        checkpoint = cp.decode(content)
        simulation.restore_state(checkpoint.state)
    except ValueError as error:
        _one_line(error)
        assert time.monotonic() - started < LIMIT_S
        return False
    try:
        samples = simulation.samples()
        for _ in range(2):
            next(samples, None)
    except (SimulationStopped, TooManyNodes) as error:
        _one_line(error)
    assert time.monotonic() - started < LIMIT_S
    return True


def _flipped(content: bytes, rng: np.random.Generator) -> bytes:
    """Bytes changed, cut out or put in, checksum as it was."""
    kind, at = rng.integers(4), int(rng.integers(len(content)))
    size = int(rng.integers(1, 64))
    if kind == 0:
        return content[:at]
    noise = rng.integers(0, 256, size, dtype=np.uint8).tobytes()
    if kind == 1:
        return content[:at] + noise + content[at:]
    return content[:at] + noise + content[at + size :]


def _rewritten(content: bytes, rng: np.random.Generator) -> bytes:
    """Datasets and attributes changed, checksum made right: what no accident does."""
    image = MemoryFile()
    with image as file, h5py.File(io.BytesIO(content[cp.HEAD :]), "r") as old:
        for name in old:
            old.copy(name, file)
        file.attrs.update(old.attrs)
        names: list[str] = []
        file.visititems(
            lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None
        )
        for _ in range(rng.integers(1, 4)):
            if rng.random() < 0.2:
                _change_attribute(file, rng)
            else:
                _change_dataset(file, names[rng.integers(len(names))], rng)
    return cp._head(image.content) + image.content


def _change_attribute(file: h5py.File, rng: np.random.Generator) -> None:
    name = rng.choice(sorted(file.attrs)) if len(file.attrs) else "time"
    odd = (-1, 10**18, float("nan"), "x", b"\xff", np.zeros(3), np.arange(0), 1e308)
    file.attrs[name] = odd[rng.integers(len(odd))]


def _change_dataset(file: h5py.File, name: str, rng: np.random.Generator) -> None:
    if name not in file:
        return
    values = file[name][()]
    kind = rng.integers(7)
    del file[name]
    if kind == 0:
        return
    array = np.atleast_1d(np.array(values))
    odd = [0, 1, -1, 255, 2**15, 2**31 - 1, -(2**31), np.nan, np.inf, 1e300, -1e-300]
    if kind == 1:
        array = array[: rng.integers(len(array) + 1)]
    elif kind == 2:
        array = np.concatenate([array, array])
    elif kind == 3:
        array = array.astype([np.float16, np.int8, np.uint64, np.float64][rng.integers(4)])
    elif kind == 4:
        array = array.ravel()
    elif array.size:
        with np.errstate(all="ignore"):
            value = np.array(odd)[rng.integers(len(odd), size=8)]
            at = rng.integers(array.size, size=8)
            array.ravel()[at] = (
                np.nan_to_num(value).astype(array.dtype) if (array.dtype.kind in "iu") else value
            )
    same = kind > 4 and np.ndim(values) == 0
    file.create_dataset(name, data=array[0] if same else array)


@pytest.mark.slow  # resumes what it does not refuse
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("count", [30, 1000])
@pytest.mark.parametrize("change", [_flipped, _rewritten])
def test_a_mutated_checkpoint_is_refused_or_runs(
    plate: "tuple[Simulation, bytes]", change, count: int
) -> None:
    simulation, content = plate
    assert _resume(simulation, content)
    rng = np.random.default_rng(7)
    taken = sum(_resume(simulation, change(content, rng)) for _ in range(count))
    if change is _flipped:
        assert taken == 0
    else:
        assert 0 < taken < count  # values within the right shapes are nobody's to judge
    assert _resume(simulation, content)
