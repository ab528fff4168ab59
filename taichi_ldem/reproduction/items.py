"""The paper's figures and tables that are results, in its order."""

from __future__ import annotations

from taichi_ldem.errors import SceneError
from taichi_ldem.reproduction import impact, material
from taichi_ldem.reproduction.sections import Item

ITEMS: tuple[Item, ...] = (
    Item("fig2", "Fig. 2: the bilinear law", ("impact",), material.fig2),
    Item("fig6", "Fig. 6: tension", ("tension",), material.fig6),
    Item("fig7", "Fig. 7: notched bending", ("bending",), material.fig7),
    Item("fig8", "Fig. 8: the model", ("impact",), material.fig8),
    Item("fig9", "Fig. 9: distributions of the fracture energy", ("impact",), material.fig9),
    Item("table2", "Table 2: natural frequencies", ("modes",), impact.table2),
    Item("fig10", "Fig. 10: modes", ("modes",), impact.modes),
    Item(
        "fig11",
        "Fig. 11: force and velocity, derived defaults",
        ("impact",),
        impact.fig11("impact"),
    ),
    Item(
        "fig12",
        "Fig. 12: energies and cracks, derived defaults",
        ("impact",),
        impact.fig12("impact"),
    ),
    Item("fig11m", "Fig. 11, measured strength", ("measured",), impact.fig11("measured")),
    Item("fig12m", "Fig. 12, measured strength", ("measured",), impact.fig12("measured")),
    Item(
        "fig13",
        "Fig. 13: force and velocity of random specimens",
        ("ensemble",),
        impact.ensemble(force_envelope="force", velocity_envelope="velocity"),
    ),
    Item(
        "fig14",
        "Fig. 14: energies of random specimens",
        ("ensemble",),
        impact.ensemble(energy_envelope="energies"),
    ),
    Item(
        "fig15",
        "Fig. 15: cracks of random specimens at t2 (energy)",
        ("ensemble",),
        impact.ensemble(cracks_at_t2="at t2 (energy)"),
    ),
    Item(
        "fig16",
        "Fig. 16: cracks of random specimens at the end",
        ("ensemble",),
        impact.ensemble(cracks_at_end="at the end"),
    ),
    Item("table3", "Table 3: cracks of random specimens", ("ensemble",), impact.ensemble()),
)


def chosen(only: str | None) -> list[Item]:
    """The items that ``--only`` names; None: all.

    Raises:
        SceneError: there is no item of a name.
    """
    if only is None:
        return list(ITEMS)
    wanted = [name.strip() for name in only.split(",") if name.strip()]
    known = {item.key: item for item in ITEMS}
    for name in wanted:
        if name not in known:
            raise SceneError(f"--only {name}: must be one of {', '.join(known)}")
    return [item for item in ITEMS if item.key in wanted]
