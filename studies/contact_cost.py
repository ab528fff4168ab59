"""What contact of pieces costs in a step, from the state of a run that has it.

    ldem impact SCENE.toml --out RUN --set contact.fragments=true
    python -m studies.contact_cost RUN [--steps 256] [--rounds 5]

RUN is a folder whose checkpoint is of a scene with [contact], for example of a run that has ended.
Two simulations start from it, one of them without contact, and take their steps in turn, so that
other programs on the machine slow both down. A run without contact will not do: its pieces lie in
each other, and would burst apart. The table has medians over the rounds: processor time of a step
by all threads, the part of it in which lists are made, and in which the forces are found.
"""

import sys
import time
from argparse import ArgumentParser
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import Scene
from taichi_ldem.solver import backend
from taichi_ldem.storage import checkpoint as cp

if TYPE_CHECKING:
    from taichi_ldem.solver.simulation import Simulation

WARM_UP = 64
"""Steps before the first round, after which lists are those of the state."""

LISTING, PRESSING = "list_anew", "press"


@dataclass
class Clock:
    """Processor time and calls of a method; it stands in for the method.

    Attributes:
        method: what it calls. seconds: of all threads. calls: so far.
    """

    method: Callable[..., Any]
    seconds: float = 0.0
    calls: int = 0

    def __call__(self, *arguments: Any) -> Any:
        """Call the method and add its time."""
        import taichi as ti

        started = time.process_time()
        result = self.method(*arguments)
        ti.sync()
        self.seconds += time.process_time() - started
        self.calls += 1
        return result


@dataclass(frozen=True)
class Round:
    """Milliseconds of a step in a round; steps from one listing to the next."""

    without: float
    touching: float
    listing: float
    pressing: float
    lasts: float


def scenes(saved: Scene, settings: Sequence[str]) -> tuple[Scene, Scene]:
    """The scene of a checkpoint without and with contact.

    Raises:
        SceneError: it has no contact.
    """
    if saved.contact is None:
        raise SceneError(
            "the run's scene has no table [contact], and its pieces may lie in each other: "
            "run it with --set contact.fragments=true"
        )
    scene = saved.changed(*settings) if settings else saved
    return scene.model_copy(update={"contact": None}), scene


def started(scene: Scene, state: Mapping[str, Any]) -> "Simulation":
    """A simulation that goes on from the state of a run with contact."""
    from taichi_ldem.solver.simulation import Simulation

    simulation = Simulation(scene)
    simulation.restore_state({name: state[name] for name in simulation.saved_state()})
    simulation.advance(WARM_UP)
    return simulation


def step_time(simulation: "Simulation", steps: int) -> float:
    """Processor time of a step, ms."""
    import taichi as ti

    ti.sync()
    started = time.process_time()
    simulation.advance(steps)
    ti.sync()
    return 1e3 * (time.process_time() - started) / steps


def measure(without: "Simulation", touching: "Simulation", steps: int, rounds: int) -> list[Round]:
    """Times of both simulations in turn."""
    clocks = {}
    for name in (LISTING, PRESSING):
        clocks[name] = Clock(getattr(touching.fragments, name))
        setattr(touching.fragments, name, clocks[name])
    found = []
    for _ in range(rounds):
        for clock in clocks.values():
            clock.seconds, clock.calls = 0.0, 0
        times = step_time(without, steps), step_time(touching, steps)
        parts = [1e3 * clocks[name].seconds / steps for name in (LISTING, PRESSING)]
        found.append(Round(*times, *parts, steps / max(1, clocks[LISTING].calls)))
    return found


def table(simulation: "Simulation", rounds: Sequence[Round]) -> str:
    """The numbers as Markdown."""
    pieces = simulation.fragments
    pairs = int(pieces.pair_ends[pieces.size - 1]) if pieces.size else 0
    awake = int((pieces.seen.to_numpy()[: pieces.size] == pieces.stamp[0]).sum())
    middle = {name: median(getattr(r, name) for r in rounds) for name in vars(rounds[0])}
    more = median(r.touching / r.without - 1 for r in rounds)
    rows = (
        ("time", f"{1e3 * simulation.time:.3f} ms"),
        ("nodes listed", f"{pieces.size}"),
        ("awake in the last step", f"{awake}"),
        ("dust among them", f"{pieces.dust_size}"),
        ("entries of pairs", f"{pairs}"),
        ("steps between two lists", f"{middle['lasts']:.1f}"),
        ("a step without contact", f"{middle['without']:.2f} ms"),
        ("a step with contact", f"{middle['touching']:.2f} ms ({100 * more:+.0f} %)"),
        ("of it: lists", f"{middle['listing']:.2f} ms"),
        ("of it: forces", f"{middle['pressing']:.2f} ms"),
    )
    return "\n".join(["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows)])


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print the table."""
    parser = ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of a run with [contact]")
    parser.add_argument("--steps", type=int, default=256, help="in a round")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--set", action="append", default=[], dest="settings", metavar="KEY=VALUE")
    options = parser.parse_args(arguments)
    try:
        saved = cp.decode((options.run / cp.LATEST).read_bytes())
        pair = scenes(saved.scene, options.settings)
    except (SceneError, OSError) as error:
        print(f"error: {options.run}: {error}", file=sys.stderr)
        return 2
    backend.start(pair[0].solver)
    without, touching = (started(scene, saved.state) for scene in pair)
    rounds = measure(without, touching, options.steps, options.rounds)
    print(table(touching, rounds))
    return 0


if __name__ == "__main__":
    sys.exit(main())
