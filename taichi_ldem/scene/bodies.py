"""Tables of contact: what holds, supports or pulls the specimen, and its own pieces."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from taichi_ldem.scene.values import Flag, NonNegative, Positive, Real, Table, refuse, show


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
    """Contact with rigid bodies; contact of pieces that have parted, and of faces that were cut.

    Nodes that have lost a bar push away each other, and nodes on the faces of the plate, when they
    come closer than the shortest bar (docs/fragment-contact.md).
    """

    fragments: Flag = Field(default=False, description="whether pieces of the plate touch")
    friction: Annotated[Real, Field(ge=0, le=10)] = Field(
        default=0.0, description="coefficient of Coulomb friction between pieces"
    )
    landing: Literal["inelastic", "elastic"] = Field(
        default="inelastic",
        description="what a node does that lands on a striker, ring, support or floor: it stays and"
        " its energy is lost, or it turns back at its speed, and no energy is lost",
    )

    @model_validator(mode="after")
    def _check(self) -> "Contact":
        if self.friction and not self.fragments:
            raise refuse("contact.friction", self.friction, "needs contact.fragments = true")
        return self


class Supports(Table):
    """Fixed rigid bodies under the plate, whose lower face they touch at t = 0.

    cylinders: two, along y, at x = +-span/2; ring: a circular ring around the plate's axis; balls:
    `count` balls on a circle around the plate's axis, the first at angle 0, on the x axis. Keys
    that a kind does not need are refused.
    """

    kind: Literal["cylinders", "ring", "balls"] = Field(
        default="cylinders", description="shape of the supports, see above"
    )
    diameter: Positive = Field(
        description="diameter of the cylinders, of the ring's round section, or of the balls, m"
    )
    span: Positive | None = Field(
        default=None, description="distance between the axes of the two cylinders, m"
    )
    ring_diameter: Positive | None = Field(
        default=None, description="diameter of the middle of the ring's section, m"
    )
    circle_diameter: Positive | None = Field(
        default=None, description="diameter of the circle on which the balls' centres lie, m"
    )
    count: Annotated[int, Field(strict=True, ge=3, le=1000)] | None = Field(
        default=None, description="number of balls"
    )
    friction: NonNegative = Field(
        default=0.0, description="coefficient of Coulomb friction between supports and plate"
    )

    @model_validator(mode="after")
    def _check(self) -> "Supports":
        keys = {
            "cylinders": ("span",),
            "ring": ("ring_diameter",),
            "balls": ("circle_diameter", "count"),
        }
        for key in keys[self.kind]:
            if getattr(self, key) is None:
                raise ValueError(
                    f"missing key 'supports.{key}' (supports.kind = {show(self.kind)})"
                )
        for kind, needed in keys.items():
            for key in needed:
                if kind != self.kind and getattr(self, key) is not None:
                    why = f'is for supports.kind = "{kind}" only'
                    raise refuse(f"supports.{key}", getattr(self, key), why)
        return self

    @property
    def across(self) -> float:
        """Distance between opposite supports: the span, or the diameter of the circle, m."""
        found = self.span or self.ring_diameter or self.circle_diameter
        assert found is not None  # one of them is needed by every kind
        return found
