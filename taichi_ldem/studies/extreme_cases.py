"""The stiff and extreme cases of ``extremes``, with what theory predicts for each."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from taichi_ldem.model.lattice import Lattice
from taichi_ldem.studies.extreme_bench import (
    REFUSED,
    SPACING,
    STABLE,
    STOPPED,
    Bench,
    Case,
)

ELASTIC = {"youngs_modulus": 3.35e9, "poisson_ratio": 0.25, "density": 1190.0, "damage": False}
BREAKING = {**ELASTIC, "damage": True, "fracture_energy": 1034.0, "failure_strain": 0.0175}
SOUND = 1840.0  # m/s, sqrt(1.2 E / rho) of the above: longitudinal waves


def _plate(nx: int, ny: int, nz: int) -> dict[str, Any]:
    size = [nx * SPACING, ny * SPACING, nz * SPACING]
    return {"size": size, "modules_through_thickness": nz}


def _scene(precision: str = "f64", **tables: Any) -> dict[str, Any]:
    solver = {"duration": 1e-3, "precision": precision, "threads": 1}
    base = {"scenario": "impact", "plate": _plate(10, 6, 3), "material": ELASTIC, "solver": solver}
    return base | tables


STRUCK: dict[str, Any] = {
    "plate": _plate(16, 16, 3),
    "material": BREAKING,
    "striker": {"diameter": 2e-3, "mass": 1e-3, "velocity": 6.0},
    "clamp": {"kind": "rings", "inner_diameter": 5.2e-3, "outer_diameter": 7.6e-3},
}
DAMPED = {"duration": 1e-3, "threads": 1, "damping": 1e3}

GROUPS = {
    "free": _scene(),
    "free-f32": _scene("f32"),
    "breaking": _scene(material=BREAKING),
    "damped": _scene(solver=DAMPED),
    "disordered": _scene(
        material=BREAKING,
        disorder={
            "fracture_energy_cv": 0.25,
            "youngs_modulus_cv": 0.25,
            "density_cv": 0.25,
            "seed": 1,
        },
    ),
    "struck": _scene(**STRUCK),
    "struck-f32": _scene("f32", **STRUCK),
}
"""Scenes of the groups: free blocks of 10 x 6 x 3 modules, and a plate held by rings and struck."""

COMMAND = _scene(**STRUCK)
"""Scene of the cases that run as a user runs them: ``ldem impact SCENE.toml``."""


# -- what cases do


def _shaken(speed: float = 1e-3) -> Callable[[Bench], None]:
    return lambda bench: bench.shake(speed)


def _swelling(strain: float, noise: float = 1e-3) -> Callable[[Bench], None]:
    """All bars at a strain, with noise in the velocities."""
    return lambda b: b.start(strain * b.places, b.noise(noise))


def _body(mask: Callable[[np.ndarray], None]) -> Callable[[Bench], None]:
    """Cut another body from the prism, by the same kernels, and shake it."""

    def set_up(bench: Bench) -> None:
        modules = np.zeros_like(bench.whole.mask)
        mask(modules)
        bench.simulation.reset(bench.scene, Lattice(modules, bench.whole.spacing))
        bench.simulation.time_step = 0.9 * bench.simulation.critical_time_step
        bench.simulation.steps, bench.simulation.sample_every = 2000, 100
        bench.shake(1e-3)

    return set_up


def _one(modules: np.ndarray) -> None:
    modules[1, 2, 4] = True


def _sheet(modules: np.ndarray) -> None:
    modules[1] = True


def _hinge(modules: np.ndarray) -> None:
    modules[1, 2, 4] = modules[1, 3, 5] = True  # they share an edge


def _spinning(turns: float, share: float) -> Callable[[Bench], None]:
    """Turn about z so that the middle is stretched by a share of what it would take to break."""

    def set_up(bench: Bench) -> None:
        s = bench.simulation
        half = np.abs(bench.places[..., 0]).max()
        # stress in the middle of a spinning rod: rho w^2 a^2 / 2
        rate = math.sqrt(2 * share * 0.0175 * 3.35e9 / 1190.0) / half
        bench.start(velocity=rate * np.cross([0.0, 0.0, 1.0], bench.places))
        s.steps = round(turns * 2 * math.pi / rate / s.time_step)
        s.sample_every = max(1, s.steps // 50)
        bench.kept["momentum"] = bench.momentum()

    return set_up


def _conserves(size: float) -> Callable[[Bench], str]:
    """Momentum and angular momentum are kept, to a share of what the body's parts have."""

    def check(bench: Bench) -> str:
        before, after = bench.kept["momentum"], bench.momentum()
        velocity = bench.masses * np.linalg.norm(
            bench.simulation.dynamics.get_velocity(), axis=-1, keepdims=True
        )
        way = np.linalg.norm(bench.places + bench.simulation.displacement(), axis=-1)[..., None]
        scale = np.array([velocity.sum(), (way * velocity).sum()])[:, None]
        worst = float(np.abs((after - before) / scale).max())
        return "" if worst < size else f"momentum changed by {worst:.1e} of what the parts have"

    return check


