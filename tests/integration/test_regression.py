"""The small reference runs (see ``regression``): same bits on the machine that made them.

As the tests compile them, without one of Taichi's passes, and (slow) as users do.
"""

import copy
from typing import Any

import pytest
from support import regression

USERS = pytest.param(True, marks=pytest.mark.slow, id="as users do")


@pytest.fixture(scope="module", params=[pytest.param(False, id="as tests do"), USERS])
def runs(request: pytest.FixtureRequest) -> dict[str, dict[str, Any]]:
    return regression.all_runs(request.param)


@pytest.mark.parametrize("name", regression.SCENES)
def test_a_reference_run_has_not_changed(runs: dict[str, dict[str, Any]], name: str) -> None:
    if name not in runs:
        pytest.skip("run as users do only")
    run, reference = runs[name], regression.stored(name)
    assert regression.deviations(name, run, reference) == []
    known = regression.known_digest(reference, run["made_with"])
    if known is not None:
        why = (
            "results have changed; if you meant that: `python tests/support/regression.py --update`"
        )
        assert run["sha256"] == known, why
    broken = [row[regression.COLUMNS.index("broken")] for row in run["rows"]]
    assert (broken[-1] > 20) == ("elastic" not in name)


def test_a_change_is_seen() -> None:
    """A millionth before cracking, and a fifth after, are not taken for the same."""
    name = "cracking-f64"
    reference = regression.stored(name)
    assert regression.deviations(name, reference, reference) == []
    for row, column, factor, word in ((3, 1, 1 + 1e-6, "before"), (-1, 0, 1.2, "after")):
        changed = copy.deepcopy(reference)
        changed["rows"][row][column] *= factor
        assert len(regression.deviations(name, changed, reference)) == 1
        assert word in regression.deviations(name, changed, reference)[0]
        assert regression.digest(changed["rows"]) != reference["sha256"]
