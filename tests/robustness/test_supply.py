"""The package as users get it."""

import sys

import pytest
from support import clean_install


@pytest.mark.slow
@pytest.mark.parametrize("low", [False, True], ids=["newest", "lowest"])
def test_the_wheel_works_where_nothing_else_is(
    low: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["clean_install", *(["--lowest"] if low else [])])
    assert clean_install.main() == 0
    assert "Python 3." in capsys.readouterr().out


def test_every_dependency_has_a_lower_bound() -> None:
    bounds = clean_install.lowest()
    assert any(line.startswith("taichi==") for line in bounds)
    assert all("==" in line for line in bounds)
