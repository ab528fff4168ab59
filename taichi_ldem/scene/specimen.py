"""Tables of the specimen: the plate that is cut from the lattice, its notches and its holes.

Everything is in SI units. The plate is centred at x = y = 0, its bottom face is z = 0 and its top
face z = H.
"""

import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from taichi_ldem.scene.values import (
    Axis,
    Flag,
    NonNegative,
    Positive,
    Real,
    Seed,
    Table,
    refuse,
)

MAX_MODULES = (1 << 31) // 14  # Taichi indexes with 32 bits, and a module has fourteen bars
LARGEST_PERTURBATION = 0.25  # two nodes that come closer by half an edge leave 0.42 of a diagonal
LARGEST_SIDE = 10.0  # m; more is taken for millimetres
FILES = {"mask": (".png", ".npy"), "stl": (".stl",)}
"""Endings of the files that describe a shape."""


class Plate(Table):
    """The specimen: a prism of cubic modules of edge L = thickness / modules_through_thickness."""

    size: tuple[Positive, Positive, Positive] = Field(
        description="sides of the plate along x, y and z (the thickness), m"
    )
    modules_through_thickness: Annotated[int, Field(strict=True, ge=1, le=10_000)] = Field(
        description="number of cubic modules along z; their edge L is size[2] over this number"
    )
    shape: Literal["rectangle", "disc", "dumbbell", "mask", "stl"] = Field(
        default="rectangle",
        description="outline in the plane; a dumb-bell lies along x. 'mask': the shape of an image"
        " or an array; 'stl': a body of triangles",
    )
    mask: str | None = Field(
        default=None,
        description="file of the shape, beside the scene's file: an image (.png) whose dark pixels"
        " are the body, or an array [y, x] or [z, y, x] (.npy) that is not 0 there; it is stretched"
        " to the sides of the plate",
    )
    stl: str | None = Field(
        default=None,
        description="file of a closed body (.stl), beside the scene's file, in any unit: the box"
        " around it becomes the plate's. Needs `pip install taichi_ldem[stl]`",
    )
    file_sha256: str | None = Field(
        default=None,
        description="SHA-256 of this file, which a run's scene.toml records; another is refused",
    )
    diameter: Positive | None = Field(
        default=None,
        description="diameter of the disc that is cut from the middle of the prism, m; for shape ="
        " 'disc' only",
    )
    narrow_width: Positive | None = Field(
        default=None,
        description="width of a dumb-bell's middle part, m; size[1] is the width of its tabs",
    )
    narrow_length: Positive | None = Field(
        default=None, description="length of a dumb-bell's part of constant width, m"
    )
    fillet_radius: Positive | None = Field(
        default=None,
        description="radius of the fillets between a dumb-bell's middle part and its tabs, m",
    )
    angle: Annotated[int | float, Field(ge=0, le=90)] = Field(
        default=0,
        description="angle by which the specimen is turned in the lattice: from the lattice's x to"
        " side size[0], degrees; for scenario = 'tension' only. Notches turn with it",
    )
    lattice: Literal["module", "cubic-26"] = Field(
        default="module",
        description="bars of a module: the paper's cube with a node at its centre, or a cube with"
        " bars from its corners to all 26 neighbours; for poisson_ratio = 0.25, or with stiffness ="
        " 'volumetric'",
    )
    surface_weights: Flag = Field(
        default=True,
        description="whether bars on faces and edges of the prism carry 1/2 and 1/4 of a whole bar;"
        " false: they are full bars",
    )
    stiffness: Literal["equation-2", "as-printed", "volumetric"] = Field(
        default="equation-2",
        description="stiffness of diagonal bars: 1.299 EA_l by Eq. (2), or the printed 0.5196 EA_l;"
        " 'volumetric' gives modules an energy of their volume as well, so that the lattice is"
        " isotropic for any poisson_ratio. It is the default where poisson_ratio is not 0.25",
    )
    perturbation: Annotated[Real, Field(ge=0, le=LARGEST_PERTURBATION)] = Field(
        default=0.0,
        description="largest random displacement of a node from its place in the regular lattice,"
        " in module edges",
    )
    perturbation_seed: Seed = Field(default=0, description="seed of these random displacements")
    velocity: tuple[Real, Real, Real] | None = Field(
        default=None, description="velocity of the whole plate along x, y and z at t = 0, m/s"
    )
    gravity: tuple[Real, Real, Real] | None = Field(
        default=None,
        description="gravity that acts on every node of the plate from t = 0 on, along x, y and z,"
        " m/s2; the striker has a gravity of its own",
    )

    @property
    def spacing(self) -> float:
        """Edge L of a module, m."""
        return self.size[2] / self.modules_through_thickness

    @property
    def modules(self) -> tuple[int, int, int]:
        """Number of modules along x, y, z: the sides rounded to whole modules.

        A specimen that is turned in the lattice has those of the smallest block that holds it.
        """
        sides = self.size[:2]
        if self.angle:
            cosine, sine = math.cos(math.radians(self.angle)), math.sin(math.radians(self.angle))
            x, y = sides
            margin = self.spacing if self.angle % 90 else 0.0
            sides = (x * cosine + y * sine + margin, x * sine + y * cosine + margin)
        nx, ny = (max(1, round(side / self.spacing)) for side in sides)
        return nx, ny, self.modules_through_thickness

    @property
    def falls(self) -> bool:
        """Whether gravity acts on it."""
        return any(self.gravity or ())

    @property
    def moves(self) -> bool:
        """Whether the plate has a velocity at the start, or gravity acts on it."""
        return any(self.velocity or ()) or self.falls

    @property
    def is_prism(self) -> bool:
        """Whether the specimen is the whole prism of modules, but for holes."""
        return self.shape == "rectangle" and not self.angle

    @property
    def actual_size(self) -> tuple[float, float, float]:
        """Sides x, y, z of the prism of modules that the specimen is built of or cut from, m."""
        nx, ny, _ = self.modules
        return nx * self.spacing, ny * self.spacing, self.size[2]

    @model_validator(mode="after")
    def _check(self) -> "Plate":
        x, y, _ = self.size
        count = self.modules_through_thickness
        # `not <=` also catches the infinity and the NaN of an underflowing spacing
        spacing = self.spacing
        total = (x / spacing) * (y / spacing) * count if spacing > 0 else math.inf
        if not total <= MAX_MODULES:
            why = f"must give at most {MAX_MODULES} modules in all, not {total:.3g}"
            raise refuse("plate.modules_through_thickness", count, why)
        for number, side in enumerate(self.size):
            if side > LARGEST_SIDE:
                why = (
                    f"must be at most {LARGEST_SIDE:g}: sides are in metres, and {side:g} mm are "
                    f"{side / 1000:g} m"
                )
                raise refuse(f"plate.size[{number}]", side, why)
        self._check_disc()
        self._check_dumbbell()
        self._check_file()
        return self

    def _check_file(self) -> None:
        for shape, endings in FILES.items():
            file = getattr(self, shape)
            if self.shape != shape:
                if file is not None:
                    raise refuse(f"plate.{shape}", file, f'is for plate.shape = "{shape}" only')
            elif file is None:
                raise refuse("plate.shape", shape, f"needs plate.{shape}, the name of a file")
            elif not file.lower().endswith(endings):
                raise refuse(f"plate.{shape}", file, f"must end in {' or '.join(endings)}")
        if self.file_sha256 is not None and self.shape not in FILES:
            why = 'is for plate.shape = "mask" or "stl" only'
            raise refuse("plate.file_sha256", self.file_sha256, why)

    def _check_dumbbell(self) -> None:
        keys = ("narrow_width", "narrow_length", "fillet_radius")
        for key in keys:
            value = getattr(self, key)
            if self.shape != "dumbbell" and value is not None:
                raise refuse(f"plate.{key}", value, 'is for plate.shape = "dumbbell" only')
            if self.shape == "dumbbell" and value is None:
                raise refuse("plate.shape", self.shape, f"needs plate.{key}")
        if self.shape != "dumbbell":
            return
        assert self.narrow_width is not None
        assert self.narrow_length is not None
        assert self.fillet_radius is not None
        step = (self.size[1] - self.narrow_width) / 2
        if not 0 < step <= self.fillet_radius:
            lower = max(self.spacing, self.size[1] - 2 * self.fillet_radius)
            why = f"must lie between {lower:.6g} and plate.size[1] = {self.size[1]!r}"
            raise refuse("plate.narrow_width", self.narrow_width, why)
        if self.narrow_width < self.spacing:
            why = f"must be at least {self.spacing:.6g}, one module"
            raise refuse("plate.narrow_width", self.narrow_width, why)
        fillet = math.sqrt(step * (2 * self.fillet_radius - step))
        if self.narrow_length + 2 * fillet > self.size[0]:
            why = (
                f"must fit into plate.size[0] together with the fillets of {fillet:.6g} at its ends"
            )
            raise refuse("plate.narrow_length", self.narrow_length, why)

    def _check_disc(self) -> None:
        if self.shape != "disc":
            if self.diameter is not None:
                raise refuse("plate.diameter", self.diameter, 'is for plate.shape = "disc" only')
        elif self.diameter is None:
            raise refuse("plate.shape", self.shape, "needs plate.diameter")
        elif self.diameter > self.width:
            why = f"must be at most {self.width:.6g}, the smaller side that the disc is cut from"
            raise refuse("plate.diameter", self.diameter, why)
        elif self.diameter < self.spacing:
            why = f"must be at least {self.spacing:.6g}, one module"
            raise refuse("plate.diameter", self.diameter, why)

    @property
    def file(self) -> Path | None:
        """The file of the specimen's shape; None where it has none."""
        name = self.mask if self.mask is not None else self.stl
        return None if name is None else Path(name)

    @property
    def width(self) -> float:
        """The smaller in-plane side of the prism, m."""
        return min(self.size[:2])

    def covers(self, x: float, y: float) -> bool:
        """Whether the point (x, y), m, lies over the plate."""
        if self.diameter is not None:
            return math.hypot(x, y) <= self.diameter / 2
        return abs(x) <= self.size[0] / 2 and abs(y) <= self.size[1] / 2