def _breaks(least: int) -> Callable[[Bench], str]:
    return lambda b: "" if b.seen.broken >= least else f"only {b.seen.broken} bars broke"


def _both(*checks: Callable[[Bench], str]) -> Callable[[Bench], str]:
    return lambda bench: "; ".join(filter(None, (check(bench) for check in checks)))


def _tearing(speed: float) -> Callable[[Bench], None]:
    """Swell so that the ends move apart at a speed (m/s) each."""
    return lambda b: b.start(velocity=speed * b.places / np.abs(b.places[..., 0]).max())


def _all_broken(speed: float) -> Callable[[Bench], None]:
    def set_up(bench: Bench) -> None:
        dynamics = bench.simulation.dynamics
        broken = np.where(bench.exists[0], 1e3, 0.0)
        dynamics.set_peak(np.broadcast_to(broken, (*dynamics.sites, 14)).copy())
        if bench.simulation.body("striker") is None:
            bench.shake(speed)
            bench.kept["momentum"] = bench.momentum()

    return set_up


def _moves_on(share: float) -> Callable[[Bench], str]:
    """The striker keeps at least this share of its velocity."""

    def check(bench: Bench) -> str:
        body, scene = bench.simulation.body("striker"), bench.scene.striker
        assert body is not None
        assert scene is not None
        now = body.motion()[2] / scene.velocity
        return "" if share <= now <= 1 + 1e-9 else f"striker at {now:.6g} of its velocity"

    return check


def _striker(displacement: float = 0.0, x: float = 0.0) -> Callable[[Bench], None]:
    """Put the striker where no scene puts it."""

    def set_up(bench: Bench) -> None:
        from taichi_ldem.solver.contact.kernels.striker import AXIS_X

        body = bench.simulation.body("striker")
        assert body is not None
        body.start(bench.scene, bench.simulation.time_step, displacement)
        numbers = body.numbers.to_numpy()
        numbers[AXIS_X] = x
        body.numbers.from_numpy(numbers)

    return set_up


def _contrast(what: str, factor: float) -> Callable[[Bench], None]:
    """Make every second module's bars stiffer, or its nodes heavier; by the site's byte."""

    def set_up(bench: Bench) -> None:
        from taichi_ldem.solver.stability import critical_time_step

        s = bench.simulation
        d = s.dynamics
        # the bytes tell faces and edges of the body from its inside: neighbours differ
        inside = np.array([code.bit_count() == 8 for code in range(256)])
        if what == "stiffness":
            table = d.stiffness.to_numpy()
            table[inside] *= factor
            d.stiffness.from_numpy(table)
        else:
            mass = d.mass.to_numpy()
            mass[inside] *= factor
            d.mass.from_numpy(mass)
            d.inverse_mass.from_numpy(
                np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0).astype(mass.dtype)
            )
        s.critical_time_step = critical_time_step(d)
        s.time_step = bench.kept.get("share", 0.99) * s.critical_time_step
        bench.shake(1e-3)

    return set_up


def _far(distance: float, elongation: float) -> Callable[[Bench], None]:
    """Ring with a small elongation, far from where the body was at rest."""

    def set_up(bench: Bench) -> None:
        place = bench.places
        span = np.abs(place[..., 0]).max()
        wave = np.sin(0.5 * math.pi * place[..., :1] / span) * np.array([1.0, 0.0, 0.0])
        bench.start(distance + elongation * wave / (0.5 * math.pi) * span / SPACING)
        bench.kept["momentum"] = bench.momentum()

    return set_up


def _flying(speed: float) -> Callable[[Bench], None]:
    def set_up(bench: Bench) -> None:
        bench.start(velocity=np.full(3, speed / math.sqrt(3)))
        bench.kept["momentum"] = bench.momentum()

    return set_up


