"""The history: every bit is kept, and a line that a kill has cut off is dropped."""

import numpy as np
import pytest
from support.refusals import one_line

from taichi_ldem.errors import SceneError
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.history import HistoryWriter


def test_history_keeps_every_bit(tmp_path):
    folder = RunFolder.create(tmp_path / "run", force=False)
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.random(50))
    with HistoryWriter(folder.history_file, ("time_s", "force_n", "broken_bars")) as history:
        for n, time in enumerate(times):
            history.append((time, float(time) / 3.0, n))
            assert len(folder.read_history()["time_s"]) == n + 1  # on disk at once
    table = folder.read_history()
    assert list(table) == ["time_s", "force_n", "broken_bars"]
    np.testing.assert_array_equal(table["time_s"], times)
    np.testing.assert_array_equal(table["force_n"], times / 3.0)
    assert folder.history_file.read_text().splitlines()[1].endswith(",0")


def test_a_history_line_cut_off_by_a_kill_is_dropped(tmp_path):
    folder = RunFolder.create(tmp_path / "run", force=False)
    # 12.5 may have been 12.5678: a last line without its end is not to be trusted.
    folder.history_file.write_text("time_s,force_n\n0.0,1.0\n0.5,2.0\n1.0,12.5")
    np.testing.assert_array_equal(folder.read_history()["force_n"], [1.0, 2.0])
    folder.history_file.write_text("time_s,force_n\n")
    assert folder.read_history()["time_s"].shape == (0,)


@pytest.mark.parametrize("text", ["", "time_s,force_n\n1.0\n", "time_s\nabc\n", "a,b\n1,2\n3\n"])
def test_what_is_no_history_is_refused(tmp_path, text):
    folder = RunFolder.create(tmp_path / "run", force=False)
    folder.history_file.write_text(text)
    with pytest.raises(SceneError) as error:
        folder.read_history()
    assert "history.csv" in one_line(error)


def test_a_row_of_another_length_is_refused(tmp_path):
    with (
        HistoryWriter(tmp_path / "history.csv", ("time_s", "force_n")) as history,
        pytest.raises(ValueError, match="2"),
    ):
        history.append((1.0,))
