"""The history: every bit is kept, and a line that a kill has cut off is dropped."""

import numpy as np
import pytest
from support.refusals import one_line

from taichi_ldem.errors import DamagedFile, SceneError
from taichi_ldem.storage.folder import RunFolder
from taichi_ldem.storage.history import HistoryWriter, finite_rows, read_history, read_table


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


TABLE = "time_s,force_n\n0.0,1.0\n0.5,2.0\n1.0,3.0\n"


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("0.5,", "nan,", "line 3 has time_s = nan"),
        ("1.0,", "inf,", "line 4 has time_s = inf"),
        ("2.0", "nan", "line 3 has force_n = nan"),
        ("2.0", "9" * 400, "line 3 has force_n = inf"),
        ("2.0", "1e300", "line 3 has force_n = 1e+300"),
        ("0.5,", "0.0,", "line 3 is not later than the line before"),
        ("1.0,", "0.2,", "line 4 is not later than the line before"),
        ("0.5,", "1e-300,", "line 3 is too close to the line before"),
        ("2.0", "2.0#", "could not convert"),
        ("time_s,force_n", "time_s,time_s", "its first line must name every column once"),
        ("time_s,", "t,", "its first line must name every column once, time_s first"),
        (",force_n", "", "header and rows differ in length"),
        ("force_n", "force\x00\xff", "cannot|has no"),
    ],
)
def test_a_history_that_was_edited_is_refused_by_its_line(tmp_path, old, new, what):
    file = tmp_path / "history.csv"
    file.write_text(TABLE.replace(old, new, 1), encoding="latin-1")
    with pytest.raises(DamagedFile) as error:
        _ = read_history(file)["force_n"]
    assert "history.csv" in one_line(error)
    assert any(part in str(error.value) for part in what.split("|"))


def test_a_mark_before_a_history_is_passed_over_and_a_missing_column_is_named(tmp_path):
    file = tmp_path / "history.csv"
    file.write_text("\ufeff" + TABLE.replace("\n", "\r\n"), encoding="utf-8", newline="")
    table = read_history(file)
    np.testing.assert_array_equal(table["force_n"], [1.0, 2.0, 3.0])
    with pytest.raises(DamagedFile, match=r"history\.csv' has no column 'strain_j'"):
        table["strain_j"]


def test_the_last_row_of_a_run_that_was_stopped_need_not_be_finite(tmp_path):
    file = tmp_path / "history.csv"
    file.write_text(TABLE.replace("3.0", "nan"))
    table = read_history(file)
    assert len(table["force_n"]) == 3
    np.testing.assert_array_equal(finite_rows(table)["force_n"], [1.0, 2.0])
    file.write_text("time_s,force_n\n0.0,inf\n")
    assert len(finite_rows(read_history(file))["time_s"]) == 1


def test_a_table_without_rows_or_with_other_values_than_numbers(tmp_path):
    file = tmp_path / "profiles.csv"
    file.write_text(TABLE.replace("0.5", "0.0"))
    np.testing.assert_array_equal(read_table(file)["time_s"], [0.0, 0.0, 1.0])
    for text in ("time_s,force_n\n", TABLE.replace("3.0", "nan"), TABLE.replace("3.0", "x")):
        file.write_text(text)
        with pytest.raises(DamagedFile, match=r"profiles\.csv"):
            read_table(file)