def _unmoved(bench: Bench) -> str:
    moved = float(np.abs(bench.simulation.displacement()).max())
    return "" if moved == 0.0 else f"moved by {moved:.1e} m"


STEP = "time step .* above the critical"
LINEAR = "central differences: stable below 2 / omega_max, growing by 1.3 a step at 1.01"


def _bracket(name: str, changes: dict[str, Any], because: str, **more: Any) -> list[Case]:
    """Stable at 0.99 and not at 1.05 of the estimated step: the estimate brackets the limit."""
    group = more.pop("group", "free")
    below = Case(
        f"{name}, 0.99", group, STABLE, because, changes, set_up=_shaken(), share=0.99, **more
    )
    above = Case(
        f"{name}, 1.05",
        group,
        STOPPED,
        because,
        changes,
        says=STEP,
        set_up=_shaken(),
        share=1.05,
        **more,
    )
    return [below, above]


def _steps() -> list[Case]:
    cases = []
    for share in (0.5, 0.9, 0.99, 1.01, 1.1, 2.0):
        stable = share < 1
        cases.append(
            Case(
                f"time step {share}",
                "free",
                STABLE if stable else STOPPED,
                LINEAR,
                says="" if stable else STEP,
                set_up=_shaken(),
                share=share,
                drift=1e-6,
                quick=True,
            )
        )
    return cases


def _materials() -> list[Case]:
    cases = [
        Case(
            "E = 1 kPa",
            "free",
            STABLE,
            "only the step scales with E",
            {"material.youngs_modulus": 1e3},
            set_up=_shaken(1e-7),
            share=0.99,
            quick=True,
        ),
        Case(
            "E = 1 TPa",
            "free",
            STABLE,
            "only the step scales with E",
            {"material.youngs_modulus": 1e12},
            set_up=_shaken(),
            share=0.99,
            quick=True,
        ),
        Case(
            "E = 1 TPa in f32",
            "free-f32",
            STABLE,
            "within the range of f32",
            {"material.youngs_modulus": 1e12},
            set_up=_shaken(),
            share=0.99,
        ),
        Case(
            "E = 1 kPa in f32",
            "free-f32",
            STABLE,
            "within the range of f32",
            {"material.youngs_modulus": 1e3},
            set_up=_shaken(1e-7),
            share=0.99,
        ),
    ]
    for density in (1.0, 2.2e4):
        cases.append(
            Case(
                f"density {density:g}",
                "free",
                STABLE,
                "only the step scales with density",
                {"material.density": density},
                set_up=_shaken(),
                share=0.99,
            )
        )
    for nu in (0.1, 0.4, 0.49, 0.4999):
        cases += _bracket(
            f"nu = {nu}", {"material.poisson_ratio": nu}, "omega_max follows EA_d / EA_l"
        )
    for what in ("stiffness", "density"):
        cases.append(
            Case(
                f"{what} contrast 1e6 between faces and inside",
                "free",
                STABLE,
                "the estimate is of the assembled lattice",
                set_up=_contrast(what, 1e6),
                share=0.99,
            )
        )
    cases += _bracket("f32", {}, LINEAR, group="free-f32")
    return cases


