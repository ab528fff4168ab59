"""Tables of loads: what pushes or moves parts of the plate, its start, and what is recorded of it.

A load acts on the nodes of a region, in a direction, over a course in time. ``load_rules`` compares
the keys of a load with each other and with other tables.
"""

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from taichi_ldem.scene.values import Axis, NonNegative, Positive, Real, Table

DIRECTIONS = ("-x", "+x", "-y", "+y", "-z", "+z")
"""Sides of the plate, and directions along an axis."""

KINDS = ("velocity", "displacement", "traction", "force")
"""What a load may prescribe; a load has exactly one of them."""

PRESCRIBED = KINDS[:2]
"""Kinds that prescribe the motion of their nodes."""

LARGEST_STRAIN = 0.2
"""Of a plate that is strained at the start; no brittle material bears as much."""


def _direction(value: Any) -> Any:
    """A direction along an axis, "x" or "-y", as numbers; anything else as it is."""
    if not isinstance(value, str):
        return value
    sign, axis = (value[0], value[1:]) if value[:1] in ("+", "-") else ("+", value)
    if axis not in ("x", "y", "z"):
        raise PydanticCustomError("direction", 'must be "x", "-x" and the like, or three numbers')
    size = -1.0 if sign == "-" else 1.0
    return tuple(size if axis == name else 0.0 for name in "xyz")


Vector = tuple[Real, Real, Real]
Direction = Annotated[Vector, BeforeValidator(_direction)]


class Load(Table):
    """A load: a region of nodes, what is prescribed there, its direction, and its course in time.

    Exactly one of `velocity`, `displacement`, `traction` and `force` says what is prescribed. Its
    value is multiplied by the course's factor. Nodes are chosen at rest, and directions stay fixed
    in space (docs/loads.md).
    """

    name: str | None = Field(
        default=None,
        description="name of the load in the columns of history.csv; without it, load1, load2 ...",
    )
    face: Literal["-x", "+x", "-y", "+y", "-z", "+z"] | None = Field(
        default=None,
        description="the outermost nodes of the plate on this side, within half a module",
    )
    box: tuple[Vector, Vector] | None = Field(
        default=None, description="all nodes in the box between two opposite corners, m"
    )
    inner_diameter: NonNegative | None = Field(
        default=None, description="only the nodes of the face outside this circle, m"
    )
    outer_diameter: Positive | None = Field(
        default=None, description="only the nodes of the face inside this circle, m"
    )
    centre: tuple[Real, Real] | None = Field(
        default=None,
        description="centre of these circles: the face's two coordinates in the order x, y, z, m;"
        " without it, the middle of the face",
    )
    velocity: Real | None = Field(
        default=None, description="prescribed velocity of the nodes, m/s; 0 holds them"
    )
    displacement: Real | None = Field(
        default=None, description="prescribed displacement of the nodes from their start, m"
    )
    traction: Real | None = Field(
        default=None, description="force over the area at rest of the region's surface, Pa"
    )
    force: Real | None = Field(
        default=None, description="force in all, shared among the nodes by their masses, N"
    )
    direction: Direction = Field(description='direction, of any length, or "x", "-y" and the like')
    lateral: Literal["free", "held"] = Field(
        default="free",
        description="whether nodes of a prescribed motion are held across the direction",
    )
    course: Literal["constant", "ramp", "half-sine", "table"] = Field(
        default="constant",
        description="course of the factor: 1; from 0 to 1 in the time `ramp` as 3 t^2 - 2 t^3; half"
        " a sine in the time `duration`; or `factors` at `times`, with straight lines between them",
    )
    start: NonNegative = Field(default=0.0, description="time at which the course begins, s")
    ramp: Positive | None = Field(
        default=None, description="time in which a 'ramp' reaches the factor 1, s"
    )
    duration: Positive | None = Field(
        default=None, description="time after the start at which the factor is 0 again, s"
    )
    table: str | None = Field(
        default=None,
        description="CSV file with two columns, time (s) and factor, relative to the scene file; it"
        " is read into `times` and `factors`",
    )
    times: tuple[NonNegative, ...] | None = Field(
        default=None, description="times of a 'table' from the start on, rising, s"
    )
    factors: tuple[Real, ...] | None = Field(
        default=None, description="factors of a 'table' at these times; the last one stays"
    )

    @property
    def columns(self) -> tuple[str, str]:
        """Names of its columns of the history: resultant and mean displacement."""
        return f"{self.name}_force_n", f"{self.name}_displacement_m"

    @property
    def kind(self) -> str:
        """The key that says what is prescribed."""
        return next(kind for kind in KINDS if getattr(self, kind) is not None)

    @property
    def value(self) -> float:
        """What is prescribed, SI units."""
        return float(getattr(self, self.kind))

    @property
    def prescribes(self) -> bool:
        """Whether the motion of the nodes is prescribed, not a force on them."""
        return self.kind in PRESCRIBED

    @property
    def factor_at_start(self) -> float:
        """The factor at t = 0."""
        if self.start > 0 or self.course in ("ramp", "half-sine"):
            return 0.0
        return 1.0 if self.factors is None else self.factors[0]

    @property
    def largest_speed(self) -> float:
        """Largest speed that it prescribes to its nodes, m/s; 0 for a force or a traction."""
        if not self.prescribes:
            return 0.0
        times, factors = self.times or (), self.factors or ()
        if self.kind == "velocity":
            return abs(self.value) * max(map(abs, factors), default=1.0)
        steps = list(zip(times, times[1:], factors, factors[1:], strict=False))
        rates = [abs((after - before) / (end - begin)) for begin, end, before, after in steps]
        if self.course == "ramp" and self.ramp:
            rates = [1.5 / self.ramp]  # of 3 t^2 - 2 t^3 in the middle
        elif self.course == "half-sine" and self.duration:
            rates = [math.pi / self.duration]
        return abs(self.value) * max(rates, default=0.0)

    @property
    def unit(self) -> tuple[float, float, float]:
        """The direction with a length of one."""
        x, y, z = self.direction
        length = math.hypot(x, y, z)
        return x / length, y / length, z / length


