"""The table of members and the statistics of groups."""

import json
import math

import numpy as np
import pytest
from scipy import stats

from taichi_ldem.ensemble.results import read_rows, statistics, write_statistics, write_table


def test_statistics_are_scipys():
    values = [3.0, 4.5, 2.5, 6.0]
    found = statistics(values)
    assert found.mean == pytest.approx(np.mean(values), rel=1e-15)
    assert found.standard_deviation == pytest.approx(np.std(values, ddof=1), rel=1e-15)
    expected = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert found.interval == pytest.approx(tuple(expected), rel=1e-12)
    assert (found.count, found.smallest, found.largest) == (4, 2.5, 6.0)
    assert statistics([7.0]).interval is None
    two = statistics([7.0, 8.0])  # Student's t of one degree of freedom is 12.7 deviations
    assert (two.interval, two.half_interval) == (None, None)
    assert two.standard_deviation == pytest.approx(math.sqrt(0.5))
    assert statistics([]) is None


def test_table_and_statistics_of_what_there_is(conduct, plan, fake):
    conduct(fake(velocity3=["fail", "fail"]))
    rows = read_rows(plan, conduct.folder)
    lines = write_table(plan, conduct.folder, rows).read_text().splitlines()
    header = lines[0].split(",")
    first, last = (dict(zip(header, lines[n].split(","), strict=True)) for n in (1, 3))
    assert first["striker.velocity"] == "2"
    assert first["first_peak_force_n"] == "101.0"
    assert (first["attempts"], first["state"], first["reason"]) == ("1", "finished", "")
    assert (last["attempts"], last["state"]) == ("2", "failed")
    assert last["reason"] == "error: the plate is velocity3"
    told = json.loads(write_statistics(plan, conduct.folder, rows).read_text())
    assert (told["members"], told["finished"]) == (3, 2)
    assert told["not_finished"]["velocity3"]["state"] == "failed"
    assert [a["exit_code"] for a in told["attempts_not_finished"]] == [7, 7]
    assert told["groups"][0]["statistics"]["first_peak_force_n"]["mean"] == 101.0
