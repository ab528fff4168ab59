"""The problems that the gallery lists."""

from pathlib import Path

import pytest

from taichi_ldem.errors import SceneError
from taichi_ldem.gallery import problems
from taichi_ldem.gallery.problem import SCENES
from taichi_ldem.gallery.registry import NAMES, chosen, problem_of
from taichi_ldem.model.material import check


def test_every_file_is_listed_and_every_scene_is_used() -> None:
    folder = Path(problems.__file__).parent
    files = {file.stem for file in folder.glob("*.py")} - {"__init__"}
    assert files == {name.replace("-", "_") for name in NAMES}
    used = {run.scene for name in NAMES for run in problem_of(name).runs}
    assert used == {file.name for file in SCENES.glob("*.toml")}


@pytest.mark.parametrize("name", NAMES)
def test_every_run_has_a_scene_and_a_name_of_its_own(name: str) -> None:
    problem = problem_of(name)
    names = [run.name for run in problem.runs]
    assert len(set(names)) == len(names)
    assert problem.wanted(quick=True), "a quick gallery leaves nothing of it"
    scenes = [run.resolved(quick=False) for run in problem.runs]
    scenes += [run.resolved(quick=True) for run in problem.wanted(quick=True)]
    for scene in scenes:
        check(scene)


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    with pytest.raises(SceneError, match=r"^gallery brazil: must be one of .*strip"):
        chosen(["brazil"])
    assert chosen([]) == list(NAMES)
    assert chosen(["bending", "strip"]) == [n for n in NAMES if n in ("strip", "bending")]
