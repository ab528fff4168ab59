"""The whole scene: what is simulated, as data, checked before anything expensive is imported."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)

from taichi_ldem.errors import SceneError
from taichi_ldem.scene import checks, load, messages, shape_file
from taichi_ldem.scene.bodies import Clamp, Contact, Floor, Grips, Supports
from taichi_ldem.scene.load_rules import LISTED, with_names
from taichi_ldem.scene.load_tables import with_tables
from taichi_ldem.scene.loads import Load, Probe, Start
from taichi_ldem.scene.schema import SINGLE, tables_of
from taichi_ldem.scene.specimen import Hole, Notch, Plate
from taichi_ldem.scene.strikers import Striker
from taichi_ldem.scene.tables import (
    Disorder,
    Material,
    Modes,
    Output,
    Pulse,
    Solver,
)
from taichi_ldem.scene.values import OneOf, Table, plain

ScenarioName = Annotated[str, BeforeValidator(OneOf(checks.SCENARIOS))]


class _OneLine(type(Table)):  # type: ignore[misc]
    """Makes ``Scene(...)`` raise one line, as files of scenes do, not a list of all faults."""

    def __call__(cls, **data: Any) -> Any:
        return parse_scene(data)


def _as_list(value: Any) -> Any:
    """A single table as a list of one."""
    return [value] if isinstance(value, Mapping | Striker) else value


class Scene(Table, metaclass=_OneLine):
    """A complete scene. A table that is left out (None) is a feature that is left out."""

    scenario: ScenarioName = Field(
        description="test that the scene describes: the command that runs it and its summary"
    )
    plate: Plate
    material: Material
    disorder: Disorder | None = None
    strikers: Annotated[tuple[Striker, ...], BeforeValidator(_as_list), SINGLE] = Field(
        default=(), alias="striker"
    )
    clamp: Clamp | None = None
    grips: Grips | None = None
    pulse: Pulse | None = None
    supports: Supports | None = None
    floor: Floor | None = None
    contact: Contact | None = None
    loads: tuple[Load, ...] = Field(default=(), alias="load")  # `Scene.load` reads a file
    start: Start | None = None
    probes: tuple[Probe, ...] = Field(default=(), alias="probe")
    solver: Solver
    output: Output = Output()
    notch: tuple[Notch, ...] = ()
    hole: tuple[Hole, ...] = ()
    modes: Modes | None = None

    @classmethod
    def load(cls, path: str | Path, *overrides: str) -> Scene:
        """Read a scene file and override keys, "section.key=value" each, as ``--set`` does.

        Raises:
            SceneError: file, an override or a value is not acceptable; one line.
        """
        return load_scene(path, overrides)

    def changed(self, *overrides: str) -> Scene:
        """The scene with other values, "section.key=value" each, as ``--set`` takes them.

        Raises:
            SceneError: an override or a value is not acceptable; one line.
        """
        data = self.model_dump(by_alias=True, exclude_none=True)
        # defaults that depend on other keys follow these
        if self.output.field_interval == self.default_field_interval:
            del data["output"]["field_interval"]
        if self.grips is not None and self.grips.gauge_length == self.default_gauge_length:
            del data["grips"]["gauge_length"]
        if self.plate.stiffness == checks.default_stiffness(self.material.poisson_ratio):
            del data["plate"]["stiffness"]
        if self.solver.safety == checks.default_safety(self):
            del data["solver"]["safety"]
        return _overridden(data, "scene", overrides)

    @property
    def striker(self) -> Striker | None:
        """The first striker; None where there is none."""
        return self.strikers[0] if self.strikers else None

    @property
    def is_beam(self) -> bool:
        """Whether the specimen is a beam on two cylinders, which is seen from the side."""
        return self.supports is not None and self.supports.kind == "cylinders"

    @property
    def held(self) -> bool:
        """Whether anything holds the plate."""
        return self.clamp is not None and self.clamp.kind != "free"

    @property
    def lands_elastically(self) -> bool:
        """Whether nodes that land on a rigid body keep their energy."""
        return self.contact is not None and self.contact.landing == "elastic"

    @property
    def field_times(self) -> tuple[float, ...]:
        """Sorted times at which fields are stored: start, every interval, image times, end; s."""
        end, interval = self.solver.duration, self.output.field_interval or 0.0
        count = math.floor(end / interval * (1 + 1e-12)) if interval > 0 else 0
        times = {min(end, n * interval) for n in range(count + 1)}
        return tuple(sorted(times | {end, *self.output.image_times}))

    @property
    def default_field_interval(self) -> float:
        """Interval between stored fields where the scene gives none, s."""
        return max(self.solver.duration / 10, self.output.history_interval)

    @property
    def default_gauge_length(self) -> float | None:
        """Length on which strains are measured where the scene gives none, m; None: no grips."""
        if self.grips is None:
            return None
        between = self.plate.size[0] - 2 * self.grips.length
        return max(between / 2, 2 * self.plate.spacing)

    @model_serializer(mode="wrap")
    def _single_as_table(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """The tables as a file has them: a single striker is a table, and none is left out."""
        data: dict[str, Any] = handler(self)
        for key in ("striker", "strikers"):
            if not data.get(key, True):
                del data[key]
            elif len(data.get(key, ())) == 1:
                data[key] = data[key][0]
        return data

    @model_validator(mode="before")
    @classmethod
    def _with_defaults(cls, data: Any) -> Any:
        return with_names(checks.with_defaults(data))

    @model_validator(mode="after")
    def _check(self) -> Scene:
        checks.check(self)
        # resolved here, once: these defaults depend on other tables
        if self.output.field_interval is None:
            self._resolve("output", field_interval=self.default_field_interval)
        if self.grips is not None and self.grips.gauge_length is None:
            self._resolve("grips", gauge_length=self.default_gauge_length)
        if self.plate.file is not None and self.plate.file_sha256 is None:
            self._resolve("plate", file_sha256=shape_file.digest(shape_file.content(self.plate)))
        return self

    def _resolve(self, table: str, **values: float | str | None) -> None:
        """Put values into a table of the scene, which is frozen for everybody else."""
        object.__setattr__(self, table, getattr(self, table).model_copy(update=values))


TABLES = tables_of(Scene)
"""The tables of a scene by name."""


def load_scene(path: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read a scene file, apply `section.key=value` overrides in order, and validate.

    Values of overrides are TOML values; bare words are taken as strings. An override of
    material.failure_strain replaces the file's failure_factor, and the other way round. One of
    solver.duration leaves out what the file's output has after the new end, with a ``SceneNote``.

    Raises:
        SceneError: file, an override or a value is not acceptable; one line.
    """
    path = Path(path)
    return _overridden(load.read_file(path), path.name, overrides, path.parent)


