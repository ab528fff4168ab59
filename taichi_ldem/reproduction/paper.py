"""``ldem paper``: every figure and table of the paper that is a result, recomputed, in its order.

Declarative: ``NEEDS`` lists the run folders and the commands that make them, ``ITEMS`` the figures
and tables, what they need and the function that draws them. Each run is a process of its own and is
resumed from its checkpoint; numbers come from run folders only, the paper's from ``paper`` and
``scenarios.modes``.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taichi_ldem.analysis import paper
from taichi_ldem.errors import SceneError
from taichi_ldem.model.material import bar_families, failure_strain
from taichi_ldem.scene import Scene, load_scene
from taichi_ldem.storage.durable import write_whole
from taichi_ldem.storage.store import RunFolder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNFINISHED = 5
"""Exit code where a run did not end as it should; what the others gave is reported."""

CVS = "0,0.1,0.25,0.5"
_MEASURED_STRENGTH, _MEASURED_G, _SCATTER_G = 75e6, 930.0, 120.0  # Section 3.2 of the paper
_PRINTED = {  # Section 4 of the paper, homogeneous material
    "EA_l [N]": 375.47,
    "EA_d [N]": 195.10,
    "eps_p": 0.01818,
    "eps_r": 0.02238,
    "K_r": 1.23,
}


# --- runs -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Need:
    """A run folder and the command that makes it.

    Attributes:
        words: after the interpreter; "{out}" stands for the folder.
        quick: words added for a quick run.
        quick_scene: stands for the scene in a quick run, if another.
        done: the file that a finished run has.
        resume: words that go on with a folder that was begun.
    """

    name: str
    words: tuple[str, ...]
    quick: tuple[str, ...] = ()
    done: str = "summary.json"
    resume: tuple[str, ...] = ()
    quick_scene: str = ""

    def command(self, folder: Path, *, quick: bool, again: bool) -> list[str]:
        """Words after the interpreter, to begin or to go on."""
        words = self.resume if again else self.words
        if quick and words[2:3] != ("resume",):
            scene = self.quick_scene or words[3]
            words = (*words[:3], scene, *words[4:], *self.quick)
        return [word.format(out=folder) for word in words]


_LDEM = ("-m", "taichi_ldem.cli")
_RESUME = (*_LDEM, "resume", "{out}", "--quiet")
# Single precision and four fifths of the critical time step spare most of the time of thirteen runs
# and of a first look (docs/error-vs-run-time.md has what that costs).
_FASTER = ("--precision", "f32", "--set", "solver.safety=0.8")
_FIVE = ("--set", "plate.modules_through_thickness=5", *_FASTER)
_TO_OUT = ("--out", "{out}", "--quiet", "--force")
_STUDY = ("-m", "taichi_ldem.studies.bending", "configs/bend.toml", "{out}", "--spacings", "5e-4")

_MANY = (
    *(*_LDEM, "ensemble", "configs/impact_measured_strength.toml", "--cv", CVS),
    *("--seeds", "0:4", *_FASTER),
)

NEEDS: dict[str, Need] = {
    need.name: need
    for need in (
        Need("impact", (*_LDEM, "impact", "configs/impact.toml", *_TO_OUT), _FIVE, resume=_RESUME),
        Need(
            "measured",
            (*_LDEM, "impact", "configs/impact_measured_strength.toml", *_TO_OUT),
            _FIVE,
            resume=_RESUME,
        ),
        Need(
            "tension",
            (*_LDEM, "tension", "configs/tension_dumbbell.toml", *_TO_OUT),
            ("--set", "plate.modules_through_thickness=5"),
            resume=_RESUME,
        ),
        Need(
            "bending",
            (*_STUDY, "--set", "solver.duration=0.8e-3"),
            ("--set", "plate.size=[0.030, 0.001, 0.0065]"),
            resume=(*_STUDY, "--set", "solver.duration=0.8e-3"),
        ),
        Need(
            "modes",
            (*_LDEM, "modes", "configs/modes.toml", *_TO_OUT),
            ("--set", "plate.modules_through_thickness=3"),
        ),
        Need(
            "ensemble",
            (*_MANY, *_TO_OUT[:-1]),
            ("--seeds", "0:2"),
            quick_scene="configs/impact_small.toml",
            done="ensemble.json",
            resume=(*_MANY, *_TO_OUT[:-1], "--resume"),
        ),
    )
}


def available(need: Need) -> bool:
    """Whether this version has the command that a run needs."""
    if need.words[:2] == _LDEM:
        return need.words[2] in _commands()
    return importlib.util.find_spec(need.words[1]) is not None


def _commands() -> Iterable[str]:
    import typer

    from taichi_ldem.cli.app import app

    group: Any = typer.main.get_command(app)
    return list(group.commands)


def conduct(
    names: Sequence[str], out: Path, *, quick: bool, resume: bool, tell: Callable[[str], None]
) -> dict[str, str]:
    """Run what is not finished; why, for each run that there is no result of.

    Raises:
        SceneError: results of another kind (quick or full) lie in the folder.
    """
    failed: dict[str, str] = {}
    for name in names:
        need, folder = NEEDS[name], out / "runs" / name
        if not available(need):
            failed[name] = f"`ldem {need.words[2]}` is not in this version"
            continue
        begun = folder.is_dir() and any(folder.iterdir())
        if begun and (folder / need.done).is_file() and _is_whole(need, folder):
            tell(f"{name}: finished already")
            continue
        again = begun and resume and bool(need.resume) and _can_resume(need, folder)
        command = [sys.executable, *need.command(folder, quick=quick, again=again)]
        tell(f"{name}: {' '.join(command[1:])}")
        started = time.perf_counter()
        (out / "logs").mkdir(parents=True, exist_ok=True)
        with (out / "logs" / f"{name}.log").open("w", encoding="utf-8") as log:
            code = subprocess.run(command, stdout=log, stderr=subprocess.STDOUT).returncode
        tell(f"{name}: {time.perf_counter() - started:.0f} s")
        if code:
            last = (out / "logs" / f"{name}.log").read_text(encoding="utf-8").strip()
            failed[name] = f"ended with exit code {code}: {(last.splitlines() or [''])[-1]}"
    return failed


def _can_resume(need: Need, folder: Path) -> bool:
    checkpoints = ("checkpoint.h5", "checkpoint.previous.h5")
    return need.resume[2:3] != ("resume",) or any((folder / c).is_file() for c in checkpoints)


def _is_whole(need: Need, folder: Path) -> bool:
    """Whether a study or an ensemble has all of its specimens."""
    if need.name not in ("bending", "ensemble"):
        return True
    told = json.loads((folder / need.done).read_text(encoding="utf-8"))
    if need.name == "ensemble":
        return bool(told.get("finished") == told.get("members"))
    from taichi_ldem.studies.bending import SPECIMENS

    return len(told.get("specimens", [])) >= len(SPECIMENS)


# --- what is reported -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """A quantity beside the paper's and the experiments'.

    Attributes:
        computed, paper: numbers in ``unit``, or None.
        experiments: lowest and highest in ``unit``, or None.
    """

    quantity: str
    unit: str
    computed: float | None
    paper: float | None = None
    experiments: tuple[float, float] | None = None
    digits: int = 3

    def cells(self) -> tuple[str, ...]:
        """Quantity, computed, paper, experiments, difference."""
        return (
            f"{self.quantity} [{self.unit}]" if self.unit else self.quantity,
            "none" if self.computed is None else self._number(self.computed),
            "" if self.paper is None else self._number(self.paper),
            " to ".join(dict.fromkeys(map(self._number, self.experiments or ()))),
            self.difference(),
        )

    def _number(self, value: float) -> str:
        return f"{value:.{self.digits}f}"

    def difference(self) -> str:
        """From the paper in per cent, and whether within the experiments' range."""
        if self.computed is None:
            return ""
        told = []
        if self.paper:
            told.append(f"{100 * (self.computed / self.paper - 1):+.0f} % from the paper")
        if self.experiments is not None:
            low, high = self.experiments
            inside = low <= self.computed <= high
            nearest = low if self.computed < low else high
            away = 100 * (self.computed / nearest - 1) if nearest else 0.0
            told.append("within the experiments" if inside else f"{away:+.0f} % from their range")
        return "; ".join(told)