def _bodies() -> list[Case]:
    return [
        Case(
            "a module alone",
            "free",
            STABLE,
            "nine nodes, twenty bars: no mechanism",
            set_up=_body(_one),
            quick=True,
        ),
        Case(
            "a plate one module thick",
            "free",
            STABLE,
            "diagonals stiffen a single layer",
            set_up=_body(_sheet),
        ),
        Case(
            "two modules that share an edge",
            "free",
            STABLE,
            "a hinge moves at no frequency",
            set_up=_body(_hinge),
        ),
        Case(
            "at rest",
            "free",
            STABLE,
            "no force at rest: nothing moves, to the last bit",
            set_up=lambda b: b.start(),
            check=_unmoved,
            quick=True,
        ),
        Case(
            "flying at 300 m/s",
            "free",
            STABLE,
            "a translation strains nothing",
            set_up=_flying(300.0),
            check=_conserves(1e-12),
            drift=1e-9,
        ),
        Case(
            "a million steps",
            "free",
            STABLE,
            "a symplectic scheme does not drift",
            set_up=_shaken(0.1),
            share=0.9,
            steps=1_000_000,
            drift=1e-3,
        ),
        Case(
            "ten turns",
            "free",
            STABLE,
            "strains are exact at any rotation",
            set_up=_spinning(10, 0.1),
            check=_conserves(1e-9),
            share=0.9,
            drift=1e-3,
        ),
        Case(
            "ten turns in f32",
            "free-f32",
            STABLE,
            "strains are exact at any rotation",
            set_up=_spinning(10, 0.1),
            check=_conserves(1e-3),
            share=0.9,
            drift=1e-2,
        ),
        Case(
            "1e5 steps in f32",
            "free-f32",
            STABLE,
            "rounding wanders as a root of the steps",
            set_up=_shaken(1.0),
            share=0.9,
            steps=100_000,
            drift=1e-2,
        ),
        Case(
            "displacement 1e6 times the elongation",
            "free",
            STABLE,
            "f64 resolves elongations to 1e-10",
            set_up=_far(0.01, 1e-8),
            check=_conserves(1e-6),
        ),
        Case(
            "displacement 1e6 times the elongation, f32",
            "free-f32",
            STOPPED,
            "f32 has seven digits: each step rounds nodes by 3 % of their elongation",
            says="use solver.precision",
            set_up=_far(0.01, 1e-8),
        ),
        Case(
            "displacement 1e4 times the elongation, f32",
            "free-f32",
            STABLE,
            "rounding heats by 2e-6 of the energy a step",
            set_up=_far(0.01, 1e-6),
            check=_conserves(1e-3),
        ),
    ]


def _deformed() -> list[Case]:
    sure = "at any deformation omega^2 <= 3 omega_max^2 at rest: 0.57 of the step is enough"
    turns = "a bar that passes through zero length turns round within a step, however short"

    def crossing(name: str, set_up: Callable[[Bench], None]) -> Case:
        return Case(name, "free", STOPPED, turns, says="of their length", set_up=set_up)

    return [
        Case(
            "stretched by a twentieth and let go, 0.5",
            "free",
            STABLE,
            sure,
            set_up=_swelling(0.05),
            drift=0.05,
        ),
        Case(
            "stretched by a twentieth and let go, 0.98",
            "free",
            STOPPED,
            "tension e adds up to e / (1 + e) of a bar's stiffness across it: 0.96 of the step",
            says="stretched bars lower the critical",
            set_up=_swelling(0.05),
            share=0.98,
        ),
        Case(
            "spun to bars of 1.4 of their length",
            "free",
            STABLE,
            sure,
            set_up=_spinning(2, 15.0),
            check=_conserves(1e-9),
        ),
        crossing("stretched by half and let go", _swelling(0.5)),
        crossing("stretched fivefold and let go", _swelling(4.0)),
        crossing("squeezed to 0.4 of its size", _swelling(-0.6)),
        crossing("squeezed to 0.01 of its size", _swelling(-0.99)),
        crossing("nodes cross: noise of half the speed of sound", _shaken(0.5 * SOUND)),
        Case(
            "turned inside out",
            "free",
            STABLE,
            "the mirrored body is at rest, too",
            set_up=lambda b: b.start(-2 * b.places, b.noise(1e-3)),
        ),
    ]


def _fracture() -> list[Case]:
    law = {"material.failure_strain": 0.0175}
    return [
        Case(
            "a turn while cracking",
            "breaking",
            STABLE,
            "central forces keep angular momentum",
            set_up=_spinning(10, 1.5),
            check=_both(_conserves(1e-9), _breaks(1)),
            drift=0.05,
        ),
        Case(
            "every bar broken at once",
            "breaking",
            STABLE,
            "no forces: free flight of every node",
            set_up=_all_broken(10.0),
            check=_conserves(1e-12),
            drift=1e-9,
        ),
        Case(
            "K_r = 1.0001",
            "breaking",
            STABLE,
            "the law's jump costs energy of first order in the strain of a step",
            law | {"material.limit_strain": 0.0175 * 1.0001},
            set_up=_tearing(40.0),
            check=_breaks(10),
            drift=0.05,
        ),
        Case(
            "K_r = 50",
            "breaking",
            STABLE,
            "a soft tail: second order",
            law | {"material.limit_strain": 0.0175 * 50},
            set_up=_tearing(100.0),
            drift=0.01,
        ),
        Case(
            "eps_p = 1e-7",
            "breaking",
            STABLE,
            "the estimate of the step must not break bars",
            {"material.failure_strain": 1e-7, "material.limit_strain": 1e-6},
            set_up=lambda b: b.start(),
            check=lambda b: (
                ""
                if b.seen.broken == 0 and not b.simulation.dynamics.touched.to_numpy().any()
                else "bars were damaged at rest"
            ),
        ),
        Case(
            "torn apart at 300 m/s",
            "breaking",
            STABLE,
            "every bar fails within a few steps",
            set_up=_tearing(300.0),
            check=_breaks(100),
            drift=0.05,
        ),
    ]


