"""The strips of a toughness study: directions, module sizes and places of the notch."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_ldem.model.material import characteristic_length, check
from taichi_ldem.scene import Scene, parse_scene
from taichi_ldem.studies.toughness.strip import geometry

ANGLES = (0.0, 15.0, 22.5, 30.0, 45.0)
"""Degrees between a crack's plane and a lattice plane (100)."""

REFINED = (0.0, 45.0)
"""Directions of the strips with other modules than the scene's."""

REFINEMENTS = (0.5, 2.0)
"""Numbers of modules in other strips over the scene's."""


@dataclass(frozen=True)
class Strip:
    """A strip: the scene's at an angle, with other modules and another place of the notch.

    Attributes:
        angle: degrees by which the strip is turned in the lattice.
        refinement: number of modules over the scene's along x and y; the thickness is as many
            modules as the scene's.
        seed: of the notch's place within a module, of perturbation and disorder; 0 changes nothing.
    """

    angle: float
    refinement: float
    seed: int

    @property
    def group(self) -> str:
        """Name of the strips that need the same kernels."""
        return f"x{self.refinement:g}_a{self.angle:g}"

    @property
    def name(self) -> str:
        """Name of its scene file."""
        return f"{self.group}_s{self.seed}"

    @staticmethod
    def named(name: str) -> "Strip":
        """The strip of a name."""
        refinement, angle, seed = (part[1:] for part in name.split("_"))
        return Strip(float(angle), float(refinement), int(seed))

    def spacing(self, base: Scene) -> float:
        """Module edge, m."""
        return base.plate.spacing / self.refinement

    def scene(self, base: Scene, threads: int | None = None) -> Scene:
        """The base scene as this strip.

        Args:
            threads: of the run, in place of the scene's.

        Raises:
            SceneError: its modules become so coarse that bars cannot soften (K_r < 1).
        """
        data = base.model_dump(by_alias=True, exclude_none=True)
        count, spacing = base.plate.modules_through_thickness, self.spacing(base)
        sides = list(base.plate.size[:2])
        if not self.angle:  # a strip along the lattice has whole modules
            sides = [spacing * round(side / spacing) for side in sides]
        data["plate"] |= {"size": (*sides, count * spacing), "angle": self.angle}
        random = np.random.default_rng(self.seed)
        shift = random.uniform(-0.5, 0.5, 2).tolist() if self.seed else [0.0, 0.0]
        for notch in data["notch"]:
            _place(notch, [spacing * share for share in shift], count * spacing)
        data["grips"]["length"] = max(base.grips.length, 1.2 * spacing)  # type: ignore[union-attr]
        if self.seed:
            data["plate"]["perturbation_seed"] = base.plate.perturbation_seed + self.seed
            if "disorder" in data:
                data["disorder"]["seed"] = data["disorder"]["seed"] + self.seed
        if threads is not None:
            data["solver"]["threads"] = threads
        scene = parse_scene(data, self.name)
        check(scene)
        return scene


def _place(notch: dict[str, Any], shift: Sequence[float], thickness: float) -> None:
    """Shift a notch's plane and tip (m) and let it go through the thickness."""
    notch["position"] += shift[0]
    (start, _), (end, _) = notch["from"], notch["to"]
    notch["from"] = (min(start, end), 0.0)
    notch["to"] = (max(start, end) + shift[1], thickness)


def strips(
    base: Scene,
    angles: Sequence[float] = ANGLES,
    refinements: Sequence[float] = REFINEMENTS,
    seeds: int = 3,
) -> list[Strip]:
    """All strips: every angle with the scene's modules, then ``REFINED`` with other modules.

    Where one angle only is wanted, it is the one that is refined.

    Raises:
        SceneError: the base scene is no strip, or its bars cannot break.
    """
    geometry(base)
    characteristic_length(base.material)
    found = [Strip(angle, 1.0, seed) for angle in angles for seed in range(seeds)]
    for factor in refinements:
        for angle in REFINED if len(angles) > 1 else angles:
            found += [Strip(angle, factor, seed) for seed in range(seeds)]
    return list(dict.fromkeys(found))  # a factor of 1 asks for the scene's modules again