@dataclass
class Section:
    """What stands under an item.

    Attributes:
        pictures: (file, caption); copied beside the report.
        markdown: a table that a run has written itself.
    """

    rows: list[Row] = field(default_factory=list)
    pictures: list[tuple[Path, str]] = field(default_factory=list)
    markdown: str = ""
    why: str = ""


@dataclass(frozen=True)
class Context:
    """Where the runs lie and where pictures go."""

    out: Path

    def folder(self, name: str) -> Path:
        """A run folder."""
        return self.out / "runs" / name

    def summary(self, name: str) -> dict[str, Any]:
        """The summary of a run."""
        return RunFolder(self.folder(name)).read_summary()

    def scene(self, name: str) -> Scene:
        """The scene of a run."""
        return load_scene(RunFolder(self.folder(name)).scene_file)

    def picture(self, name: str) -> Path:
        """Where a figure that is drawn for the report goes."""
        return self.out / "images" / f"{name}.png"


@dataclass(frozen=True)
class Item:
    """A figure or table of the paper.

    Attributes:
        needs: run folders, by name; the item is left out, with the reason, where one is missing.
    """

    key: str
    title: str
    needs: tuple[str, ...]
    make: Callable[[Context], Section]


def _scaled(summary: Mapping[str, Any], key: str, factor: float) -> float | None:
    value = summary.get(key)
    return factor * value if isinstance(value, (int, float)) else None


