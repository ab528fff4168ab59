"""The study of what contact of pieces costs, without its simulations."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support.paths import CONFIGS

from studies import contact_cost
from taichi_ldem.errors import SceneError
from taichi_ldem.scene import load_scene


def test_the_same_scene_runs_without_and_with_contact() -> None:
    plain = load_scene(CONFIGS / "impact_quick.toml")
    saved = plain.changed("contact.fragments=true", "contact.friction=0.2")
    without, touching = contact_cost.scenes(saved, ["solver.threads=1"])
    assert without == plain.changed("solver.threads=1", "solver.safety=0.5")  # the same step
    assert touching == saved.changed("solver.threads=1")


def test_a_run_whose_pieces_may_lie_in_each_other_is_refused() -> None:
    """The cost was once measured from such a run: its pieces burst apart when they could touch."""
    plain = load_scene(CONFIGS / "impact_quick.toml")
    with pytest.raises(SceneError, match=r"no table \[contact\].*contact.fragments=true"):
        contact_cost.scenes(plain, [])


def test_the_table_has_medians_of_rounds_taken_in_turn() -> None:
    """A round in which the machine was busy slows both simulations down, and not the ratio."""
    rounds = [contact_cost.Round(4.0 * n, 5.0 * n, 0.4, 0.3, 32.0) for n in (1, 10, 1.1)]
    pieces = SimpleNamespace(size=3, dust_size=1, pair_ends=[1, 2, 4])
    pieces.seen, pieces.stamp = SimpleNamespace(to_numpy=lambda: np.array([7, 6, 7, 7])), [7]
    text = contact_cost.table(SimpleNamespace(fragments=pieces, time=2e-3), rounds)  # type: ignore[arg-type]
    assert "| a step with contact | 5.50 ms (+25 %) |" in text
    assert "| awake in the last step | 2 |" in text
    assert "| entries of pairs | 4 |" in text
    assert "| steps between two lists | 32.0 |" in text


def test_a_folder_without_a_checkpoint_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert contact_cost.main([str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert str(tmp_path) in error
