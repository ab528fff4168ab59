"""Tables and the figure of a benchmark."""

import csv
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

COLUMNS = {
    "bars": "{:,}",
    "precision": "{}",
    "threads": "{}",
    "mbar_s": "{:.0f}",
    "ms": "{:.3f}",
    "ns_per_bar": "{:.2f}",
    "step_mb": "{:.2f}",
    "gb_s": "{:.1f}",
    "copy_share": "{:.2f}",
    "bytes_per_bar": "{:.0f}",
}
HEADS = {
    "mbar_s": "Mbar/s",
    "ms": "ms/step",
    "ns_per_bar": "ns/bar",
    "step_mb": "MB moved/step",
    "gb_s": "GB/s",
    "copy_share": "of a copy",
    "bytes_per_bar": "fields, bytes/bar",
}

Row = dict[str, Any]


def size_row(
    runs: Sequence[Mapping[str, Any]], precision: str, threads: int, copy_gb_s: float | None
) -> Row:
    """One line of the table of sizes from the rounds of one size; times are medians."""
    ms, bars = median(r["ms"] for r in runs), runs[0]["bars"]
    moved = runs[0]["step_bytes"]
    gb_s = moved / ms / 1e6
    return {
        "bars": bars,
        "precision": precision,
        "threads": threads,
        "mbar_s": bars / ms / 1e3,
        "ms": ms,
        "ns_per_bar": 1e6 * ms / bars,
        "step_mb": moved / 1e6,
        "gb_s": gb_s,
        "copy_share": gb_s / copy_gb_s if copy_gb_s else None,
        "bytes_per_bar": runs[0]["field_bytes"] / bars,
    }


def table(rows: Sequence[Row], columns: Mapping[str, str]) -> str:
    """A Markdown table; a value that is None is left blank."""
    lines = ["| " + " | ".join(HEADS.get(name, name) for name in columns) + " |"]
    lines.append("|---" * len(columns) + "|")
    for row in rows:
        cells = ["" if row[c] is None else form.format(row[c]) for c, form in columns.items()]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def peers_table(rates: Mapping[str, Sequence[float]]) -> str:
    """Medians of every contestant, and the ratios of medians."""
    rows = [
        {"contestant": name, "mbar_s": median(v), "least": min(v), "most": max(v)}
        for name, v in rates.items()
    ]
    text = table(
        rows, {"contestant": "{}", "mbar_s": "{:.0f}", "least": "{:.0f}", "most": "{:.0f}"}
    )
    rounds = min(map(len, rates.values()))
    spread = [ratios({name: [v[n]] for name, v in rates.items()}) for n in range(rounds)]
    for name, ratio in ratios(rates).items():
        own = [one[name] for one in spread]
        text += f"\n- {name}: {ratio:.2f} (single rounds {min(own):.2f} to {max(own):.2f})"
    return text + "\n"


def ratios(
    rates: Mapping[str, Sequence[float]], middle: Callable[[Sequence[float]], float] = median
) -> dict[str, float]:
    """Ratio of ldem to each peer; the C baseline's is that of the same precision.

    Args:
        middle: what stands for the rounds of a contestant.
    """
    return {
        f"{name} / {peer}": middle(rates[name]) / middle(rates[peer])
        for name in rates
        if name.startswith("ldem")
        for peer in rates
        if peer.startswith("LAMMPS") or (peer.startswith("C") and peer[-3:] == name[-3:])
    }


def merged(path: Path, rows: Sequence[Row]) -> list[Row]:
    """Rows measured now, and before them those of a CSV file that were not measured again."""
    kept: dict[tuple, Row] = {}
    if path.exists():
        with path.open(newline="") as file:
            for old in csv.DictReader(file):
                row = {c: _value(c, old[c]) for c in COLUMNS}
                kept[_case(row)] = row
    kept |= {_case(row): row for row in rows}
    return [kept[case] for case in sorted(kept)]


def _case(row: Row) -> tuple:
    return row["bars"], row["precision"], row["threads"]


def _value(column: str, text: str) -> Any:
    if column == "precision":
        return text
    if not text:
        return None
    return int(text) if column in ("bars", "threads") else float(text)


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)


def figure(path: Path, rows: Sequence[Row], machine: str) -> None:
    """Cost of a bar against the number of bars, a line for each precision and number of threads."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    drawn, axes = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
    kinds = sorted({(r["precision"], r["threads"]) for r in rows}, reverse=True)
    for precision, threads in kinds:
        chosen = [r for r in rows if (r["precision"], r["threads"]) == (precision, threads)]
        chosen.sort(key=lambda r: r["bars"])
        axes.plot(
            [r["bars"] for r in chosen],
            [r["ns_per_bar"] for r in chosen],
            marker="o" if precision == "f64" else "s",
            linestyle="-" if threads == 1 else "--",
            color="C0" if precision == "f64" else "C1",
            label=f"{precision}, {threads} thread{'s' if threads > 1 else ''}",
        )
    axes.set(xscale="log", xlabel="bars", ylabel="time of a step per bar, ns")
    axes.set_ylim(bottom=0)
    axes.set_title(f"Full step of the impact scene, plates of six modules\n{machine}", fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend()
    drawn.savefig(path, dpi=150)