def _draw(file: Path, size: tuple[float, float], draw: Callable[[Figure], None]) -> Path:
    from taichi_ldem.output.figures.draw import save

    file.parent.mkdir(parents=True, exist_ok=True)
    return save(file, draw, size=size, dpi=130)


def _fig2(context: Context) -> Section:
    scene = context.scene("impact")
    bars = bar_families(scene.material, scene.plate.spacing, scene.plate.stiffness)
    families = (("longitudinal", bars.longitudinal), ("diagonal", bars.diagonal))

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel="strain [%]", ylabel="force [N]")
        for number, (name, f) in enumerate(families):
            peak = f.axial_stiffness * f.peak_strain
            ends = 100 * np.array([-f.peak_strain, 0.0, f.peak_strain, f.limit_strain])
            label = f"{name}: K_r = {f.ductility:.2f}"
            axes.plot(ends, [-peak, 0.0, peak, 0.0], color=f"C{number}", label=label)
            half = (f.peak_strain + f.limit_strain) / 2
            axes.plot([0.0, 100 * half], [0.0, peak / 2], color=f"C{number}", ls=":", lw=1.2)
        axes.set_title("dotted: unloading from half of the softening branch", fontsize=12)
        axes.legend()

    picture = _draw(context.picture("fig2"), (8, 5), draw)
    own = {
        "EA_l [N]": bars.longitudinal.axial_stiffness,
        "EA_d [N]": bars.diagonal.axial_stiffness,
        "eps_p": bars.longitudinal.peak_strain,
        "eps_r": bars.longitudinal.limit_strain,
        "K_r": bars.longitudinal.ductility,
    }
    rows = [
        Row(name, "", value, _PRINTED[name], digits=2 if "EA" in name else 5)
        for name, value in own.items()
    ]
    why = (
        "Eq. (2) gives EA_d = 1.299 EA_l where 0.5196 EA_l is printed (phi counted twice); "
        "E = 3.30 GPa in the printed EA_l, 3.35 here; the printed strains are not those of Eq. (9)."
    )
    return Section(rows, [(picture, "Bars of the run's scene")], why=why)


