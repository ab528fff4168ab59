"""The documentation: builds without warnings, its links lead somewhere, its commands exist."""

import ast
import itertools
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer
from support.paths import ROOT
from typer.testing import CliRunner

from taichi_ldem.cli import app as cli
from taichi_ldem.scene import reference as scene_keys

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
IDS = [page.name for page in PAGES]


def _prose(page: Path) -> str:
    """A page without its code."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    return re.sub(r"`[^`\n]*`", "", text)


def _anchor(heading: str) -> str:
    """As Python-Markdown and GitHub make it, for headings of plain words."""
    words = re.sub(r"[^\w\s-]", "", heading.replace("`", "")).strip().lower()
    return re.sub(r"\s+", "-", words)


def _anchors(page: Path) -> set[str]:
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    return {_anchor(heading) for heading in re.findall(r"^#+ (.*)$", text, flags=re.M)}


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_links_lead_somewhere(page: Path) -> None:
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", _prose(page)):
        if target.startswith(("http://", "https://", "mailto:")):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        known = file.exists() and ROOT in (file, *file.parents)
        if not known or (anchor and anchor not in _anchors(file)):
            broken.append(target)
    assert broken == []


# --- commands -------------------------------------------------------------------------------------


def _commands(page: Path) -> list[list[str]]:
    """Lines of code that call ldem, python or make, as words; comments are dropped."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^```(?:bash|sh|console)?\n(.*?)^```", text, flags=re.M | re.S)
    blocks += re.findall(r"(?:^(?: {4}|\t).*\n)+", text, flags=re.M)
    found = []
    for block in blocks:
        for line in block.replace("\\\n", " ").splitlines():
            line = line.strip()
            if re.match(r"(\.venv/bin/)?(ldem|python|pytest)\s|make\s", line):
                words = shlex.split(line.split(" ; ")[0], comments=True)
                found.append([words[0].removeprefix(".venv/bin/"), *words[1:]])
    inline = re.findall(r"`((?:ldem|make) [^`]+)`", text)
    found += [shlex.split(line) for line in inline]
    return found


COMMANDS = [(page.name, words) for page in PAGES for words in _commands(page)]
PLACEHOLDER = re.compile(r"^(DIR|SCENE(\.toml)?|NAME|N|FILE)$|[\[\]{}<>$|]|\.\.\.")


def test_commands_are_found() -> None:
    programs = {words[0] for _, words in COMMANDS}
    assert {"ldem", "make", "python"} <= programs
    assert len(COMMANDS) > 60


@pytest.mark.parametrize(
    ("page", "words"), COMMANDS, ids=[f"{page}-{' '.join(w)[:60]}" for page, w in COMMANDS]
)
def test_commands_exist(page: str, words: list[str]) -> None:
    program, *rest = words
    if program == "ldem":
        _check_ldem(rest)
    elif program == "make":
        targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), flags=re.M)
        assert rest[0] in targets, f"no target {rest[0]}"
    elif program == "python":
        _check_python(rest)
    _check_files(rest)


def _check_ldem(words: list[str]) -> None:
    """The sub-command exists and its own parser takes options and arguments."""
    group: Any = typer.main.get_command(cli.app)
    if words[0].startswith("-"):
        assert words == ["--help"]
        return
    assert words[0].isupper() or words[0] in group.commands, f"no command {words[0]}"
    if words[0].isupper():
        return
    command, rest = group.commands[words[0]], list(words[1:])
    while hasattr(command, "commands"):  # a group of its own
        assert rest[0] in command.commands
        command, rest = command.commands[rest[0]], rest[1:]
    # numbers for what stands for them
    rest = [{"SECONDS": "1e-3", "N": "1"}.get(word, word) for word in rest]
    rest = [re.sub(r"=METRES$", "=0", word) for word in rest]
    options = {name for parameter in command.params for name in parameter.opts}
    if not [word for word in rest if not word.startswith("-")] or any(
        re.search(r"[\[\]|]", word) and "=" not in word for word in rest
    ):  # a command that is only named, or a synopsis
        named = re.findall(r"--[a-z-]+", " ".join(rest))
        assert set(named) <= options, named
        return
    try:
        command.make_context(words[0], rest, resilient_parsing=False).close()
    except cli.UsageError as error:
        pytest.fail(f"{' '.join(words)}: {error.format_message()}")


def _options() -> set[str]:
    """Those of all commands."""
    group: Any = typer.main.get_command(cli.app)
    return {name for c in group.commands.values() for p in c.params for name in p.opts}


def _check_python(words: list[str]) -> None:
    if words[0] == "-m":
        module = words[1]
        if module.split(".")[0] in ("taichi_ldem", "studies"):
            path = ROOT.joinpath(*module.split(".")).with_suffix(".py")
            assert path.is_file(), f"no module {module}"
            source = path.read_text(encoding="utf-8")
            passed_on = "parse_known_args" in source or "REMAINDER" in source
            known = _options() if passed_on else set()
            for option in (word for word in words[2:] if word.startswith("--")):
                assert f'"{option}"' in source or option in known, f"{module} has no {option}"
    elif words[0].endswith(".py"):
        assert (ROOT / words[0]).is_file()