class Start(Table):
    """The motion and the strain of the plate at t = 0, all of which add up.

    The strained plate is not in equilibrium by itself: its free faces set waves off.
    """

    velocity: Vector | None = Field(
        default=None, description="velocity of all nodes along x, y and z, m/s"
    )
    rotation: Vector | None = Field(
        default=None,
        description="angular velocity about the plate's centre of mass, along x, y and z, rad/s",
    )
    expansion: Real | None = Field(
        default=None,
        description="velocity away from the axis x = y = 0 over the distance from it, 1/s",
    )
    strain: (
        tuple[
            Annotated[Real, Field(ge=-LARGEST_STRAIN, le=LARGEST_STRAIN)],
            Annotated[Real, Field(ge=-LARGEST_STRAIN, le=LARGEST_STRAIN)],
            Annotated[Real, Field(ge=-LARGEST_STRAIN, le=LARGEST_STRAIN)],
        ]
        | None
    ) = Field(
        default=None,
        description="strain along x, y and z: each coordinate is displaced by its strain times"
        " itself, from x = y = 0 and the lower face",
    )


QUANTITIES = {
    "displacement": [f"displacement_{axis}_m" for axis in "xyz"],
    "velocity": [f"velocity_{axis}_m_s" for axis in "xyz"],
    "strain": [f"strain_{pair}" for pair in ("xx", "yy", "zz", "xy", "yz", "xz")],
    "stress": [f"stress_{pair}_pa" for pair in ("xx", "yy", "zz", "xy", "yz", "xz")],
}
"""What a probe may record, and its columns after the probe's name."""

Recorded = Literal["displacement", "velocity", "strain", "stress"]
OF_NODES: tuple[Recorded, ...] = ("displacement", "velocity")
"""Quantities that are means over nodes; the others are means over modules."""


class Probe(Table):
    """Nodes and modules whose mean motion, strain and stress are columns of history.csv.

    Exactly one of `point`, `box` and `plane` says which nodes, at rest; the modules are those whose
    centres are chosen in the same way. Means over nodes are weighted with their masses, means over
    modules with their volumes.
    """

    name: str | None = Field(
        default=None,
        description="name of the probe in the columns; without it, probe1, probe2 ...",
    )
    point: Vector | None = Field(
        default=None,
        description="the node that is nearest to a point, m; z = 0 is the lower face",
    )
    box: tuple[Vector, Vector] | None = Field(
        default=None, description="all nodes in the box between two opposite corners, m"
    )
    plane: Axis | None = Field(
        default=None,
        description="all nodes within half a module of the plane normal to this axis at `position`",
    )
    position: Real | None = Field(default=None, description="position of the plane, m")
    quantities: tuple[Recorded, ...] = Field(
        default=OF_NODES,
        min_length=1,
        description="what is recorded: 'displacement' and 'velocity' of the nodes, 'strain' (Green"
        " and Lagrange) and 'stress' (Cauchy) of the modules",
    )

    def columns_of(self, *quantities: str) -> list[str]:
        """Names of the columns of some quantities, those that it records."""
        return [
            f"{self.name}_{ending}"
            for quantity in quantities
            if quantity in self.quantities
            for ending in QUANTITIES[quantity]
        ]

    @property
    def columns(self) -> list[str]:
        """Names of its columns of the history, in the order of ``QUANTITIES``."""
        return self.columns_of(*QUANTITIES)