def _fig6(context: Context) -> Section:
    summary = context.summary("tension")
    scene = context.scene("tension")
    low, high = 0.85e-6 * _MEASURED_STRENGTH, 1.15e-6 * _MEASURED_STRENGTH
    given = 1e-9 * scene.material.youngs_modulus
    rows = [
        Row("Young's modulus", "GPa", _scaled(summary, "youngs_modulus", 1e-9), given),
        Row(
            "strength",
            "MPa",
            _scaled(summary, "strength", 1e-6),
            1e-6 * _MEASURED_STRENGTH,
            (low, high),
            1,
        ),
    ]
    bar = 1e-6 * scene.material.youngs_modulus * failure_strain(scene.material)
    why = (
        f"The paper's columns are its measurements. A bar holds E eps_p = {bar:.1f} MPa; free "
        "faces lower E by the share of a layer of half a module; the fillets are stairs of "
        "modules, and each step is a notch (docs/tension.md); nothing in the law is viscous."
    )
    return Section(rows, _pictures(context, "tension", stress_strain="stress over strain"), why=why)


def _fig7(context: Context) -> Section:
    told = context.summary("bending")
    given = load_scene(next(context.folder("bending").glob("*/scene.toml"))).material
    rows = [
        Row("G_f given to the bars", "J/m2", given.fracture_energy, digits=0),
        Row(
            "G_IC, slope of U over B W phi",
            "J/m2",
            told.get("fracture_energy_slope"),
            None,
            (_MEASURED_G - _SCATTER_G, _MEASURED_G + _SCATTER_G),
            0,
        ),
    ]
    why = (
        "The paper measures this test and does not simulate it. A notch's tip is not resolved by "
        "modules of this size, so the crack starts late; the excess falls with the module."
    )
    return Section(rows, _pictures(context, "bending", bending="U over B W phi"), why=why)


def _fig8(context: Context) -> Section:
    summary, scene = context.summary("impact"), context.scene("impact")
    nodes = _scaled(summary, "nodes", 3e-6)
    rows = [
        Row("bars", "million", _scaled(summary, "bars", 1e-6), 2.5, digits=2),
        Row("degrees of freedom", "million", nodes, 1.2, digits=2),
        Row("module edge", "mm", 1e3 * scene.plate.spacing, 0.533),
    ]
    pictures = []
    try:
        from taichi_ldem.output.render.snapshots import render_shot
        from taichi_ldem.output.render.views import Shot

        context.picture("x").parent.mkdir(parents=True, exist_ok=True)
        shot = Shot(view="above")
        folder = RunFolder(context.folder("impact"))
        (_, drawn), *_ = render_shot(folder, shot, context.picture("x").parent, [0.0])
        picture = context.picture("fig8")
        drawn.replace(picture)
        pictures = [(picture, "the plate at rest")]
    except SceneError as error:
        return Section(rows, why=str(error))
    return Section(rows, pictures, why="The same lattice, unless the run is a quick one.")


def _fig9(context: Context) -> Section:
    if importlib.util.find_spec("taichi_ldem.model.disorder") is None:
        raise SceneError("random fields are not in this version")
    from math import gamma

    shape_from_cv = importlib.import_module("taichi_ldem.model.disorder").shape_from_cv
    mean = context.scene("impact").material.fracture_energy or 0.0

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel="G_f [J/m2]", ylabel="density [m2/J]")
        x = np.linspace(1.0, 3 * mean, 600)
        for cv in (0.1, 0.25, 0.5):
            k = float(shape_from_cv(cv))
            scale = mean / gamma(1 + 1 / k)
            density = k / scale * (x / scale) ** (k - 1) * np.exp(-((x / scale) ** k))
            axes.plot(x, density, label=f"CV {100 * cv:g} %: shape {k:.2f}")
        axes.legend()

    picture = _draw(context.picture("fig9"), (8, 5), draw)
    why = "Weibull with mean one; Eqs. (15), (16) have their symbols mixed up, see the theory page."
    return Section([], [(picture, "Distributions of the fracture energy")], why=why)


