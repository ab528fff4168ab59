"""Tables of the rigid bodies: what strikes, holds, supports or pulls the specimen."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from taichi_ldem.scene.names import NOSE_NAMES
from taichi_ldem.scene.values import NonNegative, OneOf, Positive, Real, Table, refuse, show

NoseName = Annotated[str, BeforeValidator(OneOf(NOSE_NAMES))]


class Striker(Table):
    """Rigid nose on a shaft of the same diameter; moves along -z only, without friction.

    hemisphere: on a round shaft; cylinder: half of one with its axis along y, longer than the plate
    is wide, on a flat shaft.
    """

    shape: NoseName = Field(
        default="hemisphere", description="of the nose; the cylinder's axis is along y"
    )
    diameter: Positive = Field(description="of nose and shaft, m")
    mass: Positive = Field(description="kg")
    velocity: NonNegative = Field(description="initial, towards the plate, m/s")
    gravity: NonNegative = Field(
        default=0.0, description="acts on the striker, towards the plate, m/s2"
    )
    gap: NonNegative = Field(
        default=0.0, description="between the tip and the top face at t = 0, m"
    )
    position: tuple[Real, Real] = Field(
        default=(0.0, 0.0), description="x, y from the plate's centre, m"
    )


class Clamp(Table):
    """How the plate is held, between two concentric circles around its centre.

    rings: rigid rings on both faces, free to separate; bonded: the nodes of both faces between the
    circles are fixed; rim: all nodes outside the inner circle are fixed (no outer diameter needed);
    free: not held. Diameters that a kind does not need are ignored, so that the kind can be
    changed alone.
    """

    kind: Literal["rings", "bonded", "rim", "free"] = Field(
        description="rings that may separate; nodes of both faces between the circles fixed; all"
        " nodes outside the inner circle fixed; not held"
    )
    inner_diameter: Positive | None = Field(default=None, description="m; not for kind = 'free'")
    outer_diameter: Positive | None = Field(default=None, description="m; for 'rings' and 'bonded'")

    @model_validator(mode="after")
    def _check(self) -> "Clamp":
        needed = {"rim": ("inner_diameter",), "free": ()}
        for key in needed.get(self.kind, ("inner_diameter", "outer_diameter")):
            if getattr(self, key) is None:
                raise ValueError(f"missing key 'clamp.{key}' (clamp.kind = {show(self.kind)})")
        if self.kind in ("rings", "bonded"):
            assert self.inner_diameter is not None
            assert self.outer_diameter is not None
            if self.inner_diameter >= self.outer_diameter:
                why = f"must be smaller than clamp.outer_diameter = {self.outer_diameter!r}"
                raise refuse("clamp.inner_diameter", self.inner_diameter, why)
        return self


class Grips(Table):
    """What pulls a specimen apart along its long side: both ends move at prescribed speeds.

    All nodes within `length` of either end follow the grip. Its separation speed rises from zero
    to `velocity` in the time `ramp` as 3 t^2 - 2 t^3.
    """

    length: Positive = Field(description="of the specimen in each grip, m")
    velocity: Positive = Field(description="at which the two grips move apart, m/s")
    ramp: NonNegative = Field(description="time in which they reach it, s")
    lateral: Literal["held", "free"] = Field(
        default="held", description="whether nodes in the grips may move across the pull"
    )
    gauge_length: Positive | None = Field(
        default=None,
        description="of the middle part on which strains are measured, m;"
        " default: half of the length between the grips",
    )


class Supports(Table):
    """Two fixed rigid cylinders under the plate, axes along y, at x = +-span/2; no friction."""

    span: Positive = Field(description="between the two axes, m")
    diameter: Positive = Field(description="of both cylinders, m")