def _neighbours(what: str, factor: float, speed: float = 0.0) -> Callable[[Bench], None]:
    """Make every second bar stiffer or stronger, or every second module heavier, by a factor."""

    def set_up(bench: Bench) -> None:
        from taichi_ldem.solver.stability import critical_time_step

        s, share = (
            bench.simulation,
            bench.simulation.time_step / bench.simulation.critical_time_step,
        )
        d = s.dynamics
        even = np.indices((*d.sites, 14)).sum(axis=0) % 2 == 0
        contrast = np.where(even, 1.0, factor)
        one = np.ones((*d.sites, 14))
        d.set_modulus(contrast if what == "E" else one)
        d.set_strength(contrast if what == "strength" else one)
        module = np.indices(d.lattice.mask.shape).sum(axis=0) % 2 == 0
        density = np.where(module & (what == "density"), factor, 1.0)
        d.set_own_density(bench.scene.material.density, density)
        s.critical_time_step = critical_time_step(d)
        s.time_step = share * s.critical_time_step
        if speed:
            _tearing(speed)(bench)
        else:
            bench.shake(1e-3)

    return set_up


def _disorder() -> list[Case]:
    cvs = ("fracture_energy_cv", "youngs_modulus_cv", "density_cv")
    wide = {f"disorder.{name}": 1.5 for name in cvs}
    assembled = "the estimate is of the assembled lattice, bar by bar"
    cases = [
        Case(
            "disorder of CV 1.5 in G_f, E and density",
            "disordered",
            STABLE,
            assembled,
            wide,
            set_up=_tearing(40.0),
            check=_breaks(10),
            drift=0.05,
        ),
        Case(
            "disorder of CV 1.5 at 0.99 of the step",
            "disordered",
            STABLE,
            assembled,
            wide,
            set_up=_shaken(1e-5),
            share=0.99,
        ),
        Case(
            "disorder of CV 1.5 at 1.05 of the step",
            "disordered",
            STOPPED,
            assembled,
            wide,
            set_up=_shaken(1e-5),
            share=1.05,
            says=STEP,
        ),
        Case(
            "strengths of neighbouring bars 1e6 apart",
            "disordered",
            STABLE,
            "bars that cannot break hold their neighbours' ends",
            set_up=_neighbours("strength", 1e6, 40.0),
            check=_breaks(10),
            drift=0.05,
        ),
    ]
    for what, name in (("E", "E of neighbouring bars"), ("density", "density of neighbours")):
        for share in (0.99, 1.05):
            stable = share < 1
            cases.append(
                Case(
                    f"{name} 1e6 apart, {share}",
                    "disordered",
                    STABLE if stable else STOPPED,
                    assembled,
                    set_up=_neighbours(what, 1e6),
                    share=share,
                    says="" if stable else STEP,
                )
            )
    return cases


def _damping() -> list[Case]:
    implicit = "implicit and diagonal: stable for any damping"

    def case(name: str, alpha: float) -> Case:
        return Case(
            f"damping {name}",
            "damped",
            STABLE,
            implicit,
            {"solver.damping": alpha},
            set_up=_shaken(),
            share=0.99,
            drift=1e-6,
        )

    return [
        case("zero", 1e-20),
        case("critical of the lowest mode", 2.5e6),
        case("critical of the highest mode", 5e7),
        case("a hundred times beyond", 5e9),
    ]