def _modes(context: Context) -> Section:
    return Section([], _pictures(context, "modes", modes="shapes and frequencies"))


def _table2(context: Context) -> Section:
    summary = context.summary("modes")
    found: dict[str, list[float]] = {}
    for name, frequency in zip(summary["names"], summary["frequencies_hz"], strict=True):
        found.setdefault(name, []).append(frequency)
    rows = []
    for name, (lattice, _) in paper.NATURAL_FREQUENCIES_HZ.items():
        mine = found.get(f"({name[0]}, {name[1]})", [])
        mean = float(np.mean(mine[: 1 if name[0] == 0 else 2])) if mine else None
        computed = None if mean is None else 1e-3 * mean
        rows.append(Row(f"mode {name}", "kHz", computed, 1e-3 * lattice))
    why = (
        "Eq. (2) stiffness, E = 3.35 GPa and clamps of 76 mm here; the paper's column agrees with "
        "its printed EA_d and 3.30 GPa (configs/modes_as_printed.toml)."
    )
    return Section(rows, why=why)


def _fig11(name: str) -> Callable[[Context], Section]:
    def make(context: Context) -> Section:
        summary = context.summary(name)
        history = RunFolder(context.folder(name)).read_history()
        fastest = history["time_s"][history["striker_velocity_m_s"].argmax()]
        rows = [
            Row("P1", "N", summary.get("first_peak_force_n"), paper.P1_N, digits=0),
            Row("t1", "ms", _scaled(summary, "first_peak_time_s", 1e3), 1e3 * paper.T1_S, digits=2),
            Row("P2", "N", summary.get("second_peak_force_n"), None, paper.P2_N, 0),
            Row(
                "t2 (force)",
                "ms",
                _scaled(summary, "failure_time_s", 1e3),
                1e3 * paper.T2_LDEM_S,
                (1e3 * paper.T2_S[0], 1e3 * paper.T2_S[1]),
                2,
            ),
            Row(
                "time of the largest velocity",
                "ms",
                1e3 * float(fastest),
                experiments=(1e3 * paper.V_MAX_S,) * 2,
                digits=2,
            ),
            Row("velocity at the end", "m/s", summary.get("striker_velocity_end_m_s")),
        ]
        scene = context.scene(name)
        bar = 1e-6 * scene.material.youngs_modulus * failure_strain(scene.material)
        strength = 1e-6 * _MEASURED_STRENGTH
        why = f"Bars hold E eps_p = {bar:.1f} MPa where {strength:g} MPa was measured"
        why += ": the plate cracks early." if bar < 0.9 * strength else "."
        if not scene.striker or not scene.striker.gravity:
            why += " Without gravity the striker is never faster than at the start."
        return Section(rows, _pictures(context, name, force="force", velocity="velocity"), why=why)

    return make


def _fig12(name: str) -> Callable[[Context], Section]:
    def make(context: Context) -> Section:
        summary = context.summary(name)
        own, tests = paper.TABLE_3[0.0], paper.EXPERIMENTS

        def ends(values: Sequence[float], factor: float) -> tuple[float, float]:
            return factor * min(values), factor * max(values)

        rows = [
            Row(
                "radial cracks",
                "",
                summary.get("radial_cracks"),
                own.radial_cracks[0],
                ends(tests.radial_cracks, 1.0),
                0,
            ),
            Row(
                "d_r",
                "mm",
                _scaled(summary, "radial_diameter_m", 1e3),
                1e3 * own.radial_diameter[0],
                ends(tests.radial_diameter, 1e3),
                1,
            ),
            Row(
                "d_c",
                "mm",
                _scaled(summary, "circular_diameter_m", 1e3),
                1e3 * own.circular_diameter[0],
                ends(tests.circular_diameter, 1e3),
                1,
            ),
            Row("dissipated by fracture", "J", summary.get("fracture_j")),
            Row("energy error", "%", _scaled(summary, "energy_error", 100.0)),
        ]
        why = "Cracks prefer the lattice's axes and stay short of the experiments', as the paper's."
        names = {"energy": "energies", "cracks": "measured cracks"}
        return Section(rows, _pictures(context, name, **names), why=why)

    return make


