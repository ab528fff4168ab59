"""The features of a scene: the properties that it may have beyond elasticity.

A new feature is an attribute of ``Features``. What a scene does not name is neither allocated nor
compiled; ``fields`` says which fields of the state are present where a feature is.
"""

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from taichi_ldem.model.disorder import varies
from taichi_ldem.scene import DISORDERED, Scene


def _feature(
    what: str, absent_where: str, of: Callable[[Scene], Any], on: Callable[[Scene], dict[str, Any]]
) -> Any:
    """An attribute of ``Features``.

    Args:
        what: what a scene without the feature leaves out.
        absent_where: the keys of a scene without it.
        of: the attribute's value for a scene.
        on: tables that switch the feature on in a scene.
    """
    about = {"left_out": f"{what} ({absent_where})", "of": of, "on": on}
    return dataclasses.field(default=False, metadata=about)


def _corner_notch(scene: Scene) -> dict[str, Any]:
    """A notch that cuts a corner off the plate."""
    x, y, _ = scene.plate.actual_size
    middle = 0.5 * scene.plate.size[2]
    notch = {"normal": "z", "position": middle, "from": [-x, -y], "to": [-0.49 * x, -0.49 * y]}
    return {"notch": [notch]}


def _varying(scene: Scene) -> set[str]:
    """Properties that differ from module to module."""
    return {name for name in DISORDERED if varies(scene, name)}


@dataclass(frozen=True)
class Features:
    """Properties of a scene beyond elasticity; absent ones are neither allocated nor compiled.

    Attributes:
        law: name of the softening law, or None for an elastic lattice.
        damping: whether there is mass-proportional damping.
        closing: whether failed bars still carry compression.
        crack: whether bars also fail at the tip of a crack by the energy that is released.
        tip_strain: whether bars at the tip of a crack fail at the tip strain of their family.
        viscous: whether the faces of a crack part against a viscous force at its tip.
        notch: whether bars are removed from the start.
        strength: whether every bar has an eps_p of its own.
        flaws: whether the strength of a bar is apart from its toughness.
        modulus: whether every bar has a Young's modulus of its own.
        perturbed: whether nodes lie off the regular lattice, so that every bar has a vector of its
            own.
        volumetric: whether modules have an energy of their volume.
        density: whether every node has a mass of its own.
        gravity: whether gravity acts on every node.
    """

    law: str | None = dataclasses.field(
        default=None,
        metadata={
            "left_out": "bar history and broken-bar record (material.damage = false)",
            "of": lambda scene: scene.material.law if scene.material.damage else None,
            "on": lambda _: {
                "material": {"failure_strain": 0.0175, "limit_strain": 0.035, "damage": True}
            },
        },
    )
    damping: bool = _feature(
        "damping",
        "solver.damping = 0",
        lambda scene: scene.solver.damping > 0,
        lambda _: {"solver": {"damping": 1.0}},
    )
    closing: bool = _feature(
        "contact of crack faces",
        'material.after_failure = "gone"',
        lambda scene: scene.material.damage and scene.material.after_failure == "closing",
        lambda _: {"material": {"after_failure": "closing"}},
    )
    crack: bool = _feature(
        "release of energy at crack tips",
        'material.fracture = "bar"',
        lambda scene: scene.material.damage and scene.material.fracture == "crack",
        lambda _: {"material": {"fracture": "crack"}},
    )
    tip_strain: bool = _feature(
        "tip strain of the bar families",
        'material.tip_criterion = "release"',
        lambda scene: scene.material.damage and scene.material.tip_criterion == "strain",
        lambda _: {},  # takes the place of the other criterion
    )
    viscous: bool = _feature(
        "resistance of opening cracks",
        'material.crack_opening = "free"',
        lambda scene: scene.material.damage and scene.material.crack_opening == "viscous",
        lambda _: {"material": {"fracture": "crack", "crack_opening": "viscous"}},
    )
    notch: bool = _feature(
        "removed bars", "no [[notch]]", lambda scene: bool(scene.notch), _corner_notch
    )
    strength: bool = _feature(
        "strength of every bar",
        "no disorder of fracture_energy or youngs_modulus, or no damage",
        lambda scene: scene.material.damage and bool(_varying(scene) - {"density"}),
        lambda _: {"disorder": {"fracture_energy_cv": 0.1, "seed": 1}},
    )
    flaws: bool = _feature(
        "strength apart from toughness",
        "no disorder.strength_cv",
        lambda scene: "strength" in _varying(scene),
        lambda _: {},  # takes the place of a variable G_f, which needs the same fields and more
    )
    modulus: bool = _feature(
        "modulus of every bar",
        "no disorder.youngs_modulus_cv",
        lambda scene: "youngs_modulus" in _varying(scene),
        lambda _: {"disorder": {"youngs_modulus_cv": 0.1, "seed": 1}},
    )
    perturbed: bool = _feature(
        "offset of every node",
        "plate.perturbation = 0",
        lambda scene: scene.plate.perturbation > 0,
        lambda _: {"plate": {"perturbation": 0.05}},
    )
    volumetric: bool = _feature(
        "energy of a module's volume",
        'plate.stiffness other than "volumetric"',
        lambda scene: scene.plate.stiffness == "volumetric",
        lambda _: {"plate": {"stiffness": "volumetric"}, "material": {"poisson_ratio": 0.36}},
    )
    density: bool = _feature(
        "mass of every node",
        "no disorder.density_cv",
        lambda scene: "density" in _varying(scene),
        lambda _: {"disorder": {"density_cv": 0.1, "seed": 1}},
    )
    gravity: bool = _feature(
        "gravity on the plate",
        "no plate.gravity",
        lambda scene: scene.plate.falls,
        lambda _: {"plate": {"gravity": [0.0, 0.0, -9.81]}},
    )

    @classmethod
    def of(cls, scene: Scene) -> "Features":
        """The features that a scene names."""
        return cls(**{f.name: f.metadata["of"](scene) for f in dataclasses.fields(cls)})

    @property
    def damage(self) -> bool:
        """Whether bars have a history."""
        return self.law is not None

    @property
    def history(self) -> bool:
        """Whether a bar may carry less than its elastic force."""
        return self.damage or self.notch

    @property
    def meeting(self) -> bool:
        """Whether the faces of a crack may meet again."""
        return self.damage and self.closing

    @property
    def weakening(self) -> bool:
        """Whether a module may lose the energy of its volume."""
        return self.volumetric and self.history

    def left_out(self) -> list[str]:
        """A line for each feature that is absent, with the keys of the scene that say so."""
        absent = (f for f in dataclasses.fields(self) if not getattr(self, f.name))
        return [f.metadata["left_out"] for f in absent]


def tables_of_all_features(scene: Scene) -> Iterator[dict[str, Any]]:
    """For each feature, the tables that switch it on in a scene."""
    for feature in dataclasses.fields(Features):
        yield feature.metadata["on"](scene)