def _strikers(group: str = "struck") -> list[Case]:
    hard = "kinematic contact, implicit in the striker's velocity: no stiffness, no limit"
    mass, speed = "striker.mass", "striker.velocity"

    def case(name: str, changes: dict[str, Any], **more: Any) -> Case:
        return Case(name, group, STABLE, hard, changes, **({"drift": 0.05, "steps": 1000} | more))

    f32 = " in f32" if group.endswith("f32") else ""
    cases = [
        case(f"striker 1 g at 6 m/s{f32}", {}, check=_breaks(20), steps=1500),
        case(f"striker 1 mg{f32}", {mass: 1e-6}),
        case(f"striker 100 t{f32}", {mass: 1e5}, check=_moves_on(0.999)),
        case(
            f"striker 100 t at 300 m/s{f32}",
            {mass: 1e5, speed: 300.0},
            drift=0.3,
            check=_both(_moves_on(0.999), _breaks(100)),
        ),
    ]
    if f32:
        return cases
    return [
        *cases,
        case("striker at 1 mm/s", {speed: 1e-3}),
        case("striker 1 g at 300 m/s", {speed: 300.0}, drift=0.3, check=_breaks(100)),
        case("striker 1 mg at 300 m/s", {mass: 1e-6, speed: 300.0}, drift=0.3),
        case("gravity a million times the Earth's", {"striker.gravity": 1e7, speed: 0.0}),
        case("contact on one node", {"striker.diameter": 4e-4}),
        Case(
            "a needle of a fifth of a module",
            "struck",
            STOPPED,
            "nodes let go by bars move by a tenth of its radius a step: too sharp a curve",
            {"striker.diameter": 1e-4},
            says="so sharp",
            steps=1000,
        ),
        case("a striker that never arrives", {"striker.gap": 1.0}, check=_moves_on(1 - 1e-12)),
        Case(
            "a striker beside the plate",
            "struck",
            STABLE,
            "nothing there to touch",
            set_up=_striker(x=0.1),
            check=_moves_on(1 - 1e-12),
            steps=1000,
        ),
        Case(
            "a striker inside the plate",
            "struck",
            STABLE,
            "what it finds inside is kept from getting deeper: nothing is given",
            set_up=_striker(displacement=SPACING),
            steps=1000,
        ),
        Case(
            "every bar broken under the striker",
            "struck",
            STABLE,
            "loose nodes are pushed aside, one by one",
            set_up=_all_broken(0.0),
            drift=0.05,
            steps=1000,
            check=_moves_on(0.5),
        ),
        Case("struck at 1.1 of the step", "struck", STOPPED, LINEAR, says=STEP, share=1.1),
        Case(
            "100 t at 1.02 of the step",
            "struck",
            STOPPED,
            "the striker's energy must not hide the plate's",
            {mass: 1e5},
            says=STEP,
            share=1.02,
        ),
    ]


def _commands() -> list[Case]:
    def refused(name: str, because: str, says: str, changes: dict[str, Any]) -> Case:
        return Case(name, "commands", REFUSED, because, changes, says=says)

    return [
        refused(
            "nu = 0",
            "no diagonal stiffness: a mechanism",
            "mechanism",
            {"material.poisson_ratio": 0.0},
        ),
        refused(
            "nu = 0.5",
            "incompressible: infinite EA_d",
            "poisson_ratio.*0.5",
            {"material.poisson_ratio": 0.5},
        ),
        refused(
            "E = 0",
            "no stiffness",
            "youngs_modulus.*greater than 0",
            {"material.youngs_modulus": 0.0},
        ),
        refused(
            "K_r < 1",
            "Eq. (12): a bar cannot dissipate G_f A_f",
            "K_r",
            {"material.fracture_energy": 100.0},
        ),
        refused(
            "a striker that starts inside, as a scene",
            "gap >= 0",
            "striker.gap",
            {"striker.gap": -1e-3},
        ),
        refused(
            "a striker that misses, as a scene",
            "must be over the plate",
            "over the plate",
            {"striker.position": [0.1, 0.0]},
        ),
        refused(
            "a clamp that holds nothing",
            "no node between the circles",
            "holds no node",
            {"clamp.inner_diameter": 7.59e-3, "clamp.outer_diameter": 7.592e-3},
        ),
        refused(
            "time step above the critical one", "unstable", "critical", {"solver.time_step": 5e-7}
        ),
        Case(
            "the same, allowed",
            "commands",
            STOPPED,
            LINEAR,
            {"solver.time_step": 5e-7, "solver.allow_unstable": True},
            says=STEP,
        ),
    ]


CASES: tuple[Case, ...] = (
    *_steps(),
    *_materials(),
    *_bodies(),
    *_deformed(),
    *_fracture(),
    *_disorder(),
    *_damping(),
    *_strikers(),
    *_strikers("struck-f32"),
    *_commands(),
)
