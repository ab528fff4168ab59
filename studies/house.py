"""How the package is built: sizes of files and functions, and which imports go up or in circles.

    python -m studies.house [ROOT ...]

Each ROOT is a checkout of the project (default: this one). Several are printed side by side, so a
change of the structure is one command: ``git worktree add ../before COMMIT``, then
``python -m studies.house ../before .``.

Floors: a module stands one floor above the highest module that it imports when it is loaded.
Imports inside functions count where they go up, and in circles; imports for type checkers do not.
"""

import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

PACKAGE = "taichi_ldem"
LONG_FILE, LONG_FUNCTION, MANY_ARGUMENTS = 500, 60, 8


def main() -> int:
    """Print the table, a column for each checkout."""
    roots = [Path(word) for word in sys.argv[1:]] or [Path(__file__).parents[1]]
    columns = [measure(root) for root in roots]
    for name in columns[0]:
        cells = "".join(f"{column[name]:>12,}" for column in columns)
        print(f"{name:44s}{cells}")
    for root in roots:
        for line in named(root):
            print(f"{root}: {line}")
    return 0


def measure(root: Path) -> dict[str, int]:
    """The numbers of a checkout, by what they count."""
    graph = Graph(root / PACKAGE)
    functions = [f for file in sources(root / PACKAGE) for f in functions_of(file)]
    return {
        "modules at the top of the package": len(list((root / PACKAGE).glob("[!_]*.py"))),
        "modules of the package": len(graph.modules),
        "floors": max(graph.floor(module) for module in graph.modules),
        "circles": len(graph.circles()),
        "imports that go up": len(graph.upward()),
        f"files over {LONG_FILE} lines": len(long_files(root)),
        f"functions over {LONG_FUNCTION} lines": sum(f.lines > LONG_FUNCTION for f in functions),
        f"functions of {MANY_ARGUMENTS} or more arguments": sum(
            f.arguments >= MANY_ARGUMENTS for f in functions
        ),
        "lines of the package": lines_of(sources(root / PACKAGE)),
        "lines of studies outside the package": lines_of(sources(root / "studies")),
        "lines of tests": lines_of(sources(root / "tests")),
        "lines of docs and README": lines_of([*(root / "docs").glob("*.md"), root / "README.md"]),
    }


def named(root: Path) -> Iterator[str]:
    """A line for each file, function, import and circle that breaks a rule."""
    graph = Graph(root / PACKAGE)
    for file in long_files(root):
        yield f"{file.relative_to(root)}: {lines_of([file])} lines"
    for file in sources(root / PACKAGE):
        for function in functions_of(file):
            if function.lines > LONG_FUNCTION or function.arguments >= MANY_ARGUMENTS:
                size = f"{function.lines} lines, {function.arguments} arguments"
                yield f"{file.relative_to(root)}: {function.name}: {size}"
    for circle in graph.circles():
        yield f"circle: {', '.join(circle)}"
    for one, other in graph.upward():
        yield f"goes up: {one} imports {other}"


def sources(folder: Path) -> list[Path]:
    """All Python files below a folder, in order."""
    return sorted(folder.rglob("*.py"))


def lines_of(files: list[Path]) -> int:
    """Lines of all files together."""
    return sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)


def long_files(root: Path) -> list[Path]:
    """Files of the package, the studies and the tests that are too long to read at once."""
    folders = (PACKAGE, "studies", "tests", "benchmarks")
    return [
        file
        for folder in folders
        for file in sources(root / folder)
        if lines_of([file]) > LONG_FILE
    ]


class Function:
    """A function's name, its lines and its arguments without ``self``."""

    def __init__(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        self.name = node.name
        self.lines = (node.end_lineno or node.lineno) - node.lineno + 1
        given = node.args
        names = [a.arg for a in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
        self.arguments = len([name for name in names if name not in ("self", "cls")])


def functions_of(file: Path) -> list[Function]:
    """All functions and methods of a file."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    return [Function(node) for node in ast.walk(tree) if isinstance(node, kinds)]


class Graph:
    """The imports between the modules of a package.

    Attributes:
        modules: dotted names. loading: what each imports when it is loaded; called: what its
            functions import when they are called.
    """

    def __init__(self, package: Path) -> None:
        self.root = package.parent
        files = {self._name(file): file for file in sources(package)}
        self.modules = sorted(files)
        self.loading: dict[str, set[str]] = {module: set() for module in files}
        self.called: dict[str, set[str]] = {module: set() for module in files}
        for module, file in files.items():
            tree = ast.parse(file.read_text(encoding="utf-8"))
            for node, inside in _imports(tree.body, inside=False):
                found = self._targets(node, module)
                (self.called if inside else self.loading)[module] |= found - {module}

    def _name(self, file: Path) -> str:
        parts = file.relative_to(self.root).with_suffix("").parts
        return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)

    def _targets(self, node: ast.Import | ast.ImportFrom, module: str) -> set[str]:
        if isinstance(node, ast.Import):
            return {alias.name for alias in node.names if alias.name in self.loading}
        base = node.module or ""
        named = {f"{base}.{alias.name}" for alias in node.names}
        modules = {name for name in named if name in self.loading}
        if base in self.loading and len(modules) < len(named):
            # a package that re-exports names of its own modules is not imported by them
            own = base == module.rpartition(".")[0] and self._is_package(base)
            modules |= set() if own else {base}
        return modules

    def _is_package(self, module: str) -> bool:
        return (self.root / Path(*module.split(".")) / "__init__.py").is_file()

    @cache  # noqa: B019 - as many graphs as checkouts
    def floor(self, module: str, above: tuple[str, ...] = ()) -> int:
        """The floor of a module, by what it imports when it is loaded; 1 is the ground."""
        below = self.loading[module] - {module, *above}
        return 1 + max((self.floor(other, (*above, module)) for other in below), default=0)

    def upward(self) -> list[tuple[str, str]]:
        """Imports inside functions of a module that stands on the same floor or above."""
        return [
            (module, other)
            for module in self.modules
            for other in sorted(self.called[module])
            if self.floor(other) >= self.floor(module) and self._reaches(other, module)
        ]

    def _reaches(self, start: str, end: str) -> bool:
        return any(start in circle and end in circle for circle in self.circles())

    @cache  # noqa: B019
    def circles(self) -> tuple[tuple[str, ...], ...]:
        """Groups of modules each of which imports, over others, itself."""
        edges = {m: self.loading[m] | self.called[m] for m in self.modules}
        reach = {m: _reachable(m, edges) for m in self.modules}
        groups = {
            tuple(sorted(o for o in reach[m] if m in reach[o]))
            for m in self.modules
            if m in reach[m]
        }
        return tuple(sorted(groups))


def _reachable(start: str, edges: dict[str, set[str]]) -> set[str]:
    found: set[str] = set()
    waiting = list(edges[start])
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting.extend(edges[module])
    return found


def _imports(
    body: list[ast.stmt], inside: bool
) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
    """Imports below some statements, and whether they are inside a function."""
    for node in body:
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            yield node, inside
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        within = inside or isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
        for name in ("body", "orelse", "finalbody"):
            yield from _imports(getattr(node, name, []), within)
        for handler in getattr(node, "handlers", []):
            yield from _imports(handler.body, within)


if __name__ == "__main__":
    sys.exit(main())
