"""`--resume` starts a run, goes on with it or refuses; nothing is run here."""

from pathlib import Path

import pytest
from support.command import SCENE
from support.refusals import one_line

from taichi_ldem.cli import main
from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios import launch, runner
from taichi_ldem.scenarios.registry import SCENARIOS
from taichi_ldem.scene import Scene, parse_scene_text, scene_to_toml
from taichi_ldem.storage.folder import RunFolder

IMPACT = SCENARIOS["impact"]


@pytest.fixture
def scene() -> Scene:
    return parse_scene_text(SCENE, "t.toml")


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What would have been done."""
    deeds: list[str] = []

    def run(*_: object, force: bool = False, **__: object) -> int:
        deeds.append("begun anew" if force else "begun")
        return 0

    def resume(*_: object, scene: Scene, **__: object) -> int:
        deeds.append(f"resumed with {scene.solver.threads} threads")
        return 0

    monkeypatch.setattr(runner, "run", run)
    monkeypatch.setattr(runner, "resume", resume)
    return deeds


def _begun(out: Path, scene: Scene) -> RunFolder:
    folder = RunFolder.create(out, force=False)
    folder.write_scene(scene_to_toml(scene))
    return folder


def test_a_run_is_started_where_there_is_none(scene: Scene, done: list[str], tmp_path: Path):
    launch.go_on(IMPACT, scene, tmp_path / "run")
    assert done == ["begun"]


def test_a_run_without_a_checkpoint_is_started_anew(scene: Scene, done: list[str], tmp_path: Path):
    folder = _begun(tmp_path / "run", scene)
    launch.go_on(IMPACT, scene, folder.path)
    folder.scene_file.unlink()  # killed between the record and the scene
    launch.go_on(IMPACT, scene, folder.path)
    assert done == ["begun anew", "begun anew"]


@pytest.mark.parametrize("file", ["checkpoint.h5", "checkpoint.previous.h5", "summary.json"])
def test_a_run_of_the_same_scene_goes_on_with_other_threads(
    scene: Scene, done: list[str], tmp_path: Path, file: str
) -> None:
    folder = _begun(tmp_path / "run", scene)
    (folder.path / file).touch()
    other = parse_scene_text(SCENE.replace("[solver]", "[solver]\nthreads = 3"), "t.toml")
    launch.go_on(IMPACT, other, folder.path)
    assert done == ["resumed with 3 threads"]


def test_a_run_of_another_scene_is_refused(scene: Scene, done: list[str], tmp_path: Path) -> None:
    folder = _begun(tmp_path / "run", scene)
    other = parse_scene_text(SCENE.replace("velocity = 8.0", "velocity = 6.0"), "t.toml")
    with pytest.raises(SceneError) as error:
        launch.go_on(IMPACT, other, folder.path)
    assert "of another scene: striker.velocity = 8.0 there, 6.0 here" in one_line(error)
    assert done == []


def test_the_command_refuses_what_is_no_run_and_both_options(
    tmp_path: Path, done: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    scene, out = tmp_path / "t.toml", tmp_path / "run"
    scene.write_text(SCENE)
    out.mkdir()
    (out / "thesis.tex").touch()
    words = ["impact", str(scene), "--out", str(out), "--resume"]
    assert main(words) == 2
    assert "is not empty" in capsys.readouterr().err
    assert main([*words, "--force"]) == 2
    assert "exclude each other" in capsys.readouterr().err
    assert main([*words[:-2], str(tmp_path / "new"), "--resume"]) == 0
    assert done == ["begun"]


def test_the_scene_in_the_folder_may_go_on_and_is_never_replaced(
    scene: Scene, done: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = _begun(tmp_path / "run", scene)
    words = ["impact", str(folder.scene_file), "--out", str(folder.path)]
    for option in ("--resume", "--force"):  # there is no checkpoint yet
        assert main([*words, option]) == 2
        assert "holds the scene" in capsys.readouterr().err
    (folder.path / "checkpoint.h5").touch()
    assert main([*words, "--resume"]) == 0
    assert done == ["resumed with None threads"]


def test_a_run_of_a_version_that_kept_no_list_of_files_goes_on(
    scene: Scene, done: list[str], tmp_path: Path
) -> None:
    out, file = tmp_path / "run", tmp_path / "t.toml"
    file.write_text(SCENE)
    out.mkdir()
    (out / "run.json").write_text('{"processes": [{"version": "0.1.0"}]}')
    (out / "scene.toml").write_text(scene_to_toml(scene))
    (out / "checkpoint.h5").touch()
    assert main(["impact", str(file), "--out", str(out), "--resume"]) == 0
    assert done == ["resumed with None threads"]
