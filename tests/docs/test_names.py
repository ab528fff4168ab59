"""What the pages name in code exists: modules, functions, files of the source, keys of a scene."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest
from support.paths import ROOT

from taichi_ldem.scene import Scene
from taichi_ldem.scene.schema import tables_of

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FOLDERS = ("taichi_ldem", "studies", "benchmarks", "tests", "examples")
SOURCES = [file for folder in FOLDERS for file in sorted((ROOT / folder).rglob("*.py"))]
# files that a run writes are named too, with these endings
WRITTEN = re.compile(r"\.(json|csv|toml|png|h5|vtkhdf|md|html|mp4|gif|lock|out|err)$")
# names of other programs, and of vectors that a run writes
FOREIGN = {"scipy.signal.sosfiltfilt", "ti.static", "ti.ndrange", "node_dense.h", "bond_bpm_peri.h"}
FOREIGN |= {"mode_01", "mode_02"}


def inline_code(text: str) -> list[str]:
    """Everything in single backticks outside of code blocks."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    return re.findall(r"`([^`\n]+)`", text)


@cache
def names_in(file: Path) -> frozenset[str]:
    """Functions, classes, variables and attributes that a source file defines."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            found.add(node.attr)
        elif isinstance(node, ast.arg):
            found.add(node.arg)
    return frozenset(found)


@cache
def words() -> frozenset[str]:
    """Every word of the sources and of the scenes."""
    files = [file for file in SOURCES if file.parent != Path(__file__).parent]
    files += [*(ROOT / "configs").glob("*.toml"), ROOT / "Makefile"]
    text = "\n".join(file.read_text(encoding="utf-8") for file in files)
    return frozenset(re.findall(r"\w+", text)) | {
        name for table in tables_of(Scene).values() for name in table.model_fields
    }


def modules_named(path: str) -> list[Path]:
    """Source files of a module, or of all modules of a package, given by the end of its path."""
    return [
        file
        for file in SOURCES
        if f"/{file.relative_to(ROOT).with_suffix('').as_posix()}".endswith(f"/{path}")
        or f"/{file.relative_to(ROOT).parent.as_posix()}".endswith(f"/{path}")
    ]


def exists(token: str) -> bool:
    """Whether a dotted name, a path of a source file or a bare name of code is there."""
    if token.endswith(".py"):
        return bool(modules_named(token.removeprefix("./").removesuffix(".py")))
    parts = token.split(".")
    if len(parts) == 1:
        return token in words()
    if is_key(token):
        return True
    if parts[0][0].isupper() or parts[0] == "simulation":  # a class, or what users call its object
        wanted = {parts[0].capitalize() if parts[0] == "simulation" else parts[0], *parts[1:]}
        return any(wanted <= names_in(file) for file in SOURCES)
    for count in range(len(parts), 0, -1):
        files = modules_named("/".join(parts[:count]))
        if files and all(any(part in names_in(f) for f in files) for part in parts[count:]):
            return True
    return False


def is_key(token: str) -> bool:
    """Whether a token is a key of a scene, ``table.key``."""
    table, _, key = token.partition(".")
    fields = tables_of(Scene)[table].model_fields if table in tables_of(Scene) else {}
    return key in {field.alias or name for name, field in fields.items()}


def missing(text: str) -> list[str]:
    """Names of code in a page's text that are nowhere in the project."""
    found = []
    for code in inline_code(text):
        token = re.sub(r"\(.*\)$| = .*$", "", code)
        if token in FOREIGN or WRITTEN.search(token) or not re.fullmatch(r"[\w./]+", token):
            continue
        dotted = re.fullmatch(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+", token)
        source = re.fullmatch(r"[\w./]+\.py", token)
        bare = re.fullmatch(r"[a-z]+(_[a-z0-9]+)+", token)
        value = dotted and " = " in code  # as in a scene
        if (dotted or source or bare) and not (is_key(token) if value else exists(token)):
            found.append(code)
    return found


@pytest.mark.parametrize("page", PAGES, ids=[page.name for page in PAGES])
def test_every_name_of_code_exists(page: Path) -> None:
    assert missing(page.read_text(encoding="utf-8")) == []


def test_names_that_do_not_exist_are_found() -> None:
    text = "`laws.nothing` `solver/nowhere.py` `no_such_name(x)` `storage.gone` `plate.colour`"
    assert len(missing(text)) == 5
    assert missing("`laws.register = 1` `plate.shape = 1`") == ["laws.register = 1"]
    assert (
        missing("`laws.register` `solver/laws` `bar_shares` `plate.size` `scenarios.runner`") == []
    )