def _ensemble(**names: str) -> Callable[[Context], Section]:
    def make(context: Context) -> Section:
        pictures = _pictures(context, "ensemble", **names)
        table = context.folder("ensemble") / "table3.md"
        text = "" if names or not table.is_file() else table.read_text(encoding="utf-8")
        if not pictures and not text:
            raise SceneError("the ensemble has written neither figures nor a table")
        return Section([], pictures, text)

    return make


def _pictures(context: Context, name: str, **captions: str) -> list[tuple[Path, str]]:
    files = [(context.folder(name) / f"{stem}.png", text) for stem, text in captions.items()]
    return [(file, text) for file, text in files if file.is_file()]


ITEMS: tuple[Item, ...] = (
    Item("fig2", "Fig. 2: the bilinear law", ("impact",), _fig2),
    Item("fig6", "Fig. 6: tension", ("tension",), _fig6),
    Item("fig7", "Fig. 7: notched bending", ("bending",), _fig7),
    Item("fig8", "Fig. 8: the model", ("impact",), _fig8),
    Item("fig9", "Fig. 9: distributions of the fracture energy", ("impact",), _fig9),
    Item("table2", "Table 2: natural frequencies", ("modes",), _table2),
    Item("fig10", "Fig. 10: modes", ("modes",), _modes),
    Item("fig11", "Fig. 11: force and velocity, derived defaults", ("impact",), _fig11("impact")),
    Item("fig12", "Fig. 12: energies and cracks, derived defaults", ("impact",), _fig12("impact")),
    Item("fig11m", "Fig. 11, measured strength", ("measured",), _fig11("measured")),
    Item("fig12m", "Fig. 12, measured strength", ("measured",), _fig12("measured")),
    Item(
        "fig13",
        "Fig. 13: force and velocity of random specimens",
        ("ensemble",),
        _ensemble(force_envelope="force", velocity_envelope="velocity"),
    ),
    Item(
        "fig14",
        "Fig. 14: energies of random specimens",
        ("ensemble",),
        _ensemble(energy_envelope="energies"),
    ),
    Item(
        "fig15",
        "Fig. 15: cracks of random specimens at t2 (energy)",
        ("ensemble",),
        _ensemble(cracks_at_t2="at t2 (energy)"),
    ),
    Item(
        "fig16",
        "Fig. 16: cracks of random specimens at the end",
        ("ensemble",),
        _ensemble(cracks_at_end="at the end"),
    ),
    Item("table3", "Table 3: cracks of random specimens", ("ensemble",), _ensemble()),
)


def chosen(only: str | None) -> list[Item]:
    """The items that ``--only`` names; SceneError for a name that is none."""
    if only is None:
        return list(ITEMS)
    wanted = [name.strip() for name in only.split(",") if name.strip()]
    known = {item.key: item for item in ITEMS}
    for name in wanted:
        if name not in known:
            raise SceneError(f"--only {name}: must be one of {', '.join(known)}")
    return [item for item in ITEMS if item.key in wanted]


