"""The tests mirror the package, and no test leans on another test or on a study."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.paths import ROOT

TESTS = ROOT / "tests"
UNIT = sorted((TESTS / "unit").rglob("test_*.py"))


def _imported(file: Path) -> Iterator[str]:
    """The modules that a file imports, inside functions too."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


@pytest.mark.parametrize("file", UNIT, ids=lambda file: str(file.relative_to(TESTS / "unit")))
def test_a_unit_test_lies_where_its_module_lies(file: Path) -> None:
    folder = ROOT / "taichi_ldem" / file.parent.relative_to(TESTS / "unit")
    name = file.stem.removeprefix("test_")
    assert (folder / f"{name}.py").is_file() or (folder / name / "__init__.py").is_file()


def test_no_test_imports_another_test_or_a_study() -> None:
    found = [
        f"{file.relative_to(TESTS)} imports {module}"
        for file in TESTS.rglob("*.py")
        for module in _imported(file)
        if any(part.startswith("test_") for part in module.split("."))
        or (module.split(".")[0] == "studies" and not file.is_relative_to(TESTS / "studies"))
    ]
    assert found == []
