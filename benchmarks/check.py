"""Has the step become slower, measured against the C baseline in the same run?

Speeds of one machine drift by a factor of two within minutes; the ratio of two programs that take
turns does not.
"""

TOLERANCE = 0.15
"""Share of a stored ratio whose loss is an error."""


def worse(
    measured: dict[str, float], stored: dict[str, float], tolerance: float = TOLERANCE
) -> list[str]:
    """One phrase for each ratio that has fallen by the tolerance below what is stored."""
    return [
        f"ldem {name} / C {name} is {measured[name]:.2f}, "
        f"{100 * (1 - measured[name] / ratio):.0f} % below the {ratio:.2f} stored"
        for name, ratio in stored.items()
        if name in measured and measured[name] <= (1 - tolerance) * ratio
    ]


def verdict(
    measured: dict[str, float], baseline: dict[str, dict[str, float]], model: str
) -> tuple[str, int]:
    """A line about the measured ratios, and the exit code: 1 where one has fallen."""
    shown = ", ".join(f"{name} {ratio:.2f}" for name, ratio in measured.items())
    if model not in baseline:
        return f"no ratios stored for {model}: measured {shown}; store them with --store", 0
    found = worse(measured, baseline[model])
    if found:
        return "slower: " + "; ".join(found), 1
    return f"as fast as stored: {shown}", 0
