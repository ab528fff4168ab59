"""Tables of contact: what strikes, holds, supports or pulls the specimen, and its own pieces."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from taichi_ldem.scene.names import NOSE_NAMES
from taichi_ldem.scene.values import Flag, NonNegative, OneOf, Positive, Real, Table, refuse, show

NoseName = Annotated[str, BeforeValidator(OneOf(NOSE_NAMES))]


class Striker(Table):
    """A rigid nose on a shaft of the same diameter. It moves along -z only.

    hemisphere: half a sphere on a round shaft; cylinder: half a cylinder on a flat shaft, with its
    axis along y and longer than the plate is wide.
    """

    shape: NoseName = Field(default="hemisphere", description="shape of the nose")
    diameter: Positive = Field(description="diameter of nose and shaft, m")
    mass: Positive = Field(description="mass of the striker, kg")
    velocity: NonNegative = Field(description="initial velocity towards the plate, m/s")
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


class Clamp(Table):
    """How the plate is held, between two concentric circles around its centre.

    rings: rigid rings on both faces, free to separate, without slip where the plate is pressed
    against them unless `friction` is given; bonded: the nodes of both faces between the
    circles are fixed; rim: all nodes outside the inner circle are fixed (no outer diameter needed);
    free: not held. Keys that a kind does not need are ignored, so that the kind can be changed
    alone.
    """

    kind: Literal["rings", "bonded", "rim", "free"] = Field(
        description="how the plate is held, see above"
    )
    inner_diameter: Positive | None = Field(
        default=None, description="diameter of the inner circle, m; not for kind = 'free'"
    )
    outer_diameter: Positive | None = Field(
        default=None, description="diameter of the outer circle, m; for 'rings' and 'bonded'"
    )
    friction: NonNegative | None = Field(
        default=None,
        description="coefficient of Coulomb friction between rings and plate, for 'rings'; without"
        " it the plate does not slip",
    )
    edge: Literal["node", "unbiased"] = Field(
        default="node",
        description="which nodes belong to the clamp: 'node', those between the circles, so that"
        " the clamp begins half a module late on average; 'unbiased', those up to half a module"
        " outside the circles, too",
    )

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
    """Grips that pull a specimen apart along its long side at prescribed speeds.

    All nodes within `length` of either end follow its grip. The speed of separation rises from
    zero to `velocity` in the time `ramp` as 3 t^2 - 2 t^3.
    """

    length: Positive = Field(description="length of the specimen in each grip, m")
    velocity: Positive = Field(description="speed at which the two grips move apart, m/s")
    ramp: NonNegative = Field(description="time in which the grips reach this speed, s")
    lateral: Literal["held", "free"] = Field(
        default="held", description="whether the grips hold their nodes across the pull"
    )
    gauge_length: Positive | None = Field(
        default=None,
        description="length of the middle part on which strains are measured, m;"
        " without it, half of the length between the grips",
    )


class Floor(Table):
    """A rigid plane under the plate, on which the plate or its pieces fall, slide and rest.

    A slope is a gravity (`plate.gravity`) that is not normal to the floor. The striker and the
    supports do not meet the floor.
    """

    gap: NonNegative = Field(
        default=0.0, description="distance between the lower face and the floor at t = 0, m"
    )
    friction: NonNegative = Field(
        default=0.0, description="coefficient of Coulomb friction between floor and plate"
    )


class Contact(Table):
    """Contact of pieces of the plate that have parted, and of faces that a notch has cut.

    Nodes that have lost a bar push away each other, and nodes on the faces of the plate, when they
    come closer than the shortest bar (docs/fragment-contact.md).
    """

    fragments: Flag = Field(default=False, description="whether pieces of the plate touch")
    friction: Annotated[Real, Field(ge=0, le=10)] = Field(
        default=0.0, description="coefficient of Coulomb friction between pieces"
    )

    @model_validator(mode="after")
    def _check(self) -> "Contact":
        if self.friction and not self.fragments:
            raise refuse("contact.friction", self.friction, "needs contact.fragments = true")
        return self


class Supports(Table):
    """Two fixed rigid cylinders under the plate at x = +-span/2, along y."""

    span: Positive = Field(description="distance between the axes of the two cylinders, m")
    diameter: Positive = Field(description="diameter of both cylinders, m")
    friction: NonNegative = Field(
        default=0.0, description="coefficient of Coulomb friction between cylinders and plate"
    )