def _check_files(words: list[str]) -> None:
    """Scene files and tests that a command names are there; outputs are made by others."""
    for word in words:
        if re.match(r"(configs|tests|examples|benchmarks)(/|$)", word) and not PLACEHOLDER.search(
            word
        ):
            assert (ROOT / word).exists(), f"{word} does not exist"


@pytest.mark.parametrize(
    "line",
    [
        "ldem impakt configs/impact.toml",
        "ldem impact configs/impact.toml --speed 3",
        "ldem render outputs/x --fps many",
        "ldem impact configs/nowhere.toml",
        "python -m taichi_ldem.studies.nothing",
        "python -m studies.many configs/impact.toml outputs/x --no-such-option",
        "make coffee",
    ],
)
def test_what_does_not_exist_is_caught(line: str) -> None:
    with pytest.raises((AssertionError, pytest.fail.Exception)):
        test_commands_exist("page", line.split())


@pytest.mark.skipif(shutil.which("make") is None, reason="no make")
def test_make_help_lists_every_target() -> None:
    command = [
        "make",
        "--no-print-directory",
        "help",
    ]  # told where to go by a make around the tests
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    listed = {line.split()[0] for line in done.stdout.splitlines() if len(line.split()) > 2}
    phony = re.search(r"^\.PHONY: (.*)$", (ROOT / "Makefile").read_text(), flags=re.M)
    assert phony is not None
    assert listed == set(phony[1].split())


def test_the_environment_of_make_impact_has_what_the_commands_of_the_readme_need() -> None:
    made = (ROOT / "Makefile").read_text()
    for extra in ("report", "movie"):
        assert re.search(rf"-e '\.\[[a-z,]*{extra}[a-z,]*\]'", made), extra


def test_every_scene_is_named_in_the_docs() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    unnamed = [file.name for file in (ROOT / "configs").glob("*.toml") if file.name not in text]
    # `configs/a_cv10.toml`, `_cv25`
    assert [name for name in unnamed if f"`_{name.rpartition('_')[2][:-5]}`" not in text] == []


def test_cheap_commands_run() -> None:
    for words in (["--help"], *([name, "--help"] for name in ("impact", "render", "report"))):
        done = CliRunner().invoke(cli.app, words)
        assert done.exit_code == 0, done.output


def test_overrides_in_the_docs_are_accepted() -> None:
    """Every --set beside a scene file that exists gives a scene that may be run."""
    from taichi_ldem.scene import load_scene

    checked = 0
    for page, words in COMMANDS:
        if words[0] != "ldem" or "--set" not in words:
            continue
        scenes = [w for w in words if w.endswith(".toml") and (ROOT / w).is_file()]
        given = [b for a, b in itertools.pairwise(words) if a == "--set"]
        if scenes and not any("$" in text for text in given):
            load_scene(ROOT / scenes[0], given)
            checked += 1
            assert page
    assert checked >= 2


# --- content --------------------------------------------------------------------------------------


def test_the_reference_of_scene_keys_is_up_to_date() -> None:
    text = (ROOT / "docs/scene-keys.md").read_text(encoding="utf-8")
    assert text == scene_keys.reference(), "make it with python -m taichi_ldem.scene.reference"


def _defined(module: str) -> set[str]:
    """Names that the modules of this name define, methods as Class.method, without an import.

    A module is given by its last name (`laws`), or with its package (`solver.laws`). A package
    counts with all modules in it.
    """
    path = module.replace(".", "/")
    package = ROOT / "taichi_ldem"
    files = [*package.glob(f"**/{path}.py"), *package.glob(f"**/{path}/*.py")]
    assert files, f"there is no module {module}"
    names = set()
    for node in (n for file in files for n in ast.parse(file.read_text(encoding="utf-8")).body):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.add(node.name)
        if isinstance(node, ast.ClassDef):
            inner = [n for n in node.body if isinstance(n, ast.FunctionDef)]
            names |= {f"{node.name}.{n.name}" for n in inner}
    return names


def test_every_equation_names_the_function_that_holds_it() -> None:
    text = (ROOT / "docs/theory.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (.*?) \| .* \| (.*?) \|$", text, flags=re.M)
    covered: set[int] = set()
    for equations, code in rows:
        names = re.findall(r"`(\w+)\.([\w.]+)`", code)
        if equations.startswith(("equation", "-")):
            continue
        assert names, f"{equations} names no function"
        for module, name in names:
            assert name in _defined(module), f"there is no {module}.{name}"
        numbers = [int(n) for n in re.findall(r"\((\d+)\)", equations)]
        covered |= set(range(numbers[0], numbers[-1] + 1)) if " to " in equations else set(numbers)
    assert set(range(1, 19)) <= covered


def test_it_builds_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(
        [*command, "--site-dir", str(tmp_path)],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr + done.stdout
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "fonts.googleapis" not in page
