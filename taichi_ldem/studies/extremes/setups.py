"""Initial states of the cases and changes of their lattice; each function returns a set-up."""

import math
from collections.abc import Callable

import numpy as np

from taichi_ldem.model.lattice import Lattice
from taichi_ldem.studies.extremes.bench import Bench
from taichi_ldem.studies.extremes.scenes import SPACING

SetUp = Callable[[Bench], None]


def shaken(speed: float = 1e-3) -> SetUp:
    """Noise in every node's velocity, m/s."""
    return lambda bench: bench.shake(speed)


def swelling(strain: float, noise: float = 1e-3) -> SetUp:
    """All bars at a strain, with noise in the velocities."""
    return lambda b: b.start(strain * b.places, b.noise(noise))


def cut_to(mask: Callable[[np.ndarray], None]) -> SetUp:
    """Cut another body from the prism, by the same kernels, and shake it."""

    def set_up(bench: Bench) -> None:
        modules = np.zeros_like(bench.whole.mask)
        mask(modules)
        bench.simulation.reset(bench.scene, Lattice(modules, bench.whole.spacing))
        bench.simulation.time_step = 0.9 * bench.simulation.critical_time_step
        bench.simulation.steps, bench.simulation.sample_every = 2000, 100
        bench.shake(1e-3)

    return set_up


def one_module(modules: np.ndarray) -> None:
    """A module alone."""
    modules[1, 2, 4] = True


def one_layer(modules: np.ndarray) -> None:
    """A plate of one module in thickness."""
    modules[1] = True


def hinge(modules: np.ndarray) -> None:
    """Two modules that share an edge."""
    modules[1, 2, 4] = modules[1, 3, 5] = True


def spinning(turns: float, share: float) -> SetUp:
    """Turn about z so that the strain in the middle is a share of the peak strain."""

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


def tearing(speed: float) -> SetUp:
    """Swell so that the ends move apart at a speed (m/s) each."""
    return lambda b: b.start(velocity=speed * b.places / np.abs(b.places[..., 0]).max())


def all_broken(speed: float) -> SetUp:
    """Break every bar; without a striker, shake the loose nodes."""

    def set_up(bench: Bench) -> None:
        dynamics = bench.simulation.dynamics
        broken = np.where(bench.exists[0], 1e3, 0.0)
        dynamics.set_peak(np.broadcast_to(broken, (*dynamics.sites, 14)).copy())
        if bench.simulation.body("striker") is None:
            bench.shake(speed)
            bench.kept["momentum"] = bench.momentum()

    return set_up


def striker_at(displacement: float = 0.0, x: float = 0.0) -> SetUp:
    """Put the striker at a place that no scene allows."""

    def set_up(bench: Bench) -> None:
        from taichi_ldem.solver.contact.kernels.striker import AXIS_X

        body = bench.simulation.body("striker")
        assert body is not None
        body.start(bench.scene, bench.simulation.time_step, displacement)
        numbers = body.numbers.to_numpy()
        numbers[AXIS_X] = x
        body.numbers.from_numpy(numbers)

    return set_up


def contrast(quantity: str, factor: float) -> SetUp:
    """Make every second module's bars stiffer, or its nodes heavier, by the site's code."""

    def set_up(bench: Bench) -> None:
        from taichi_ldem.solver.stability import critical_time_step

        s = bench.simulation
        d = s.dynamics
        # codes distinguish faces and edges of the body from its inside: neighbours differ
        inside = np.array([code.bit_count() == 8 for code in range(256)])
        if quantity == "stiffness":
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


def far_away(distance: float, elongation: float) -> SetUp:
    """Vibrate with a small elongation, far from the place at rest."""

    def set_up(bench: Bench) -> None:
        place = bench.places
        span = np.abs(place[..., 0]).max()
        wave = np.sin(0.5 * math.pi * place[..., :1] / span) * np.array([1.0, 0.0, 0.0])
        bench.start(distance + elongation * wave / (0.5 * math.pi) * span / SPACING)
        bench.kept["momentum"] = bench.momentum()

    return set_up


def flying(speed: float) -> SetUp:
    """A translation at a speed, m/s."""

    def set_up(bench: Bench) -> None:
        bench.start(velocity=np.full(3, speed / math.sqrt(3)))
        bench.kept["momentum"] = bench.momentum()

    return set_up


def neighbours(quantity: str, factor: float, speed: float = 0.0) -> SetUp:
    """Make every second bar stiffer or stronger, or every second module heavier, by a factor."""

    def set_up(bench: Bench) -> None:
        from taichi_ldem.solver.stability import critical_time_step

        s = bench.simulation
        d, share = s.dynamics, s.time_step / s.critical_time_step
        even = np.indices((*d.sites, 14)).sum(axis=0) % 2 == 0
        factors = np.where(even, 1.0, factor)
        one = np.ones((*d.sites, 14))
        d.set_modulus(factors if quantity == "E" else one)
        d.set_strength(factors if quantity == "strength" else one)
        module = np.indices(d.lattice.mask.shape).sum(axis=0) % 2 == 0
        density = np.where(module & (quantity == "density"), factor, 1.0)
        d.set_own_density(bench.scene.material.density, density)
        s.critical_time_step = critical_time_step(d)
        s.time_step = share * s.critical_time_step
        if speed:
            tearing(speed)(bench)
        else:
            bench.shake(1e-3)

    return set_up