def reproduce(
    out: Path,
    *,
    quick: bool = False,
    resume: bool = False,
    only: str | None = None,
    tell: Callable[[str], None] = print,
) -> int:
    """Run what the items need and write ``paper.md`` with pictures into a folder.

    Returns:
        0; 5 where a run did not end as it should.

    Raises:
        SceneError: not a checkout, a folder that was begun without ``resume``, or a bad ``only``.
    """
    items = chosen(only)
    if not Path("configs/impact.toml").is_file():
        raise SceneError("ldem paper: run it in a checkout: there is no configs/impact.toml here")
    state = out / "paper.json"
    kind = {"quick": quick}
    if state.is_file():
        if not resume:
            raise SceneError(f"'{out}' holds results; --resume goes on, --out takes another folder")
        if json.loads(state.read_text(encoding="utf-8")) != kind:
            raise SceneError(f"'{out}' was begun {'without' if quick else 'with'} --quick")
    out.mkdir(parents=True, exist_ok=True)
    write_whole(state, (json.dumps(kind) + "\n").encode())
    names = dict.fromkeys(name for item in items for name in item.needs)
    failed = conduct(list(names), out, quick=quick, resume=resume, tell=tell)
    write_whole(out / "paper.md", write(items, Context(out), failed, quick).encode())
    tell(str(out / "paper.md"))
    missing = [name for name in failed if available(NEEDS[name])]
    return UNFINISHED if missing else 0


def write(
    items: Sequence[Item], context: Context, failed: Mapping[str, str], quick: bool = False
) -> str:
    """The report, Markdown, from what lies in the run folders; pictures are copied beside it."""
    command = "ldem paper --quick" if quick else "ldem paper"
    parts = [
        "# The paper, recomputed\n\n"
        f"Made by `{command}`. Every number in the columns *computed* comes from a run folder "
        "below `runs/`. The paper gives no digital curves: its and the experiments' values are "
        "those of its text and tables.\n"
    ]
    if quick:
        parts.append(
            "\nQuick: five modules through the thickness, f32 and 0.8 of the critical step for "
            "the homogeneous specimen, half the specimen with three modules and two seeds for the "
            "random ones, coarser lattices elsewhere. "
            "For a first look, not for comparison.\n"
        )
    for item in items:
        parts.append(f"\n## {item.title}\n\n")
        reason = next((failed[name] for name in item.needs if name in failed), None)
        try:
            if reason is not None:
                raise SceneError(reason)
            parts.append(_section(item, item.make(context), context))
        except (SceneError, OSError, KeyError, StopIteration) as error:
            parts.append(f"Missing: {error or 'a file of the run is not there'}.\n")
    parts.append(_costs(context))
    return "".join(parts)


def _section(item: Item, section: Section, context: Context) -> str:
    parts = []
    if section.rows:
        head = ("quantity", "computed", "paper", "experiments", "difference")
        parts.append(f"| {' | '.join(head)} |\n{'|---' * len(head)}|\n")
        parts += [f"| {' | '.join(row.cells())} |\n" for row in section.rows]
        parts.append("\n")
    if section.markdown:
        parts.append(section.markdown.rstrip() + "\n\n")
    for number, (file, caption) in enumerate(section.pictures):
        copy = context.picture(f"{item.key}_{number}" if len(section.pictures) > 1 else item.key)
        copy.parent.mkdir(parents=True, exist_ok=True)
        if file != copy:
            shutil.copyfile(file, copy)
        parts.append(f"![{item.title}: {caption}](images/{copy.name})\n")
    if section.why:
        parts.append(f"\n{section.why}\n")
    return "".join(parts)


def _costs(context: Context) -> str:
    rows = []
    for name in NEEDS:
        file = context.folder(name) / "summary.json"
        if not file.is_file():
            continue
        told = json.loads(file.read_text(encoding="utf-8"))
        wall, sha = told.get("wall_s"), told.get("provenance", {}).get("scene_sha256", "")
        spent = "" if wall is None else f"{wall:.0f}"
        rows.append(f"| {name} | {spent} | `{sha[:12]}` |\n")
    if not rows:
        return ""
    return "\n## Cost\n\n| run | stepping [s] | scene |\n|---|---|---|\n" + "".join(rows)