Point = tuple[Real, Real, Real]


class Notch(Table):
    """A flat flaw of cut bars, from the start or from a time on. They are removed, not broken.

    A bar is cut where the line between its nodes at rest crosses the flaw. The flaw is one of
    these: a rectangle normal to an axis (`normal`, `position`, `from`, `to`); a parallelogram
    through three corners (`points`); a disc (`centre`, `diameter`, `direction`). A flaw through
    nodes lies just beyond them, away from the middle of the plate, so that mirrored flaws are
    mirrored; through the middle itself it lies on the side of larger coordinates. A scene with one
    notch takes `--set notch.position=...` and the like.
    """

    normal: Axis | None = Field(
        default=None, description="axis to which the rectangle is normal; for a rectangle"
    )
    position: Real | None = Field(
        default=None, description="position of the rectangle along its normal, m"
    )
    from_: tuple[Real, Real] | None = Field(  # `from` is a keyword
        default=None,
        alias="from",
        description="corner of the rectangle: its other two coordinates in the order x, y, z, m",
    )
    to: tuple[Real, Real] | None = Field(
        default=None, description="opposite corner of the rectangle, m"
    )
    points: tuple[Point, Point, Point] | None = Field(
        default=None,
        description="three corners p0, p1, p2 of a parallelogram, the fourth of which is"
        " p1 + p2 - p0, m",
    )
    centre: Point | None = Field(default=None, description="middle of a disc-shaped flaw, m")
    diameter: Positive | None = Field(default=None, description="diameter of a disc-shaped flaw, m")
    direction: Point | None = Field(
        default=None, description="normal of a disc-shaped flaw, of any length"
    )
    time: NonNegative | None = Field(
        default=None,
        description="time at which the notch opens, s; without it, it is there from the start",
    )

    @property
    def opens_at(self) -> float:
        """Time at which the notch opens, s."""
        return self.time or 0.0

    @property
    def place(self) -> float:
        """Position of a rectangle along its normal, m."""
        assert self.position is not None
        return self.position

    @property
    def axes(self) -> tuple[int, int, int]:
        """Numbers of a rectangle's axes (0 = x): the normal, then the two of `from_` and `to`."""
        assert self.normal is not None
        normal = "xyz".index(self.normal)
        first, second = (axis for axis in range(3) if axis != normal)
        return normal, first, second

    @property
    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Sorted (lower, upper) limits of a rectangle along its two axes, m."""
        assert self.from_ is not None
        assert self.to is not None
        (a, b), (c, d) = zip(self.from_, self.to, strict=True)
        return (min(a, b), max(a, b)), (min(c, d), max(c, d))


class Hole(Table):
    """A hole through the whole thickness: the modules whose centre lies within it are cut out.

    circle: of a diameter; rectangle: of a size; slot: of a size, whose ends are half circles.
    """

    shape: Literal["circle", "rectangle", "slot"] = Field(description="outline of the hole")
    centre: tuple[Real, Real] = Field(
        default=(0.0, 0.0), description="middle of the hole, x and y from the plate's centre, m"
    )
    diameter: Positive | None = Field(default=None, description="diameter of a circle, m")
    size: tuple[Positive, Positive] | None = Field(
        default=None,
        description="length and width of a rectangle or a slot, m; a slot's length includes its"
        " round ends",
    )
    angle: Annotated[int | float, Field(ge=-180, le=180)] = Field(
        default=0,
        description="angle from the plate's x to the length of a rectangle or a slot, degrees",
    )
