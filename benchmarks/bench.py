"""Speed of the full step against its peers and against size: `make bench`.

Every round runs every contestant once, one after the other, each in a process of its own, so that a
machine whose speed drifts treats all alike; medians over the rounds count.

- ldem: the full step of configs/impact.toml (damage, contact, rings, sampling).
- LAMMPS bpm/spring: the same bars as breakable springs, double precision, an MPI process a thread
  (its bonds are elastic with a break criterion: no damage history, no contact).
- C: hand-written, two passes, vectorised by the compiler (peers/lattice_step.c: no contact).
- sizes: square plates of six modules, the scene's rings and striker scaled with them.

Results: outputs/bench/bench.md, sizes.csv; --figure FILE draws the cost of a bar against size.
"""

import argparse
import json
import sys
from pathlib import Path
from statistics import median

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import check  # noqa: E402
import contestants  # noqa: E402
import report  # noqa: E402
from layout import SIZES  # noqa: E402

from taichi_ldem.machine import processor_name  # noqa: E402

BUILD = contestants.ROOT / "outputs/bench"
BASELINE = HERE / "baseline.json"
PRECISIONS = ("f64", "f32")
PAPER, MIDDLE = 174, 60
"""Modules along a side: of the paper's plate, and of the regression check's."""


def take_turns(runs: dict[str, contestants.Rate | None], rounds: int) -> dict[str, list[float]]:
    """Rates of every contestant that is there, round by round."""
    here = {name: run for name, run in runs.items() if run is not None}
    rates: dict[str, list[float]] = {name: [] for name in here}
    for number in range(rounds):
        for name, run in here.items():
            rates[name].append(run())
        shown = "  ".join(f"{name} {values[-1]:.0f}" for name, values in rates.items())
        print(f"round {number + 1}: {shown}", flush=True)
    return rates


def against_c(threads: int, modules: int) -> dict[str, contestants.Rate | None]:
    runs = {f"ldem {p}": contestants.ldem(p, threads, modules) for p in PRECISIONS}
    for p in PRECISIONS:
        runs[f"C two-pass {p}"] = contestants.c_baseline(p, threads, modules, BUILD)
    return runs


def peers(rounds: int, threads: int) -> str:
    runs = against_c(threads, PAPER)
    runs["LAMMPS bpm/spring f64"] = contestants.lammps(threads, PAPER, BUILD)
    text = report.peers_table(take_turns(runs, rounds))
    title = f"{PAPER} x {PAPER} x 6 modules, {threads} threads, {rounds} interleaved rounds"
    return f"## Peers\n\n{title}; Mbar/s.\n\n{text}"


def sizes(
    modules_of: list[int], rounds: int, seconds: float, threads: list[int], picture: Path | None
) -> str:
    """Time every size, precision and number of threads; a copy in every round.

    Sizes in sizes.csv that are not measured now stay in the tables.
    """
    copy = contestants.copy_rate(BUILD)
    cases = [(n, p, t) for n in modules_of for p in PRECISIONS for t in threads]
    runs: dict[tuple, list] = {case: [] for case in cases}
    copies: dict[int, list[float]] = {t: [] for t in threads}
    for number in range(rounds):
        for t in threads:
            if copy is not None:
                copies[t].append(copy(t))
        for modules, precision, t in cases:
            found = contestants.step(precision, t, modules, seconds)
            runs[modules, precision, t].append(found)
            print(
                f"round {number + 1}: {found['bars']:,} bars {precision} {t} threads: "
                f"{found['ms']:.3f} ms/step, {found['mbar_s']:.0f} Mbar/s",
                flush=True,
            )
    reached = {t: median(v) for t, v in copies.items() if v}
    rows = [report.size_row(v, p, t, reached.get(t)) for (_, p, t), v in runs.items()]
    rows = report.merged(BUILD / "sizes.csv", rows)
    report.write_csv(BUILD / "sizes.csv", rows)
    if picture is not None:
        report.figure(picture, rows, processor_name())
    told = ", ".join(f"{rate:.1f} GB/s with {t}" for t, rate in reached.items())
    return (
        f"## Cost against size\n\n{rounds} rounds. A copy of large arrays, write-allocate counted, "
        f"reaches {told} threads.\n\n{report.table(rows, report.COLUMNS)}"
    )


def regression(rounds: int, store: bool) -> int:
    """Compare the ratios to the C baseline with those stored for this processor.

    One thread, the best round of each, a size that stays in cache: both then tell what the
    processor can do whatever else the machine does. With two threads the C baseline waits at three
    barriers a step, and other work on the machine slows it tenfold and ldem by half.
    """
    rates = take_turns(against_c(1, MIDDLE), rounds)
    found = report.ratios(rates, max)
    measured = {
        p: found[name] for p in PRECISIONS for name in found if name.endswith(f"C two-pass {p}")
    }
    if not measured:
        print("nothing to compare with: no C compiler")
        return 1
    stored = json.loads(BASELINE.read_text())
    model = processor_name()
    if store:
        stored[model] = {name: round(ratio, 3) for name, ratio in measured.items()}
        BASELINE.write_text(json.dumps(stored, indent=2) + "\n")
    line, code = check.verdict(measured, stored, model)
    print(line)
    return code


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peers", action="store_true", help="only the peers")
    parser.add_argument("--sizes", action="store_true", help="only the sizes")
    parser.add_argument(
        "--modules", type=int, nargs="+", default=list(SIZES), help="along the sides, for --sizes"
    )
    parser.add_argument("--check", action="store_true", help="compare with baseline.json")
    parser.add_argument("--store", action="store_true", help="with --check: store the ratios")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--seconds", type=float, default=1.0, help="of one timing of a size")
    parser.add_argument("--figure", type=Path, help="PNG of cost against size")
    options = parser.parse_args()
    BUILD.mkdir(parents=True, exist_ok=True)
    if options.check:
        return regression(options.rounds, options.store)
    text = f"# Benchmark\n\n{processor_name()}\n"
    both = options.peers == options.sizes
    if options.peers or both:
        text += "\n" + peers(options.rounds, max(options.threads))
    if options.sizes or both:
        text += "\n" + sizes(
            options.modules, options.rounds, options.seconds, options.threads, options.figure
        )
    (BUILD / "bench.md").write_text(text)
    print(f"\n{text}\nwritten to {BUILD / 'bench.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
