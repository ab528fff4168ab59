"""The scene: what is simulated, as data (TOML), checked before anything expensive is imported.

Attribute names are the TOML keys. Everything is in SI units. Coordinates: the plate is centred at
x = y = 0, its bottom face is z = 0 and its top face z = H; the striker comes from above.
"""

import difflib
import itertools
import json
import math
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import tomli_w
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)
from pydantic_core import ErrorDetails, PydanticCustomError, PydanticKnownError

from taichi_ldem.errors import SceneError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

MAX_FILE_BYTES = 1 << 20
MAX_MODULES = (1 << 31) // 14  # Taichi indexes with 32 bits, and a module has fourteen bars
MAX_STEPS = 10**12
MAX_SAMPLES = 10**7
MAX_FRAMES = 10**4
MAGNITUDE = 1e20  # of numbers in SI units, and one over it
NO_DURATION = 1.0  # s, of a scene that does not step in time
LARGEST_CV = 1.5
LARGEST_PERTURBATION = 0.25  # two nodes that come closer by half an edge leave 0.42 of a diagonal
FEWEST_DATA = 3  # values that a distribution can be fitted to
LARGEST_SIDE = 10.0  # m; more is taken for millimetres
DISORDERED = ("fracture_energy", "youngs_modulus", "density")
"""Properties that may vary, in the order of their random streams: never reorder."""
ROUNDING = 0.01  # largest relative change of a side that is rounded to whole modules


# --- the tables -----------------------------------------------------------------------------------


def _plausible(value: float) -> float:
    # what passes cannot overflow or underflow in any formula of the solver
    if value == 0 or 1 / MAGNITUDE <= abs(value) <= MAGNITUDE:
        return value
    raise PydanticCustomError("magnitude", "must lie between 1e-20 and 1e20 in SI units")


def _braced(value: float) -> float:
    if value > 0:
        return value
    why = (
        "must be greater than 0: the diagonal bars would have no stiffness, and a lattice without "
        "them is a mechanism"
    )
    raise PydanticCustomError("mechanism", why)


Real = Annotated[float, Field(strict=True), AfterValidator(_plausible)]
Positive = Annotated[Real, Field(gt=0)]
NonNegative = Annotated[Real, Field(ge=0)]
Flag = Annotated[bool, Field(strict=True)]
Seed = Annotated[int, Field(strict=True, ge=0, lt=1 << 63)]
Axis = Literal["x", "y", "z"]


LAW_NAMES = ["bilinear", "exponential"]
"""Softening laws that ``material.law`` may name; ``laws.register`` adds to them."""


def _known_law(name: str) -> str:
    if name in LAW_NAMES:
        return name
    # as pydantic words it for literals
    *most, last = (repr(law) for law in LAW_NAMES)
    raise PydanticKnownError("literal_error", {"expected": f"{', '.join(most)} or {last}"})


LawName = Annotated[str, Field(strict=True), AfterValidator(_known_law)]


