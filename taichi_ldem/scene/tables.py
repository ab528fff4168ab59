"""Tables of a scene, apart from those of the specimen and of the rigid bodies.

Attribute names are the TOML keys. Everything is in SI units. Coordinates: the plate is centred at
x = y = 0, its bottom face is z = 0 and its top face z = H; the striker comes from above. A table
checks what it can check alone; ``checks`` compares tables with each other.
"""

import math
import sys
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from taichi_ldem.scene.names import LAW_NAMES
from taichi_ldem.scene.values import (
    Axis,
    Flag,
    NonNegative,
    OneOf,
    Positive,
    Real,
    Seed,
    Table,
    refuse,
)

MAX_STEPS = 10**12
LARGEST_CV = 1.5
FEWEST_DATA = 3  # values that a distribution can be fitted to
DISORDERED = ("fracture_energy", "youngs_modulus", "density", "strength")
"""Properties that may vary, in the order of their random streams: never reorder."""


Quantity = Literal["strain", "stress", "principal_stress", "damage"]
"""What fields.vtkhdf can hold of every module."""

LawName = Annotated[str, BeforeValidator(OneOf(LAW_NAMES))]


class Material(Table):
    """Elasticity and fracture. With `damage = false` the fracture keys are not needed."""

    youngs_modulus: Positive = Field(description="Young's modulus E, Pa")
    poisson_ratio: Annotated[Real, Field(ge=0, lt=0.5)] = Field(
        description="Poisson's ratio nu; bars alone are isotropic at 0.25 only (see"
        " plate.stiffness)"
    )
    density: Positive = Field(description="mass density, kg/m3")
    fracture_energy: Positive | None = Field(default=None, description="fracture energy G_f, J/m2")
    failure_factor: Positive | None = Field(
        default=None,
        description="failure factor R_f, m^-1/2, from which eps_p = R_f sqrt(G_f / E) (Eq. (9))",
    )
    failure_strain: Annotated[Real, Field(gt=0, lt=1)] | None = Field(
        default=None,
        description="strain eps_p at the largest force of a bar, instead of failure_factor: the"
        " strength measured in tension over youngs_modulus",
    )
    limit_strain: Positive | None = Field(
        default=None,
        description="strain eps_r at which a bar fails, instead of that of Eqs. (11), (12)",
    )
    law: LawName = Field(
        default="bilinear",
        description="softening law of a bar; a law that a program registers also counts",
    )
    damage: Flag = Field(default=True, description="whether bars soften and fail")
    fracture: Literal["bar", "crack"] = Field(
        default="bar",
        description="when a bar fails: when its own strain says so, or also at the tip of a crack"
        " when its failure would release G_f per area",
    )
    tip_criterion: Literal["release", "strain"] = Field(
        default="release",
        description='which bars fail at the tip of a crack, with fracture = "crack": those whose'
        " failure would release G_f per area by the opening of the crack next to them, or those"
        " that reach the tip strain of their family, which follows from G_f, youngs_modulus and"
        " the module edge. 'strain' is for a lattice with plate.perturbation",
    )
    after_failure: Literal["gone", "closing"] = Field(
        default="gone",
        description="what a failed bar carries: nothing, or compression where its ends are closer"
        " than at rest, like the faces of a crack that closes",
    )
    crack_opening: Literal["free", "viscous"] = Field(
        default="free",
        description='how the faces of a crack part at its tip, with fracture = "crack": freely, or'
        " against the material's acoustic impedance, which takes the energy that would become"
        " waves",
    )
    fracture_areas: Literal["derived", "paper"] = Field(
        default="derived",
        description="fracture areas of the two bar families: derived, or printed in Eqs. (7), (8)",
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
            why = "cannot be given together with material.failure_factor; give one of the two"
            raise refuse("material.failure_strain", self.failure_strain, why)
        if self.crack_opening == "viscous" and self.fracture != "crack":
            why = 'must be "free", unless material.fracture = "crack"'
            raise refuse("material.crack_opening", self.crack_opening, why)
        if self.tip_criterion == "strain" and self.fracture != "crack":
            why = 'must be "release", unless material.fracture = "crack"'
            raise refuse("material.tip_criterion", self.tip_criterion, why)
        strain = self.failure_strain
        if self.limit_strain is not None and strain is not None and self.limit_strain < strain:
            why = f"must be at least material.failure_strain = {strain!r}"
            raise refuse("material.limit_strain", self.limit_strain, why)
        if self.failure_factor is not None:
            derived = self.failure_factor * math.sqrt(self.fracture_energy / self.youngs_modulus)
            if derived >= 1:
                why = (
                    f"gives a peak strain eps_p = R_f sqrt(G_f / E) = {derived:.4g}, which must be "
                    "less than 1; give SI units: E in Pa, G_f in J/m2, R_f in m^-1/2"
                )
                raise refuse("material.youngs_modulus", self.youngs_modulus, why)
        return self


Cv = Annotated[Real, Field(ge=0, le=LARGEST_CV)]


class Disorder(Table):
    """Random material: Weibull fields around the means that [material] gives, Eqs. (14) to (17).

    Each property takes either its coefficient of variation (CV) or a list of measured values, to
    which the Weibull shape is fitted by maximum likelihood; their mean is not used. A CV of 0 means
    that the property does not vary.
    """

    fracture_energy_cv: Cv | None = Field(
        default=None, description="coefficient of variation of each bar's G_f"
    )
    youngs_modulus_cv: Cv | None = Field(
        default=None, description="coefficient of variation of each bar's E"
    )
    density_cv: Cv | None = Field(
        default=None, description="coefficient of variation of each module's density"
    )
    strength_cv: Cv | None = Field(
        default=None,
        description="coefficient of variation of each bar's eps_p, with G_f the same everywhere",
    )
    fracture_energy_data: tuple[Positive, ...] | None = Field(
        default=None,
        description="measured values of G_f in any one unit, instead of fracture_energy_cv",
    )
    youngs_modulus_data: tuple[Positive, ...] | None = Field(
        default=None,
        description="measured values of E in any one unit, instead of youngs_modulus_cv",
    )
    density_data: tuple[Positive, ...] | None = Field(
        default=None,
        description="measured values of the density in any one unit, instead of density_cv",
    )
    strength_data: tuple[Positive, ...] | None = Field(
        default=None,
        description="measured strengths in any one unit, instead of strength_cv",
    )
    reference_volume: Positive | None = Field(
        default=None,
        description="volume under tension of the specimens that have the mean strength E eps_p and"
        " its scatter, m3; each bar is stronger, by its own volume (weakest link)",
    )
    correlation_length: NonNegative = Field(
        default=0.0,
        description="distance at which the correlation of the underlying Gaussian field is 1/e, m;"
        " 0: bars vary independently of each other, so results depend on the module edge",
    )
    seed: Seed = Field(default=0, description="seed of the random fields")

    @model_validator(mode="after")
    def _check(self) -> "Disorder":
        named = False
        for name in DISORDERED:
            cv, data = getattr(self, f"{name}_cv"), getattr(self, f"{name}_data")
            named |= cv is not None or data is not None
            if data is None:
                continue
            if cv is not None:
                why = f"cannot be given together with disorder.{name}_data; give one of the two"
                raise refuse(f"disorder.{name}_cv", cv, why)
            if len(data) < FEWEST_DATA or max(data) - min(data) <= 1e-9 * max(data):
                why = f"must be at least {FEWEST_DATA} values that differ"
                raise refuse(f"disorder.{name}_data", data, why)
        if not named:
            keys = ", ".join(f"'disorder.{name}_cv'" for name in DISORDERED)
            raise ValueError(
                f"table '[disorder]' names no property that varies; give one of {keys}"
            )
        self._check_strength()
        return self

    def _check_strength(self) -> None:
        """Refuse what does not go together with strengths of their own."""
        strength = bool(self.strength_cv) or self.strength_data is not None
        for name in ("fracture_energy", "youngs_modulus"):
            for key in (f"{name}_cv", f"{name}_data"):
                if strength and getattr(self, key):
                    why = "cannot vary together with disorder.strength; give one of the two"
                    raise refuse(f"disorder.{key}", getattr(self, key), why)
        if self.reference_volume is None:
            return
        if not strength:
            why = "needs disorder.strength_cv > 0 or disorder.strength_data"
            raise refuse("disorder.reference_volume", self.reference_volume, why)
        if self.correlation_length > 0:
            why = "must be 0 with disorder.reference_volume: bars are taken to be independent"
            raise refuse("disorder.correlation_length", self.correlation_length, why)


class Pulse(Table):
    """A wave that travels along an axis from t = 0 on. Its displacement is a Gaussian.

    longitudinal, shear: a plane wave over the whole section (shear moves along the next axis: y for
    x, z for y, x for z). bar: the fundamental longitudinal mode of a bar with free sides.
    """

    axis: Axis = Field(description="direction of travel, towards larger coordinates")
    kind: Literal["longitudinal", "shear", "bar"] = Field(
        default="longitudinal",
        description="kind of wave: a plane wave, or the mode of a bar with free sides",
    )
    wavelength: Positive = Field(
        description="wavelength at which the spectrum of the strain is largest, m; it is 2 pi times"
        " the Gaussian's standard deviation"
    )
    amplitude: Annotated[Real, Field(gt=0, le=0.01)] = Field(
        default=1e-6, description="largest strain of the pulse along the axis"
    )
    position: Real = Field(description="position of the pulse's middle along the axis at t = 0, m")
    probes: tuple[Real, Real] = Field(
        description="positions along the axis at which the wave is recorded, m"
    )


SAFETY, SAFETY_OF_PIECES = 0.9, 0.5
"""``solver.safety`` where a scene does not name it: without and with pieces that touch, which raise
the highest frequency."""


class Solver(Table):
    """Time integration, and the machine that it runs on."""

    duration: Positive = Field(description="simulated time, s")
    time_step: float | Literal["auto"] = Field(
        default="auto", description="time step, s; 'auto': safety times the critical time step"
    )
    safety: Annotated[Real, Field(ge=0.01, le=1)] = Field(
        default=SAFETY,
        description="share of the critical time step that time_step = 'auto' takes; 0.5 where "
        "pieces touch (contact.fragments), unless given",
    )
    allow_unstable: Flag = Field(
        default=False, description="whether the time step may be above the critical one"
    )
    damping: NonNegative = Field(
        default=0.0, description="factor alpha of the mass-proportional damping C = alpha M, 1/s"
    )
    precision: Literal["f64", "f32"] = Field(
        default="f64", description="floating-point numbers of the nodes and bars: double or single"
    )
    arch: Literal["cpu", "cuda", "vulkan", "metal", "gpu"] = Field(
        default="cpu", description="device that the kernels run on; 'gpu' is 'cuda'"
    )
    threads: Annotated[int, Field(strict=True, ge=1, le=1024)] | None = Field(
        default=None, description="number of CPU threads; without it, one for each core"
    )

    @field_validator("time_step", mode="before")
    @classmethod
    def _step(cls, value: object) -> object:
        # a union would report one error per member
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if value == "auto" or (number and 0 < value <= sys.float_info.max):  # type: ignore[operator]
            return value
        raise refuse("solver.time_step", value, 'must be a number of seconds above 0 or "auto"')

    @model_validator(mode="after")
    def _check(self) -> "Solver":
        if self.time_step != "auto":
            if self.time_step >= self.duration:
                why = f"must be smaller than solver.duration = {self.duration!r}"
                raise refuse("solver.time_step", self.time_step, why)
            if not self.duration / self.time_step <= MAX_STEPS:
                why = f"must give at most {MAX_STEPS:.0e} steps in {self.duration!r} s"
                raise refuse("solver.time_step", self.time_step, why)
        if self.arch == "metal" and self.precision == "f64":
            raise refuse("solver.precision", self.precision, 'arch "metal" has no f64, use "f32"')
        return self


class Output(Table):
    """The files that a run writes, and when it writes them."""

    history_interval: Positive = Field(
        default=1e-5, description="time between rows of history.csv, s"
    )
    field_interval: NonNegative | None = Field(
        default=None,
        description="time between stored fields, s; 0: only the first and last states are stored;"
        " without it, a tenth of the duration, but not below history_interval",
    )
    image_times: tuple[NonNegative, ...] = Field(
        default=(), description="times of the snapshots, s"
    )
    fields: tuple[Quantity, ...] = Field(
        default=(),
        description="quantities of the modules that fields.vtkhdf holds in addition to"
        " displacement, velocity and broken_fraction; principal_stress is the largest",
    )
    fragments: Flag = Field(
        default=False,
        description="whether the pieces of the plate are counted whenever fields are stored:"
        " fragments.csv, and the piece of each module in fields.vtkhdf",
    )
    smoothing_window: Positive | None = Field(
        default=None,
        description="time over which forces are averaged before peaks are read, and in figures, s;"
        " without it, 0.2 ms for the paper's plate and for others in proportion to the period of"
        " their first oscillation (docs/cracks.md)",
    )
    filter_frequencies: tuple[Positive, ...] = Field(
        default=(), description="cut-off frequencies of the filtered forces in the force figure, Hz"
    )
    checkpoint_interval: NonNegative = Field(
        default=300.0,
        description="time between checkpoints, seconds of wall time; 0: no checkpoints",
    )


class Modes(Table):
    """The natural frequencies and mode shapes that `ldem modes` computes."""

    count: Annotated[int, Field(strict=True, ge=1, le=1000)] = Field(
        default=18, description="number of modes, counted from the lowest"
    )
