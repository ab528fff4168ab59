"""The table of pieces: what goes in comes out, also after a kill."""

from pathlib import Path

import numpy as np
import pytest
from support.refusals import one_line

from taichi_ldem.errors import DamagedFile, SceneError
from taichi_ldem.storage.fragments import COLUMNS, FragmentWriter, read_fragments


def _pieces(count: int, seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    values = {name: rng.normal(size=count) for name in COLUMNS[1:]}
    return values | {"fragment": np.arange(count), "nodes": np.arange(count) + 1}


def _written(path: Path) -> FragmentWriter:
    writer = FragmentWriter(path)
    for time in (0.0, 0.1, 0.2):
        writer.append(time, _pieces(3, seed=int(10 * time)))
    return writer


def test_pieces_are_read_as_they_were_written(tmp_path: Path) -> None:
    _written(tmp_path / "fragments.csv")
    read = read_fragments(tmp_path / "fragments.csv")
    assert list(read) == list(COLUMNS)
    np.testing.assert_array_equal(read["time_s"], np.repeat([0.0, 0.1, 0.2], 3))
    for name, values in _pieces(3, seed=1).items():
        np.testing.assert_array_equal(read[name][3:6], values, err_msg=name)


def test_a_resumed_run_drops_what_came_after_its_checkpoint(tmp_path: Path) -> None:
    """Also a line that a kill has cut off; the file is then the one of a run without a stop."""
    path = tmp_path / "fragments.csv"
    _written(path)
    whole = path.read_bytes()
    path.write_bytes(whole[:-20])
    writer = FragmentWriter(path, until=0.1)
    assert read_fragments(path)["time_s"].max() == 0.1
    writer.append(0.2, _pieces(3, seed=2))
    assert path.read_bytes() == whole


def test_a_file_that_ends_before_the_checkpoint_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "fragments.csv"
    _written(path)
    with pytest.raises(SceneError) as error:
        FragmentWriter(path, until=0.3)
    assert "ends before the time that the checkpoint records" in one_line(error)


@pytest.mark.parametrize("content", ["", "time_s,fragment\n1,2,3\n", "time_s,fragment\n0,x\n"])
def test_a_damaged_table_is_refused_in_one_line(tmp_path: Path, content: str) -> None:
    path = tmp_path / "fragments.csv"
    path.write_text(content)
    with pytest.raises(DamagedFile) as error:
        read_fragments(path)
    assert str(path) in one_line(error)