def _refuse(key: str, value: object, why: str) -> ValueError:
    """The error of a check of our own: it names key and value itself."""
    return ValueError(f"{key} = {_show(value)}: {why}")


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Plate(_Table):
    """The specimen: a prism of cubic modules of edge L = thickness / modules_through_thickness."""

    size: tuple[Positive, Positive, Positive] = Field(description="sides x, y, z (thickness), m")
    modules_through_thickness: Annotated[int, Field(strict=True, ge=1, le=10_000)] = Field(
        description="cubic modules along z; their edge L is size[2] over this number"
    )
    shape: Literal["rectangle", "disc", "dumbbell"] = Field(
        default="rectangle", description="outline in the plane; 'dumbbell' lies along x"
    )
    diameter: Positive | None = Field(
        default=None,
        description="of the disc cut from the prism, centred, m; for shape = 'disc' only",
    )
    narrow_width: Positive | None = Field(
        default=None, description="of a dumb-bell in its middle, m; size[1] is that of its tabs"
    )
    narrow_length: Positive | None = Field(
        default=None, description="of a dumb-bell's part of constant width, m"
    )
    fillet_radius: Positive | None = Field(
        default=None, description="from a dumb-bell's narrow part to its tabs, m"
    )
    angle: Literal[0, 45] = Field(
        default=0,
        description="of the specimen's long side to the lattice's x axis, degrees; tension only",
    )
    surface_weights: Flag = Field(
        default=True,
        description="bars on faces and edges of the prism carry 1/2 and 1/4; false: full bars",
    )
    stiffness: Literal["equation-2", "as-printed"] = Field(
        default="equation-2",
        description="diagonal bars: 1.299 EA_l of Eq. (2), or the printed 0.5196 EA_l",
    )

    perturbation: Annotated[Real, Field(ge=0, le=LARGEST_PERTURBATION)] = Field(
        default=0.0,
        description="largest way of a node off the regular lattice, in module edges; random",
    )
    perturbation_seed: Seed = Field(default=0, description="of the nodes' ways")

    @property
    def spacing(self) -> float:
        """Edge L of a module, m."""
        return self.size[2] / self.modules_through_thickness

    @property
    def modules(self) -> tuple[int, int, int]:
        """Number of modules along x, y, z: the sides rounded to whole modules.

        A specimen cut at an angle has those of the smallest square block that holds it.
        """
        sides = self.size[:2]
        if self.angle:
            sides = ((sides[0] + sides[1]) / math.sqrt(2) + self.spacing,) * 2
        nx, ny = (max(1, round(side / self.spacing)) for side in sides)
        return nx, ny, self.modules_through_thickness

    @property
    def is_prism(self) -> bool:
        """Whether the specimen is the whole prism of modules."""
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
            raise _refuse("plate.modules_through_thickness", count, why)
        for number, side in enumerate(self.size):
            if side > LARGEST_SIDE:
                why = (
                    f"sides are in metres and at most {LARGEST_SIDE:g} m long; {side:g} millimetres"
                    f" are {side / 1000:g}"
                )
                raise _refuse(f"plate.size[{number}]", side, why)
        self._check_disc()
        self._check_dumbbell()
        return self

    def _check_dumbbell(self) -> None:
        keys = ("narrow_width", "narrow_length", "fillet_radius")
        for key in keys:
            value = getattr(self, key)
            if self.shape != "dumbbell" and value is not None:
                raise _refuse(f"plate.{key}", value, 'only for plate.shape = "dumbbell"')
            if self.shape == "dumbbell" and value is None:
                raise _refuse("plate.shape", self.shape, f"needs plate.{key}")
        if self.shape != "dumbbell":
            return
        assert self.narrow_width is not None
        assert self.narrow_length is not None
        assert self.fillet_radius is not None
        step = (self.size[1] - self.narrow_width) / 2
        if not 0 < step <= self.fillet_radius:
            lower = max(self.spacing, self.size[1] - 2 * self.fillet_radius)
            why = f"must lie between {lower:.6g} and plate.size[1] = {self.size[1]!r}"
            raise _refuse("plate.narrow_width", self.narrow_width, why)
        if self.narrow_width < self.spacing:
            why = f"must be at least {self.spacing:.6g}, one module"
            raise _refuse("plate.narrow_width", self.narrow_width, why)
        fillet = math.sqrt(step * (2 * self.fillet_radius - step))
        if self.narrow_length + 2 * fillet > self.size[0]:
            why = f"with fillets of {fillet:.6g} at both ends must fit in plate.size[0]"
            raise _refuse("plate.narrow_length", self.narrow_length, why)

    def _check_disc(self) -> None:
        if self.shape != "disc":
            if self.diameter is not None:
                raise _refuse("plate.diameter", self.diameter, 'only for plate.shape = "disc"')
        elif self.diameter is None:
            raise _refuse("plate.shape", self.shape, "needs plate.diameter")
        elif self.diameter > self.width:
            why = f"must be at most {self.width:.6g}, the smaller side that the disc is cut from"
            raise _refuse("plate.diameter", self.diameter, why)
        elif self.diameter < self.spacing:
            why = f"must be at least {self.spacing:.6g}, one module"
            raise _refuse("plate.diameter", self.diameter, why)

    @property
    def width(self) -> float:
        """The smaller in-plane side of the prism, m."""
        return min(self.size[:2])

    def covers(self, x: float, y: float) -> bool:
        """Whether the point (x, y), m, lies over the plate."""
        if self.diameter is not None:
            return math.hypot(x, y) <= self.diameter / 2
        return abs(x) <= self.size[0] / 2 and abs(y) <= self.size[1] / 2


class Material(_Table):
    """Elasticity and fracture. With `damage = false` the fracture keys may be left out or stay."""

    youngs_modulus: Positive = Field(description="E, Pa")
    poisson_ratio: Annotated[Real, Field(lt=0.5), AfterValidator(_braced)]
    density: Positive = Field(description="kg/m3")
    fracture_energy: Positive | None = Field(default=None, description="G_f, J/m2")
    failure_factor: Positive | None = Field(
        default=None, description="R_f, m^-1/2, Eq. (9): eps_p = R_f sqrt(G_f / E)"
    )
    failure_strain: Annotated[Real, Field(gt=0, lt=1)] | None = Field(
        default=None, description="eps_p itself, instead of failure_factor"
    )
    limit_strain: Positive | None = Field(
        default=None, description="eps_r itself, instead of Eqs. (11), (12)"
    )
    law: LawName = Field(
        default="bilinear", description="softening: 'bilinear', 'exponential' or a registered one"
    )
    damage: Flag = True
    fracture_areas: Literal["derived", "paper"] = Field(
        default="derived", description="which bar family has which fracture area, Eqs. (7), (8)"
    )

    @model_validator(mode="after")
    def _check(self) -> "Material":
        if not self.damage:
            return self
        if self.fracture_energy is None:
            raise ValueError("missing key 'material.fracture_energy' (or material.damage = false)")
        if self.failure_factor is None and self.failure_strain is None:
            raise ValueError(
                "missing key 'material.failure_factor' or 'material.failure_strain'"
                " (or material.damage = false)"
            )
        if self.failure_factor is not None and self.failure_strain is not None:
            why = "must not stand beside material.failure_factor; give one of the two"
            raise _refuse("material.failure_strain", self.failure_strain, why)
        strain = self.failure_strain
        if self.limit_strain is not None and strain is not None and self.limit_strain < strain:
            why = f"must be at least material.failure_strain = {strain!r}"
            raise _refuse("material.limit_strain", self.limit_strain, why)
        if self.failure_factor is not None:
            derived = self.failure_factor * math.sqrt(self.fracture_energy / self.youngs_modulus)
            if derived >= 1:
                why = (
                    f"gives a peak strain eps_p = R_f sqrt(G_f / E) = {derived:.4g}, which must be "
                    "less than 1; give SI units: E in Pa, G_f in J/m2, R_f in m^-1/2"
                )
                raise _refuse("material.youngs_modulus", self.youngs_modulus, why)
        return self


