"""Loads, starts and probes of a scene: names, defaults, and what is refused in one line."""

import math
from pathlib import Path
from typing import Any

import pytest
from support.blocks import block_scene
from support.refusals import one_line

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import load_scene, parse_scene_text, scene_to_toml
from taichi_ldem.scene.load_rules import RESERVED
from taichi_ldem.solver.contact import CONTACTS

PULL = {"face": "+x", "traction": 1e6, "direction": "x"}
TABLE = {"course": "table", "times": [0.0, 1e-6], "factors": [0.0, 1.0]}


def scene(*loads: dict[str, Any], **tables: Any) -> Any:
    return block_scene(6, 4, 2, load=list(loads), **tables)


def test_loads_and_probes_have_names_and_a_resolved_scene_is_the_same_scene() -> None:
    found = scene(PULL, PULL | {"name": "pull"}, PULL | TABLE, probe=[{"point": [0, 0, 0]}])
    assert [load.name for load in found.loads] == ["load1", "pull", "load3"]
    assert found.loads[0].columns == ("load1_force_n", "load1_displacement_m")
    assert found.probes[0].columns[-1] == "probe1_velocity_z_m_s"
    assert parse_scene_text(scene_to_toml(found), "again") == found
    assert scene(PULL | {"direction": "-y"}).loads[0].unit == (0.0, -1.0, 0.0)
    assert scene(PULL | {"direction": [0, 3, 4]}).loads[0].unit == pytest.approx((0, 0.6, 0.8))


def test_a_scene_without_loads_has_no_word_of_them() -> None:
    text = scene_to_toml(block_scene(6, 4, 2))
    assert not {"[[load]]", "[start]", "[[probe]]"} & set(text.splitlines())
    assert "load = " not in text
    assert "probe = " not in text


def test_a_load_has_no_name_with_which_other_columns_begin() -> None:
    columns = [o.column for contact in CONTACTS for o in contact.observables if not o.energy]
    names = {column.split("_")[0] for column in columns}
    assert names <= {*RESERVED}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"face": None}, "missing key 'load[0].face' or 'box'"),
        ({"face": "x"}, 'load[0].face = "x": must be "-x", "+x"'),
        ({"box": [[0, 0, 0], [1, 1, 1]]}, "cannot be given together with load[0].face"),
        ({"traction": None}, "missing key 'load[0].velocity, displacement, traction' or 'force'"),
        ({"force": 1.0}, "load[0].force = 1.0: cannot be given together with load[0].traction"),
        ({"traction": "much"}, 'load[0].traction = "much": must be a number'),
        ({"direction": None}, "missing key 'load[0].direction'"),
        ({"direction": "up"}, 'load[0].direction = "up": must be "x", "-x" and the like'),
        ({"direction": [0, 0, 0]}, "load[0].direction = [0.0, 0.0, 0.0]: must not be zero"),
        ({"lateral": "held"}, 'load[0].lateral = "held": is for a velocity or a displacement'),
        ({"centre": [0, 0]}, "load[0].centre = [0.0, 0.0]: needs load[0].outer_diameter"),
        (
            {"inner_diameter": 2e-3, "outer_diameter": 1e-3},
            "load[0].inner_diameter = 0.002: must be smaller than load[0].outer_diameter",
        ),
        ({"course": "step"}, 'load[0].course = "step": must be "constant", "ramp"'),
        ({"course": "ramp"}, "missing key 'load[0].ramp'"),
        ({"ramp": 1e-6}, 'load[0].ramp = 1e-06: is not for load[0].course = "constant"'),
        ({"course": "half-sine"}, "missing key 'load[0].duration'"),
        ({"course": "table"}, "missing key 'load[0].times' or a file, 'table'"),
        ({"course": "ramp", "ramp": 2e-6, "duration": 1e-6}, "must be at most load[0].duration"),
        (TABLE | {"factors": [1.0]}, "load[0].factors = [1.0]: must have as many numbers"),
        (TABLE | {"times": [1e-6, 1e-6]}, "must rise, and 1e-06 follows 1e-06"),
        (TABLE | {"duration": 1e-6}, 'is not for load[0].course = "table"'),
        ({"course": "table", "table": "a.csv"}, 'load[0].table = "a.csv": is read with a scene'),
        ({"traction": None, "displacement": 1e-6}, "would jump at the start"),
        (
            {"traction": None, "displacement": 1e-6} | TABLE | {"factors": [1.0, 1.0]},
            'load[0].displacement = 1e-06: would jump at the start; take a "ramp"',
        ),
        ({"start": -1.0}, "load[0].start = -1.0: must be at least 0"),
        ({"name": "9"}, 'load[0].name = "9": must begin with a letter'),
        ({"name": "floor"}, 'load[0].name = "floor": is the name of a body'),
        ({"tracton": 1.0}, "unknown key 'load[0].tracton'; did you mean 'traction'?"),
    ],
    ids=str,
)
def test_a_wrong_load_is_refused_in_one_line(change: dict[str, Any], message: str) -> None:
    load = {key: value for key, value in (PULL | change).items() if value is not None}
    with pytest.raises(SceneError) as error:
        scene(load)
    assert message in one_line(error)


