"""Scenes of the groups of cases; the cases of a group share its lattice and compiled kernels."""

from typing import Any

SPACING = 0.5e-3
"""Module edge of all groups, m."""

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
