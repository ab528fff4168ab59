"""The table of a striker: its nose, and how it moves."""

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from taichi_ldem.scene.names import NOSE_NAMES
from taichi_ldem.scene.values import (
    MAGNITUDE,
    Flag,
    NonNegative,
    OneOf,
    Positive,
    Real,
    Table,
    refuse,
    show,
)

NoseName = Annotated[str, BeforeValidator(OneOf(NOSE_NAMES))]

NOSE_KEYS = {"cone": "nose_angle", "ogive": "nose_radius", "ring": "ring_diameter"}
"""The key of the number that a nose needs beside the diameter, by the nose's name."""

MOST_STRIKERS = 8
"""Largest number of strikers: the kernels of each are compiled on their own."""


def _velocity(value: Any) -> Any:
    """A speed towards the plate, or a vector in space; one error for both."""
    parts = value if isinstance(value, list | tuple) else [value]
    numbers = all(isinstance(p, int | float) and not isinstance(p, bool) for p in parts)
    if not numbers or (parts is value and len(parts) != 3):
        wish = "must be a number, towards the plate, or a list of 3 numbers, along x, y and z"
        raise PydanticCustomError("velocity", wish)
    if not all(math.isfinite(p) for p in parts):
        raise PydanticCustomError("velocity", "must be a finite number")
    if not all(p == 0 or 1 / MAGNITUDE <= abs(p) <= MAGNITUDE for p in parts):
        raise PydanticCustomError("velocity", "must lie between 1e-20 and 1e20 in SI units")
    if parts is value:
        if parts[2] > 0:
            raise PydanticCustomError("velocity", "its z must be at most 0, towards the plate")
        return tuple(parts)
    if value < 0:
        raise PydanticCustomError("velocity", "must be at least 0")
    return value


class Striker(Table):
    """A rigid nose on a shaft of the same width. It does not turn.

    hemisphere: half a sphere on a round shaft, also for a ball; cylinder: half a cylinder on a flat
    shaft, with its axis along y and longer than the plate is wide; flat: a round shaft with a flat
    end and a sharp edge; cone, ogive: a pointed end of a round shaft; ring: the round edge of a
    tube. Several strikers are several tables `[[striker]]`.
    """

    shape: NoseName = Field(default="hemisphere", description="shape of the nose")
    diameter: Positive = Field(
        description="diameter of nose and shaft, m; with shape = 'ring' the thickness of the wall"
    )
    nose_angle: Annotated[Real, Field(ge=1, le=89)] | None = Field(
        default=None,
        description="angle between the axis and the flank of a cone, degrees: half of the angle"
        " between the flanks; for shape = 'cone' only",
    )
    nose_radius: Positive | None = Field(
        default=None,
        description="radius of the arc of an ogive, at least half the diameter, m; for shape ="
        " 'ogive' only",
    )
    ring_diameter: Positive | None = Field(
        default=None,
        description="diameter of the middle of the wall of a ring, m; for shape = 'ring' only",
    )
    mass: Positive | None = Field(
        default=None,
        description="mass of the striker, kg; needed and used with motion = 'free' only",
    )
    velocity: Annotated[NonNegative | tuple[Real, Real, Real], BeforeValidator(_velocity)] = Field(
        description="initial velocity towards the plate or, as a list, along x, y and z, m/s; z is"
        " negative towards the plate. At an angle a to the vertical, the speed v along x is"
        " [v sin a, 0, -v cos a], as numbers"
    )
    motion: Literal["free", "prescribed"] = Field(
        default="free",
        description="whether the plate slows the striker, or its velocity stays as it is given",
    )
    guided: Flag = Field(
        default=True,
        description="whether the striker moves along z only; false: along x and y, too",
    )
    gravity: NonNegative = Field(
        default=0.0, description="gravity that acts on the striker towards the plate, m/s2"
    )
    gap: NonNegative = Field(
        default=0.0, description="distance between the tip and the top face at t = 0, m"
    )
    position: tuple[Real, Real] = Field(
        default=(0.0, 0.0),
        description="coordinates x and y of the axis, from the plate's centre, m",
    )
    friction: NonNegative = Field(
        default=0.0, description="coefficient of Coulomb friction between striker and plate"
    )

    @model_validator(mode="after")
    def _check(self) -> "Striker":
        self._check_nose()
        if self.motion == "free" and self.mass is None:
            raise ValueError("missing key 'striker.mass'")
        if self.motion == "prescribed" and self.gravity:
            why = 'must be 0 with striker.motion = "prescribed", which gravity does not change'
            raise refuse("striker.gravity", self.gravity, why)
        if self.guided and any(self.vector[:2]):
            why = "needs striker.guided = false, as a guided striker moves along z only"
            raise refuse("striker.velocity", self.velocity, why)
        return self

    def _check_nose(self) -> None:
        for shape, key in NOSE_KEYS.items():
            value = getattr(self, key)
            if self.shape == shape and value is None:
                raise ValueError(f"missing key 'striker.{key}' (striker.shape = {show(shape)})")
            if self.shape != shape and value is not None:
                raise refuse(f"striker.{key}", value, f'is for striker.shape = "{shape}" only')
        if self.nose_radius is not None and self.nose_radius < self.diameter / 2:
            why = f"must be at least {self.diameter / 2!r}, half of striker.diameter"
            raise refuse("striker.nose_radius", self.nose_radius, why)
        if self.ring_diameter is not None and self.ring_diameter < self.diameter:
            why = f"must be at least striker.diameter = {self.diameter!r}, the wall's thickness"
            raise refuse("striker.ring_diameter", self.ring_diameter, why)

    @property
    def nose_number(self) -> float | None:
        """The value of the key that the nose needs beside the diameter, if it needs one."""
        key = NOSE_KEYS.get(self.shape)
        return None if key is None else float(getattr(self, key))

    @property
    def width(self) -> float:
        """Width of the whole striker, m."""
        return self.diameter + (self.ring_diameter or 0.0)

    @property
    def vector(self) -> tuple[float, float, float]:
        """The initial velocity along x, y and z, m/s."""
        if isinstance(self.velocity, tuple):
            return self.velocity
        return 0.0, 0.0, -self.velocity

    @property
    def speed(self) -> float:
        """The size of the initial velocity, m/s."""
        if isinstance(self.velocity, tuple):
            return math.hypot(*self.velocity)
        return self.velocity

    @property
    def is_prescribed(self) -> bool:
        """Whether its velocity stays as it is given."""
        return self.motion == "prescribed"