def test_tables_that_no_resolved_scene_could_hold_are_refused() -> None:
    many = {"course": "table", "times": list(range(6000)), "factors": [1.0] * 6000}
    scene(PULL | many)
    with pytest.raises(SceneError) as error:
        scene(PULL | many, PULL | many)
    assert "have 12000 lines together, and at most 10000" in one_line(error)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"start": {}}, "table '[start]' is empty; give one of velocity, rotation"),
        ({"start": {"strain": [1.0, 0, 0]}}, "start.strain[0] = 1.0: must be at most 0.2"),
        ({"start": {"rotation": 3.0}}, "start.rotation = 3.0: must be a list of 3 numbers"),
        ({"probe": [{}]}, "missing key 'probe[0].point, box' or 'plane'"),
        ({"probe": [{"plane": "x"}]}, "missing key 'probe[0].position'"),
        ({"probe": [{"point": [0, 0, 0], "position": 1}]}, "is for probe[0].plane only"),
        ({"probe": [{"point": [5, 0, 0]}]}, "probe[0].point = [5.0, 0.0, 0.0]: must lie in the"),
        ({"probe": [{"point": [0, 0, 0], "quantities": []}]}, "probe[0].quantities = []"),
        (
            {"probe": [{"point": [0, 0, 0], "quantities": ["stress", "stress"]}]},
            'probe[0].quantities = ["stress", "stress"]: names one of them twice',
        ),
        ({"probe": [{"point": [0, 0, 0], "quantities": ["force"]}]}, "probe[0].quantities[0] = "),
        ({"probe": [{"plane": "z", "position": 9}]}, "probe[0].position = 9.0: must lie between"),
        ({"probe": [{"point": [0, 0, 0], "name": "load1"}]}, "is the name of load[0] already"),
    ],
    ids=str,
)
def test_a_wrong_start_or_probe_is_refused_in_one_line(
    tables: dict[str, Any], message: str
) -> None:
    with pytest.raises(SceneError) as error:
        scene(PULL, **tables)
    assert message in one_line(error)


def test_a_load_of_a_file_is_overridden_on_the_command_line(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(scene_to_toml(scene(PULL)))
    assert load_scene(file, ["load.traction=2e6"]).loads[0].value == 2e6
    with pytest.raises(SceneError, match=r"command line: load\[0\]\.start = -1"):
        load_scene(file, ["load.start=-1"])


@pytest.mark.parametrize(
    ("load", "speed"),
    [
        ({"traction": 1e6}, 0.0),
        ({"force": 1e3}, 0.0),
        ({"velocity": -3.0}, 3.0),
        ({"velocity": 3.0, "course": "half-sine", "duration": 1e-5}, 3.0),
        ({"velocity": 2.0, "course": "table", "times": [0, 1e-6], "factors": [1.0, -4.0]}, 8.0),
        # the derivatives of 3 t^2 - 2 t^3 and of half a sine are 1.5 and pi at most
        ({"displacement": -2e-5, "course": "ramp", "ramp": 1e-5}, 3.0),
        ({"displacement": 2e-5, "course": "half-sine", "duration": 1e-5}, 2 * math.pi),
        (
            {
                "displacement": 1e-5,
                "course": "table",
                "times": [0, 1e-5, 3e-5],
                "factors": [0, 1, -2],
            },
            1.5,
        ),
    ],
)
def test_the_largest_speed_that_a_load_prescribes(load: dict[str, Any], speed: float) -> None:
    (found,) = scene({"face": "+x", "direction": "x"} | load).loads
    assert found.largest_speed == pytest.approx(speed)


def test_contact_of_pieces_knows_every_speed_that_nodes_are_given(taichi: None) -> None:
    """Nodes that touch nothing rest, for as long as nothing that is driven could reach them."""
    from taichi_ldem.solver.contact.kernels.fragments import driven_speed

    pushed = {"face": "+x", "direction": "x", "displacement": 2e-5} | {
        "course": "ramp",
        "ramp": 1e-6,
    }
    striker = {"diameter": 2e-3, "mass": 1e-3, "velocity": 4.0}
    assert driven_speed(scene(pushed, striker=striker)) == pytest.approx(30.0)
    assert driven_speed(scene(PULL, striker=striker)) == 4.0
    assert driven_speed(scene(PULL)) == 0.0