Cv = Annotated[Real, Field(ge=0, le=LARGEST_CV)]


class Disorder(_Table):
    """Random material: Weibull fields around the means that [material] gives, Eqs. (14) to (17).

    Of each property either the coefficient of variation or a list of measured values, to which the
    Weibull shape is fitted (maximum likelihood; their mean is not used). A CV of 0 is no disorder.
    """

    fracture_energy_cv: Cv | None = Field(default=None, description="of each bar's G_f")
    youngs_modulus_cv: Cv | None = Field(default=None, description="of each bar's E")
    density_cv: Cv | None = Field(default=None, description="of each module's density")
    fracture_energy_data: tuple[Positive, ...] | None = Field(
        default=None, description="measured values in one unit, instead of the CV"
    )
    youngs_modulus_data: tuple[Positive, ...] | None = Field(default=None, description="the same")
    density_data: tuple[Positive, ...] | None = Field(default=None, description="the same")
    correlation_length: NonNegative = Field(
        default=0.0,
        description="at which the underlying Gaussian field's correlation is 1/e, m; 0: every bar"
        " on its own, which depends on the module edge",
    )
    seed: Seed = Field(default=0, description="of the random fields")

    @model_validator(mode="after")
    def _check(self) -> "Disorder":
        named = False
        for name in DISORDERED:
            cv, data = getattr(self, f"{name}_cv"), getattr(self, f"{name}_data")
            named |= cv is not None or data is not None
            if data is None:
                continue
            if cv is not None:
                why = f"must not stand beside disorder.{name}_data; give one of the two"
                raise _refuse(f"disorder.{name}_cv", cv, why)
            if len(data) < FEWEST_DATA or max(data) - min(data) <= 1e-9 * max(data):
                why = f"must be at least {FEWEST_DATA} values that differ"
                raise _refuse(f"disorder.{name}_data", data, why)
        if not named:
            keys = ", ".join(f"'disorder.{name}_cv'" for name in DISORDERED)
            raise ValueError(f"table '[disorder]' names nothing that varies: give one of {keys}")
        return self


