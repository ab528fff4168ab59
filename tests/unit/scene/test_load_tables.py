"""Files that give the course of a load."""

from pathlib import Path

import pytest
from support.blocks import block_scene
from support.refusals import one_line

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import load_scene, scene_to_toml

LOAD = {"face": "+x", "force": 1.0, "direction": "x"}
COURSE = {"course": "table", "times": [0.0, 1.0], "factors": [0.0, 1.0]}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A scene whose load names the file pulse.csv next to it."""
    path = tmp_path / "scene.toml"
    text = scene_to_toml(block_scene(6, 4, 2, load=[LOAD | COURSE]))
    begin, end = text.index("times ="), text.index("]", text.index("factors =")) + 1
    path.write_text(text[:begin] + 'table = "pulse.csv"' + text[end:])
    return path


@pytest.mark.parametrize("head", ["", "time_s,factor\n", "# made by hand\n"])
def test_a_file_becomes_part_of_the_resolved_scene(
    file: Path, tmp_path: Path, head: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "pulse.csv").write_text(head + "0, 0\n1e-6, 0.25\n2e-6,1\n")
    monkeypatch.chdir(tmp_path.parent)
    (load,) = (scene := load_scene(file)).loads
    assert load.times == (0.0, 1e-6, 2e-6)
    assert load.factors == (0.0, 0.25, 1.0)
    again = tmp_path / "resolved.toml"
    again.write_text(scene_to_toml(scene))
    (tmp_path / "pulse.csv").unlink()
    assert load_scene(again) == scene


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot read"),
        ("", "must hold at least two lines of two numbers"),
        ("0,0\n", "must hold at least two lines of two numbers"),
        ("0,0\n1,2,3\n", "must hold at least two lines of two numbers"),
        ("0,0\n1,one\n", "must hold at least two lines of two numbers"),
        ("0;0\n1;1\n", "must hold at least two lines of two numbers"),
        ("0,0\n1e-6,1\n1e-6,2\n", "load[0].times = [0.0, 1e-06, 1e-06]: must rise"),
        ("0,0\n1e-6,nan\n", "load[0].factors[1] = nan: must be a finite number"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(
    file: Path, tmp_path: Path, content: str | None, message: str
) -> None:
    if content is not None:
        (tmp_path / "pulse.csv").write_text(content)
    with pytest.raises(SceneError) as error:
        load_scene(file)
    line = one_line(error)
    assert message in line
    assert "load[0]." in line


def test_a_file_and_its_values_exclude_each_other(file: Path) -> None:
    with pytest.raises(SceneError, match=r"cannot be given together with load\[0\]\.times"):
        load_scene(file, ["load.times=[0.0, 1.0]"])
