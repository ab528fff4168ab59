"""The table of what scenes leave out."""

from studies.leave_out import table
from taichi_ldem.scenarios.leave_out import Cost


def test_the_table_gives_both_costs_and_their_shares() -> None:
    text = table({"impact": (Cost(20, 50_000_000, 7, 3.0), Cost(30, 100_000_000, 8, 6.0))})
    assert "| impact | 20, 30 | 50.00, 100.00 | 7, 8 | 3, 6 | 50 % | 50 % |" in text