class Striker(_Table):
    """Rigid nose on a shaft of the same diameter; moves along -z only, without friction.

    hemisphere: on a round shaft; cylinder: half of one with its axis along y, longer than the plate
    is wide, on a flat shaft.
    """

    shape: Literal["hemisphere", "cylinder"] = Field(
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


class Clamp(_Table):
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
                raise ValueError(f"missing key 'clamp.{key}' (clamp.kind = {_show(self.kind)})")
        if self.kind in ("rings", "bonded"):
            assert self.inner_diameter is not None
            assert self.outer_diameter is not None
            if self.inner_diameter >= self.outer_diameter:
                why = f"must be smaller than clamp.outer_diameter = {self.outer_diameter!r}"
                raise _refuse("clamp.inner_diameter", self.inner_diameter, why)
        return self


class Grips(_Table):
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


class Pulse(_Table):
    """A wave that travels along an axis from t = 0 on: Gaussian in displacement, two probe planes.

    longitudinal, shear: a plane wave over the whole section (shear moves along the next axis: y for
    x, z for y, x for z). bar: the fundamental longitudinal mode of a bar with free sides.
    """

    axis: Axis = Field(description="direction of travel, towards larger coordinates")
    kind: Literal["longitudinal", "shear", "bar"] = Field(
        default="longitudinal", description="plane waves, or the mode of a bar with free sides"
    )
    wavelength: Positive = Field(
        description="where the strain's spectrum peaks, m: 2 pi times the Gaussian's deviation"
    )
    amplitude: Annotated[Real, Field(gt=0, le=0.01)] = Field(
        default=1e-6, description="largest strain along the axis"
    )
    position: Real = Field(description="of its middle along the axis at t = 0, m")
    probes: tuple[Real, Real] = Field(description="two positions along the axis, m")


class Supports(_Table):
    """Two fixed rigid cylinders under the plate, axes along y, at x = +-span/2; no friction."""

    span: Positive = Field(description="between the two axes, m")
    diameter: Positive = Field(description="of both cylinders, m")


class Solver(_Table):
    """Time integration and the machine."""

    duration: Positive = Field(description="s")
    time_step: float | Literal["auto"] = Field(
        default="auto", description="s, or 'auto': safety times the critical time step"
    )
    safety: Annotated[Real, Field(ge=0.01, le=1)] = 0.5
    allow_unstable: Flag = Field(
        default=False, description="allow a time step above the critical one"
    )
    damping: NonNegative = Field(default=0.0, description="alpha of C = alpha M, 1/s")
    precision: Literal["f64", "f32"] = "f64"
    arch: Literal["cpu", "cuda", "vulkan", "metal", "gpu"] = "cpu"
    threads: Annotated[int, Field(strict=True, ge=1, le=1024)] | None = Field(
        default=None, description="CPU threads; absent: all cores"
    )

    @field_validator("time_step", mode="before")
    @classmethod
    def _step(cls, value: object) -> object:
        # a union would report one error per member
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if value == "auto" or (number and 0 < value <= sys.float_info.max):  # type: ignore[operator]
            return value
        raise _refuse("solver.time_step", value, 'must be a number of seconds above 0 or "auto"')

    @model_validator(mode="after")
    def _check(self) -> "Solver":
        if self.time_step != "auto":
            if self.time_step >= self.duration:
                why = f"must be smaller than solver.duration = {self.duration!r}"
                raise _refuse("solver.time_step", self.time_step, why)
            if not self.duration / self.time_step <= MAX_STEPS:
                why = f"must give at most {MAX_STEPS:.0e} steps in {self.duration!r} s"
                raise _refuse("solver.time_step", self.time_step, why)
        if self.arch == "metal" and self.precision == "f64":
            raise _refuse("solver.precision", self.precision, 'arch "metal" has no f64, use "f32"')
        return self


class Output(_Table):
    """What is written, and when."""

    history_interval: Positive = Field(default=1e-5, description="between rows of history.csv, s")
    field_interval: NonNegative | None = Field(
        default=None,
        description="between stored fields, s; 0: only the first and the last state;"
        " default: a tenth of the duration, not below history_interval",
    )
    image_times: tuple[NonNegative, ...] = Field(default=(), description="of the snapshots, s")
    filter_frequencies: tuple[Positive, ...] = Field(
        default=(), description="cut-offs of the low-pass filtered force in the force figure, Hz"
    )
    checkpoint_interval: NonNegative = Field(
        default=300.0, description="between checkpoints, seconds of wall time; 0: none at all"
    )


class Notch(_Table):
    """A plane of cut bars: a rectangle normal to an axis. Its bars are removed, not broken."""

    normal: Axis = Field(description="axis that the plane is normal to")
    position: Real = Field(description="of the plane along its normal, m")
    from_: tuple[Real, Real] = Field(  # `from` is a keyword
        alias="from", description="one corner: the other two coordinates in the order x, y, z, m"
    )
    to: tuple[Real, Real] = Field(description="the opposite corner, m")

    @property
    def axes(self) -> tuple[int, int, int]:
        """Numbers of the axes (0 = x): the normal, then the two of `from_` and `to`."""
        normal = "xyz".index(self.normal)
        first, second = (axis for axis in range(3) if axis != normal)
        return normal, first, second

    @property
    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Sorted (lower, upper) limits of the rectangle along its two axes, m."""
        (a, b), (c, d) = zip(self.from_, self.to, strict=True)
        return (min(a, b), max(a, b)), (min(c, d), max(c, d))


class Modes(_Table):
    """What `ldem modes` computes."""

    count: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(
        default=18, description="number of modes, from the lowest"
    )


class Scene(_Table):
    """A complete scene. A table that is left out (None) is a feature that is left out."""

    scenario: Literal["impact", "tension", "bend", "wave", "modes"]
    plate: Plate
    material: Material
    disorder: Disorder | None = None
    striker: Striker | None = None
    clamp: Clamp | None = None
    grips: Grips | None = None
    pulse: Pulse | None = None
    supports: Supports | None = None
    solver: Solver
    output: Output = Output()
    notch: tuple[Notch, ...] = ()
    modes: Modes | None = None

    @model_validator(mode="before")
    @classmethod
    def _no_time(cls, data: Any) -> Any:
        # natural frequencies need no end time: any will do
        if isinstance(data, Mapping) and data.get("scenario") == "modes":
            solver = data.get("solver", {})
            if isinstance(solver, Mapping):
                return {**data, "solver": {"duration": NO_DURATION, **solver}}
        return data

    @classmethod
    def load(cls, path: str | Path, *overrides: str) -> "Scene":
        """Read a scene file and override keys, "section.key=value" each, as ``--set`` does.

        Raises:
            SceneError: file, an override or a value is not acceptable; one line.
        """
        return load_scene(path, overrides)

    def changed(self, *overrides: str) -> "Scene":
        """The scene with other values, "section.key=value" each, as ``--set`` takes them.

        Raises:
            SceneError: an override or a value is not acceptable; one line.
        """
        return _changed(self, overrides)

    @property
    def held(self) -> bool:
        """Whether anything holds the plate."""
        return self.clamp is not None and self.clamp.kind != "free"

    @property
    def field_times(self) -> tuple[float, ...]:
        """Sorted times at which fields are stored: start, every interval, image times, end; s."""
        end, interval = self.solver.duration, self.output.field_interval or 0.0
        count = math.floor(end / interval * (1 + 1e-12)) if interval > 0 else 0
        times = {min(end, n * interval) for n in range(count + 1)}
        return tuple(sorted(times | {end, *self.output.image_times}))

    @model_validator(mode="after")
    def _check(self) -> "Scene":
        self._check_sides()
        self._check_disorder()
        self._check_clamp()
        self._check_striker()
        self._check_tension()
        self._check_pulse()
        self._check_supports()
        self._check_output()
        self._check_vulkan()
        for number, notch in enumerate(self.notch):
            self._check_notch(f"notch[{number}]", notch)
        if self.output.field_interval is None:
            # resolved here, once: the default depends on another table
            output = self.output.model_copy(update={"field_interval": self._field_interval})
            object.__setattr__(self, "output", output)
        return self

    def _check_sides(self) -> None:
        plate, spacing = self.plate, self.plate.spacing
        for axis, side, actual in zip("xy", plate.size, plate.actual_size, strict=False):
            if plate.angle or abs(actual - side) <= ROUNDING * side:
                continue
            if self.scenario != "modes":  # which has no damage
                from taichi_ldem.model.material import check

                check(self)  # before sides are fitted to modules that are too coarse
            below = math.floor(side / spacing)
            fits = " or ".join(f"{n * spacing:.6g}" for n in (below, below + 1) if n > 0)
            why = f"side {axis} must be a whole number of modules of {spacing:.6g} m: {fits}"
            raise _refuse("plate.size", plate.size, why)

    def _check_disorder(self) -> None:
        length = self.disorder.correlation_length if self.disorder is not None else 0.0
        if 0 < length < self.plate.spacing:
            why = f"must be at least {self.plate.spacing:.6g}, one module, or 0: none"
            raise _refuse("disorder.correlation_length", length, why)

    def _check_vulkan(self) -> None:
        solver, law = self.solver, self.material.law
        if (solver.arch, solver.precision, law) == ("vulkan", "f64", "exponential"):
            why = 'Vulkan has no exp in f64, use "bilinear" or solver.precision = "f32"'
            raise _refuse("material.law", law, why)

    @property
    def _field_interval(self) -> float:
        return max(self.solver.duration / 10, self.output.history_interval)

    def _check_clamp(self) -> None:
        if self.clamp is None or self.clamp.kind == "free":
            return
        key = "inner_diameter" if self.clamp.kind == "rim" else "outer_diameter"
        diameter = getattr(self.clamp, key)
        width = self.plate.diameter or self.plate.width
        if diameter > width:
            why = f"must fit inside the plate, at most {width!r}"
            raise _refuse(f"clamp.{key}", diameter, why)

    def _check_striker(self) -> None:
        if self.striker is None:
            return
        place, diameter = self.striker.position, self.striker.diameter
        if not self.plate.covers(*place):
            why = "must be over the plate, in metres from its centre"
            raise _refuse("striker.position", place, why)
        if self.clamp is None or self.clamp.kind == "free":
            return
        inner = self.clamp.inner_diameter
        assert inner is not None
        if diameter >= inner:
            why = f"must be smaller than clamp.inner_diameter = {inner!r}"
            raise _refuse("striker.diameter", diameter, why)
        if math.hypot(*place) + diameter / 2 >= inner / 2:
            why = f"the striker must stay inside clamp.inner_diameter = {inner!r}"
            raise _refuse("striker.position", place, why)

    def _check_tension(self) -> None:
        pulled = self.scenario == "tension"
        for key in ("striker", "clamp") if pulled else ("grips",):
            if getattr(self, key) is not None:
                raise _refuse("scenario", self.scenario, f"has no table [{key}]")
        if not pulled:
            if self.plate.angle:
                raise _refuse("plate.angle", self.plate.angle, 'only for scenario = "tension"')
            return
        if self.grips is None:
            raise ValueError("missing table '[grips]' (scenario = \"tension\")")
        grips, spacing = self.grips, self.plate.spacing
        between = self.plate.size[0] - 2 * grips.length
        if between < 2 * spacing:
            longest = self.plate.size[0] / 2 - spacing
            why = f"must be at most {longest:.6g}, which leaves two modules between the grips"
            raise _refuse("grips.length", grips.length, why)
        gauge = self._gauge_length if grips.gauge_length is None else grips.gauge_length
        if not 2 * spacing * (1 - ROUNDING) <= gauge <= between * (1 + ROUNDING):
            why = f"must lie between two modules, {2 * spacing:.6g}, and the grips, {between:.6g}"
            raise _refuse("grips.gauge_length", gauge, why)
        # resolved here, once: the default depends on another table
        object.__setattr__(self, "grips", grips.model_copy(update={"gauge_length": gauge}))

    @property
    def _gauge_length(self) -> float:
        assert self.grips is not None
        between = self.plate.size[0] - 2 * self.grips.length
        return max(between / 2, 2 * self.plate.spacing)

    def _check_pulse(self) -> None:
        pulse = self.pulse
        if pulse is None:
            if self.scenario == "wave":
                raise ValueError("missing table '[pulse]' (scenario = \"wave\")")
            return
        if self.scenario != "wave":
            raise _refuse("scenario", self.scenario, 'must be "wave" with a table [pulse]')
        self._check_alone()
        shortest = 4 * self.plate.spacing
        if pulse.wavelength < shortest:
            why = f"must be at least {shortest:.6g}, four modules"
            raise _refuse("pulse.wavelength", pulse.wavelength, why)
        axis = "xyz".index(pulse.axis)
        side = self.plate.actual_size[axis]
        low, high = (0.0, side) if axis == 2 else (-side / 2, side / 2)
        if not low <= pulse.position < pulse.probes[0] < pulse.probes[1] <= high:
            places = (pulse.position, *pulse.probes)
            why = f"position and probes must rise between {low:.6g} and {high:.6g}, not {places}"
            raise _refuse("pulse.probes", pulse.probes, why)

    def _check_alone(self) -> None:
        """A pulse runs through a free prism."""
        if self.plate.shape != "rectangle":
            raise _refuse("plate.shape", self.plate.shape, 'must be "rectangle" with [pulse]')
        if self.plate.perturbation:
            why = "must be 0 with [pulse]: waves are compared with those of a regular lattice"
            raise _refuse("plate.perturbation", self.plate.perturbation, why)
        for name, present in (
            ("disorder", self.disorder),
            ("striker", self.striker),
            ("clamp", self.held),
            ("supports", self.supports),
            ("notch", self.notch),
        ):
            if present:
                raise ValueError(f"table '[{name}]': a pulse runs through a free, uniform prism")

    def _check_supports(self) -> None:
        if self.scenario == "bend":
            for key in ("striker", "supports"):
                if getattr(self, key) is None:
                    raise ValueError(f"missing table '[{key}]' (scenario = \"bend\")")
            if self.held:
                assert self.clamp is not None
                why = 'must be "free" or absent with scenario = "bend": the beam lies on [supports]'
                raise _refuse("clamp.kind", self.clamp.kind, why)
        if self.supports is None:
            return
        length = self.plate.size[0]
        if self.supports.span > length:
            why = f"must be at most {length!r}, the plate's side x"
            raise _refuse("supports.span", self.supports.span, why)
        if self.supports.diameter > self.supports.span:
            why = f"must be at most supports.span = {self.supports.span!r}"
            raise _refuse("supports.diameter", self.supports.diameter, why)

    def _check_output(self) -> None:
        end, output = self.solver.duration, self.output
        for key, limit in (("history_interval", MAX_SAMPLES), ("field_interval", MAX_FRAMES)):
            interval = getattr(output, key)
            if not interval:
                continue
            if interval > end:
                why = f"must be at most solver.duration = {end!r}"
                raise _refuse(f"output.{key}", interval, why)
            if not end / interval <= limit:
                why = f"must be at least {end / limit:.6g}: {limit} intervals in solver.duration"
                raise _refuse(f"output.{key}", interval, why)
        if output.field_interval and output.field_interval < output.history_interval:
            why = f"must be at least output.history_interval = {output.history_interval!r}, or 0"
            raise _refuse("output.field_interval", output.field_interval, why)
        nyquist = 0.5 / output.history_interval
        for cutoff in output.filter_frequencies:
            if cutoff >= nyquist:
                why = f"must be below {nyquist:.6g}, half of 1 / output.history_interval"
                raise _refuse("output.filter_frequencies", cutoff, why)
        for time in output.image_times:
            if time > end:
                why = (
                    f"must lie between 0 and solver.duration = {end!r}; without snapshots: "
                    '--set "output.image_times=[]"'
                )
                raise _refuse("output.image_times", time, why)

    def _check_notch(self, key: str, notch: Notch) -> None:
        x, y, z = self.plate.size
        limits = ((-x / 2, x / 2), (-y / 2, y / 2), (0.0, z))
        normal, *axes = notch.axes
        lower, upper = limits[normal]
        if not lower < notch.position < upper:
            why = f"must lie inside the plate, between {lower!r} and {upper!r}"
            raise _refuse(f"{key}.position", notch.position, why)
        for axis, (start, stop) in zip(axes, notch.bounds, strict=True):
            lower, upper = limits[axis]
            if not start < stop:
                why = f"must differ from {key}.from along {'xyz'[axis]}"
                raise _refuse(f"{key}.to", notch.to, why)
            if stop <= lower or start >= upper:
                why = f"must cut the plate, which has {'xyz'[axis]} from {lower!r} to {upper!r}"
                raise _refuse(f"{key}.to", notch.to, why)


# --- reading and writing --------------------------------------------------------------------------

# An override of one replaces the other.
EXCLUSIVE: dict[tuple[str, ...], str] = {
    ("material", "failure_strain"): "failure_factor",
    ("material", "failure_factor"): "failure_strain",
    **{("disorder", f"{name}_cv"): f"{name}_data" for name in DISORDERED},
    **{("disorder", f"{name}_data"): f"{name}_cv" for name in DISORDERED},
}


class _Override(NamedTuple):
    path: tuple[str, ...]
    value: object


def load_scene(path: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read a scene file, apply `section.key=value` overrides in order, and validate.

    Values of overrides are TOML values; bare words are taken as strings. An override of
    material.failure_strain replaces the file's failure_factor, and the other way round.

    Raises:
        SceneError: file, an override or a value is not acceptable; one line.
    """
    path = Path(path)
    return _overridden(_read(path), path.name, overrides)


def load_tables(path: str | Path, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """The tables of a scene file with overrides, not validated; else as `load_scene`."""
    return _changed_tables(_read(Path(path)), [_parse_override(text) for text in overrides])


def override_value(text: str) -> object:
    """The value of an override `section.key=value`; SceneError as `load_scene`."""
    return _parse_override(text).value


def _changed_tables(data: dict[str, Any], changes: "Sequence[_Override]") -> dict[str, Any]:
    for change in changes:
        _apply(data, change)
    return data


def _overridden(data: dict[str, Any], name: str, overrides: Sequence[str]) -> Scene:
    changes = [_parse_override(text) for text in overrides]
    keys = {".".join(change.path) for change in changes}
    return parse_scene(_changed_tables(data, changes), name, keys)


def _changed(scene: Scene, overrides: Sequence[str]) -> Scene:
    data = scene.model_dump(by_alias=True, exclude_none=True)
    # defaults that hang on other keys follow these
    if scene.output.field_interval == scene._field_interval:
        del data["output"]["field_interval"]
    if scene.grips is not None and scene.grips.gauge_length == scene._gauge_length:
        del data["grips"]["gauge_length"]
    return _overridden(data, "scene", overrides)


def parse_scene(
    data: Mapping[str, Any],
    name: str = "scene",
    overridden: Collection[str] = (),
) -> Scene:
    """Validate tables as TOML gives them; `name` opens the message of errors.

    Keys in `overridden` ("section.key") came from the command line, which the message says.

    Raises:
        SceneError: one line for the first fault; unknown keys come before wrong values.
    """
    try:
        return Scene.model_validate(data)
    except ValidationError as error:
        # a misspelt key also shows up as a missing one: name the cause, not the consequence
        faults = sorted(error.errors(), key=lambda fault: fault["type"] != "extra_forbidden")
        message = _explain(faults[0], data)
        if any(
            message.startswith((f"{key} =", f"{key}[", f"unknown key '{key}'"))
            for key in overridden
        ):
            name = "command line"
        raise SceneError(f"{name}: {message}") from None


def parse_scene_text(text: str, name: str) -> Scene:
    """A scene from TOML text; `name` opens the message of errors, SceneError as `load_scene`."""
    return parse_scene(_toml(text.encode(), name), name)


def scene_to_toml(scene: Scene) -> str:
    """The resolved scene, defaults included, as TOML that `load_scene` reads to an equal Scene."""
    data = scene.model_dump(by_alias=True, exclude_none=True)
    if not scene.notch:
        del data["notch"]
    return "# Resolved scene, SI units, defaults included.\n" + tomli_w.dumps(data)


def _read(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            content = file.read(MAX_FILE_BYTES + 1)
    except FileNotFoundError:
        raise SceneError(f"{path}: no such scene file") from None
    except IsADirectoryError:
        raise SceneError(f"{path}: is a directory, not a scene file") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SceneError(f"{path}: cannot be read: {reason}") from None
    if len(content) > MAX_FILE_BYTES:
        raise SceneError(f"{path}: larger than {MAX_FILE_BYTES >> 20} MiB, no scene")
    return _toml(content, path.name)


def _toml(content: bytes, name: str) -> dict[str, Any]:
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise SceneError(f"{name}: line {line} is not UTF-8 text") from None
    except (ValueError, RecursionError) as error:  # ValueError: also an integer of 5000 digits
        reason = "nested too deeply" if isinstance(error, RecursionError) else error
        raise SceneError(f"{name}: not valid TOML: {reason}") from None


def _parse_override(text: str) -> _Override:
    key, equals, value = (part.strip() for part in text.partition("="))
    path = tuple(key.split("."))
    if not equals or not all(path) or len(path) > 2 or (len(path) == 1 and key != "scenario"):
        raise SceneError(f"--set {text}: must be section.key=value")
    if len(path) == 2 and path[0] not in Scene.model_fields:
        hint = _nearest(path[0], _tables())
        raise SceneError(f"--set {text}: unknown section '{path[0]}'; {hint}")
    return _Override(path, _parse_value(text, value))


def _parse_value(text: str, value: str) -> object:
    try:
        parsed = tomllib.loads(f"value = {value}")
        if parsed.keys() == {"value"}:
            return parsed["value"]
    except (ValueError, RecursionError):
        if value[:1].isalpha() and value.replace("-", "").replace("_", "").isalnum():
            return value
    raise SceneError(f"--set {text}: the value is neither TOML nor a bare word")


def _apply(data: dict[str, Any], change: _Override) -> None:
    table = data
    for section in change.path[:-1]:
        table = table.setdefault(section, {})
        if not isinstance(table, dict):
            raise SceneError(f"--set {'.'.join(change.path)}: '{section}' is not a single table")
    table[change.path[-1]] = change.value
    table.pop(EXCLUSIVE.get(change.path, ""), None)


def _tables() -> list[str]:
    return [name for name in Scene.model_fields if name not in ("scenario", "notch")]


# --- messages -------------------------------------------------------------------------------------

NATURAL = {
    "thickness": "plate.size = [x, y, thickness]",
    "height": "plate.size = [x, y, thickness]",
    "width": "plate.size = [x, width, thickness]",
    "length": "plate.size = [length, y, thickness]",
    "modules": "plate.modules_through_thickness",
    "module_size": "plate.modules_through_thickness (the edge is the thickness over it)",
    "spacing": "plate.modules_through_thickness (the edge is the thickness over it)",
    "e": "material.youngs_modulus",
    "modulus": "material.youngs_modulus",
    "nu": "material.poisson_ratio",
    "rho": "material.density",
    "g_f": "material.fracture_energy",
    "gf": "material.fracture_energy",
    "r_f": "material.failure_factor",
    "eps_p": "material.failure_strain",
    "eps_r": "material.limit_strain",
    "strength": "material.failure_strain (strength over youngs_modulus)",
    "speed": "striker.velocity",
    "radius": "a diameter, twice the radius",
    "g": "striker.gravity",
    "dt": "solver.time_step",
    "end": "solver.duration",
    "end_time": "solver.duration",
    "time": "solver.duration",
}
"""What a key is called by those who do not know its name, and what stands for it."""


def key_for(word: str) -> str | None:
    """The key of a scene, "section.key", that an option of this name was most likely meant for."""
    name = word.lstrip("-").replace("-", "_").lower()
    meant = NATURAL.get(name, "").partition(" ")[0]
    if meant.count("."):
        return meant
    for table in _tables():
        if name in _table_at((table,)).model_fields:
            return f"{table}.{name}"
    return None


def _explain(fault: ErrorDetails, data: object) -> str:
    """One pydantic error as one line: key, value, and what would be right."""
    kind, location = fault["type"], fault["loc"]
    key = _key(location)
    if kind == "value_error":  # a check of our own, complete already
        return str(fault["ctx"]["error"])
    if kind == "extra_forbidden":
        return _unknown(location)
    if kind == "missing":
        return _missing(location, data)
    value = fault["input"]
    return f"{key} = {_show(value)}: {_wish(fault, location)}"


def _unknown(location: tuple[int | str, ...]) -> str:
    key = _key(location)
    table = _table_at(location[:-1])
    names = [field.alias or name for name, field in table.model_fields.items()]
    word = str(location[-1])
    meant = NATURAL.get(word.lower()) if word not in names else None
    return f"unknown key '{key}'; {f'give {meant}' if meant else _nearest(word, names)}"


def _missing(location: tuple[int | str, ...], data: object) -> str:
    if isinstance(location[-1], int):  # an element of a tuple
        value: Any = data
        for step in location[:-1]:
            value = value[step]
        return f"{_key(location[:-1])} = {_show(value)}: must be a list of {_length(location)}"
    if len(location) == 1 and location[0] in _tables():
        return f"missing table '[{location[0]}]'"
    return f"missing key '{_key(location)}'"


def _wish(fault: ErrorDetails, location: tuple[int | str, ...]) -> str:
    context = fault.get("ctx", {})
    plain = {
        "float_type": "must be a number",
        "int_type": "must be a whole number",
        "bool_type": "must be true or false",
        "finite_number": "must be a finite number",
        "model_type": "must be a table",
        "model_attributes_type": "must be a table",
        "literal_error": f"must be {context.get('expected', '').replace(chr(39), chr(34))}",
        "greater_than": f"must be greater than {context.get('gt')}",
        "greater_than_equal": f"must be at least {context.get('ge')}",
        "less_than": f"must be less than {context.get('lt')}",
        "less_than_equal": f"must be at most {context.get('le')}",
    }
    if fault["type"] in ("tuple_type", "too_long"):
        return f"must be a list of {_length((*location, 0))}"
    return plain.get(fault["type"], fault["msg"].replace("Input should", "must"))


def _length(location: tuple[int | str, ...]) -> str:
    """What the list that holds the element at `location` consists of."""
    name = location[-2]
    if name == "notch":
        return "tables"
    for field_name, field in _table_at(location[:-2]).model_fields.items():
        if name in (field_name, field.alias):
            members: tuple[Any, ...] = getattr(field.annotation, "__args__", ())
            if type(None) in members:  # a list that may be absent
                members = getattr(members[0], "__args__", ())
            return "numbers" if Ellipsis in members else f"{len(members)} numbers"
    return "numbers"


def _table_at(location: tuple[int | str, ...]) -> type[_Table]:
    tables: dict[int | str, type[_Table]] = {
        "plate": Plate,
        "material": Material,
        "disorder": Disorder,
        "striker": Striker,
        "clamp": Clamp,
        "grips": Grips,
        "pulse": Pulse,
        "supports": Supports,
        "solver": Solver,
        "output": Output,
        "notch": Notch,
        "modes": Modes,
    }
    return tables[location[0]] if location else Scene


def _nearest(word: str, names: list[str]) -> str:
    near = difflib.get_close_matches(word[:100], names, n=1)
    return f"did you mean '{near[0]}'?" if near else f"known: {', '.join(names)}"


def _key(location: tuple[int | str, ...]) -> str:
    parts = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in location)
    return "".join(parts).removeprefix(".")


def _show(value: object) -> str:
    """A value as TOML would write it, on one line and not longer than a line."""
    text = "".join(itertools.islice(_pieces(value), 64))
    return text if len(text) <= 64 else f"{text[:60]} ..."


def _pieces(value: object) -> Iterator[str]:
    if isinstance(value, dict):
        yield "a table"
    elif isinstance(value, list | tuple):
        yield "["
        for number, item in enumerate(value):
            yield ", " if number else ""
            yield from _pieces(item)
        yield "]"
    elif isinstance(value, bool | str):
        yield json.dumps(value)  # escapes line breaks
    elif isinstance(value, int) and value.bit_length() > 256:
        yield "an integer of hundreds of digits"  # repr of such integers may raise
    else:
        yield str(value)