def load_tables(path: str | Path, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """The tables of a scene file with overrides, not validated; otherwise as `load_scene`."""
    data = load.read_file(Path(path))
    changed = load.apply_overrides(data, load.parse_overrides(overrides, Scene))
    return with_tables(changed, Path(path).parent)


def parse_overrides(texts: Sequence[str]) -> list[load.Override]:
    """Overrides `section.key=value` by key and value; SceneError as `load_scene`."""
    return load.parse_overrides(texts, Scene)


def overridden_tables(
    tables: Mapping[str, Any], overrides: Sequence[load.Override]
) -> dict[str, Any]:
    """A copy of tables with overrides, not validated; otherwise as `load_scene`."""
    return load.apply_overrides(copy.deepcopy(dict(tables)), overrides)


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
        data = {key: plain(value) for key, value in data.items()}
        return Scene.model_validate(data)
    except ValidationError as error:
        # a misspelt key also shows up as a missing one: name the cause, not the consequence
        faults = sorted(error.errors(), key=lambda fault: fault["type"] != "extra_forbidden")
        message = messages.explain(faults[0], data, Scene)
        # --set need not number the only table of its kind
        bare = re.sub(r"^(unknown key ')?(\w+)\[0\]\.", r"\1\2.", message)
        if any(
            text.startswith((f"{key} =", f"{key}[", f"unknown key '{key}'"))
            for key in overridden
            for text in (message, bare)
        ):
            name = "command line"
        raise SceneError(f"{name}: {message}") from None
    except RecursionError:  # a list that holds itself
        raise SceneError(f"{name}: nested too deeply") from None


def parse_scene_text(text: str, name: str) -> Scene:
    """A scene from TOML text; `name` opens the message of errors, SceneError as `load_scene`."""
    return parse_scene(load.read_toml(text.encode(), name), name)


def scene_to_toml(scene: Scene) -> str:
    """The resolved scene, defaults included, as TOML that `load_scene` reads to an equal Scene."""
    data = scene.model_dump(by_alias=True, exclude_none=True)
    for name in ("notch", "hole", *LISTED):
        if not data[name]:
            del data[name]
    return load.write_toml(data)


def key_for(word: str) -> str | None:
    """The key of a scene, "section.key", that an option of this name was most likely meant for."""
    return messages.key_for(word, Scene)


def _overridden(
    data: dict[str, Any], name: str, texts: Sequence[str], folder: Path | None = None
) -> Scene:
    overrides = load.parse_overrides(texts, Scene)
    keys = {override.key for override in overrides}
    changed = load.apply_overrides(data, overrides)
    if folder is not None:
        changed = with_tables(changed, folder)
    return parse_scene(changed, name, keys)
