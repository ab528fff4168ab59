"""Sections on modes, falling-weight tests and ensembles: Tables 2, 3 and Figs. 10 to 16."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from taichi_ldem.analysis import paper
from taichi_ldem.errors import SceneError
from taichi_ldem.model.material import failure_strain
from taichi_ldem.reading import read_text
from taichi_ldem.reproduction.sections import Context, Row, Section, pictures, scaled
from taichi_ldem.storage.folder import RunFolder


def modes(context: Context) -> Section:
    """The mode shapes."""
    return Section([], pictures(context, "modes", modes="shapes and frequencies"))


def table2(context: Context) -> Section:
    """Natural frequencies; pairs of modes are averaged."""
    summary = context.summary("modes")
    found: dict[str, list[float]] = {}
    for name, frequency in zip(summary["names"], summary["frequencies_hz"], strict=True):
        found.setdefault(name, []).append(frequency)
    rows = []
    for name, (lattice, _) in paper.NATURAL_FREQUENCIES_HZ.items():
        own = found.get(f"({name[0]}, {name[1]})", [])
        mean = float(np.mean(own[: 1 if name[0] == 0 else 2])) if own else None
        computed = None if mean is None else 1e-3 * mean
        rows.append(Row(f"mode {name}", "kHz", computed, 1e-3 * lattice))
    why = (
        "Eq. (2) stiffness, E = 3.35 GPa and clamps of 76 mm here; the paper's column agrees with "
        "its printed EA_d and 3.30 GPa (configs/modes_as_printed.toml)."
    )
    return Section(rows, why=why)


def fig11(name: str) -> Callable[[Context], Section]:
    """Force and velocity of a run."""

    def make(context: Context) -> Section:
        summary = context.summary(name)
        history = RunFolder(context.folder(name)).read_history()
        fastest = history["time_s"][history["striker_velocity_m_s"].argmax()]
        rows = [
            Row("P1", "N", summary.get("first_peak_force_n"), paper.P1_N, digits=0),
            Row("t1", "ms", scaled(summary, "first_peak_time_s", 1e3), 1e3 * paper.T1_S, digits=2),
            Row("P2", "N", summary.get("second_peak_force_n"), None, paper.P2_N, 0),
            Row(
                "t2 (force)",
                "ms",
                scaled(summary, "failure_time_s", 1e3),
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
        strength = 1e-6 * paper.STRENGTH_PA
        why = f"Bars hold E eps_p = {bar:.1f} MPa where {strength:g} MPa was measured"
        why += ": the plate cracks early." if bar < 0.9 * strength else "."
        if not scene.striker or not scene.striker.gravity:
            why += " Without gravity the striker is never faster than at the start."
        return Section(rows, pictures(context, name, force="force", velocity="velocity"), why=why)

    return make


def _range_of(values: Sequence[float], factor: float = 1.0) -> tuple[float, float]:
    return factor * min(values), factor * max(values)


def fig12(name: str) -> Callable[[Context], Section]:
    """Energies and cracks of a run."""

    def make(context: Context) -> Section:
        summary = context.summary(name)
        model, tests = paper.TABLE_3[0.0], paper.EXPERIMENTS
        rows = [
            Row(
                "radial cracks",
                "",
                summary.get("radial_cracks"),
                model.radial_cracks[0],
                _range_of(tests.radial_cracks),
                0,
            ),
            Row(
                "d_r",
                "mm",
                scaled(summary, "radial_diameter_m", 1e3),
                1e3 * model.radial_diameter[0],
                _range_of(tests.radial_diameter, 1e3),
                1,
            ),
            Row(
                "d_c",
                "mm",
                scaled(summary, "circular_diameter_m", 1e3),
                1e3 * model.circular_diameter[0],
                _range_of(tests.circular_diameter, 1e3),
                1,
            ),
            Row("dissipated by fracture", "J", summary.get("fracture_j")),
            Row("energy error", "%", scaled(summary, "energy_error", 100.0)),
        ]
        why = "Cracks prefer the lattice's axes and stay short of the experiments', as the paper's."
        names = {"energy": "energies", "cracks": "measured cracks"}
        return Section(rows, pictures(context, name, **names), why=why)

    return make


def ensemble(**names: str) -> Callable[[Context], Section]:
    """Figures of the ensemble, with captions by their names; without names, its Table 3."""

    def make(context: Context) -> Section:
        found = pictures(context, "ensemble", **names)
        table = context.folder("ensemble") / "table3.md"
        text = "" if names or not table.exists() else read_text(table)
        if not found and not text:
            raise SceneError("the ensemble has written neither figures nor a table")
        return Section([], found, text)

    return make
