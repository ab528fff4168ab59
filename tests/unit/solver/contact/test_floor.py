from support.blocks import block_scene

from taichi_ldem.solver.contact.floor import FLOOR


def test_a_floor_that_nothing_has_touched_is_told() -> None:
    scene = block_scene(4, 4, 2, floor={"gap": 0.5})
    (line,) = FLOOR.warnings(scene, [{"floor_force_n": 0.0}, {"floor_force_n": 0.0}])
    assert line.startswith("nothing touched the floor: floor.gap = 0.5 was not crossed in ")
    assert FLOOR.warnings(scene, [{"floor_force_n": 0.0}, {"floor_force_n": 2.0}]) == []
    assert FLOOR.warnings(block_scene(4, 4, 2), [{"floor_force_n": None}]) == []


def test_friction_is_left_out_where_it_is_zero() -> None:
    assert FLOOR.without_friction(block_scene(4, 4, 2)) == ""
    assert FLOOR.without_friction(block_scene(4, 4, 2, floor={"friction": 0.1})) == ""
    line = FLOOR.without_friction(block_scene(4, 4, 2, floor={}))
    assert line == "friction of the floor (friction = 0)"
