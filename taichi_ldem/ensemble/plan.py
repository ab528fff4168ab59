"""The plan of an ensemble: its members, their names and scenes, and the record of the request.

The members are the full product of variabilities, seeds and varied keys. The hash of their names
and of their scenes' hashes identifies an ensemble.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import tomli_w

from taichi_ldem import __version__
from taichi_ldem.ensemble.axes import CV, SEED, Value, make_axes
from taichi_ldem.errors import DamagedFile, SceneError
from taichi_ldem.reading import read_toml
from taichi_ldem.scenarios.registry import entry_of, resumable
from taichi_ldem.scene import (
    Scene,
    load_tables,
    overridden_tables,
    parse_overrides,
    parse_scene,
    scene_to_toml,
)
from taichi_ldem.storage.durable import write_whole
from taichi_ldem.storage.folder import read_scene
from taichi_ldem.storage.place import sync_folder
from taichi_ldem.storage.provenance import canonical, scene_hash

PLATE_SEED = "plate.perturbation_seed"
"""Equal to SEED in members whose nodes are perturbed, unless it is given itself."""

RECORD, SCENES, MEMBERS, ATTEMPTS = "ensemble.toml", "scenes", "members", "attempts"
LONGEST_NAME = 200
"""Characters of a member's name; file systems take 255 bytes with endings."""


_NAME = re.compile(r"\w[\w.+-]*", re.ASCII)


@dataclass(frozen=True)
class Member:
    """One run of an ensemble.

    Attributes:
        name: the name of its run folder.
        varied: the varied keys and their values; None for a key that it does not have.
        scene: the scene that is run.
    """

    name: str
    varied: Mapping[str, Any]
    scene: Scene

    @property
    def group(self) -> tuple[tuple[str, Any], ...]:
        """The varied keys without the seed; members that agree in them form a group."""
        return tuple((key, value) for key, value in self.varied.items() if key != SEED)

    @cached_property
    def scene_sha256(self) -> str:
        """The hash of its scene, which takes a tenth of a millisecond to compute."""
        return scene_hash(self.scene)


@dataclass(frozen=True)
class Plan:
    """All members, in order, and the request that they follow from."""

    members: tuple[Member, ...]
    asked: Mapping[str, Any]

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the members' names and scenes."""
        hashes = {member.name: member.scene_sha256 for member in self.members}
        return hashlib.sha256(json.dumps(hashes, sort_keys=True).encode()).hexdigest()


# --- the product ----------------------------------------------------------------------------------


def make_plan(
    scene_file: Path,
    *,
    cv: str | None = None,
    seeds: str | None = None,
    vary: Sequence[str] = (),
    settings: Sequence[str] = (),
) -> Plan:
    """The members of an ensemble.

    Args:
        cv: variabilities of the fracture energy, "0.10,0.25"; 0 is the homogeneous specimen.
        seeds: "0:4" (0 to 3) or "1,5,7"; seeds of the disorder and of perturbed nodes.
        vary: further keys, "section.key=value,value,..." each.
        settings: overrides of the scene for all members, "section.key=value" each.

    Raises:
        SceneError: an option or a member's scene is not acceptable.
    """
    axes = make_axes(cv, seeds, vary)
    base = load_tables(scene_file, settings)
    names = {override.key for override in parse_overrides(settings)}
    members: dict[str, Member] = {}
    for chosen in itertools.product(*(axis.values for axis in axes)):
        values = {axis.key: value for axis, value in zip(axes, chosen, strict=True)}
        member = _member(scene_file.name, base, values, names)
        other = members.setdefault(member.name, member)
        if other.varied != member.varied:
            raise SceneError(f"two members have the name '{member.name}': give other values")
    _refuse_equal(members.values())
    asked = {"scene": str(scene_file), "cv": cv, "seeds": seeds, "vary": [*vary]}
    asked = {key: value for key, value in asked.items() if value is not None}
    return Plan(tuple(members.values()), asked | {"set": [*settings]})


def _member(
    scene_name: str, base: Mapping[str, Any], values: Mapping[str, Value], names: Collection[str]
) -> Member:
    """A member.

    Args:
        base: tables of the scene that all members share.
        values: of the varied keys.
        names: of the keys that are set for all members.
    """
    homogeneous = CV in values and not values[CV].override.value and not _other_disorder(values)
    used = {
        key: value
        for key, value in values.items()
        if not (homogeneous and key.startswith("disorder."))
    }
    tables = overridden_tables(base, [value.override for value in used.values()])
    names = {*names, *used}
    if homogeneous:
        tables.pop("disorder", None)
    if SEED in values and PLATE_SEED not in names and tables.get("plate", {}).get("perturbation"):
        used[SEED] = values[SEED]
        tables["plate"]["perturbation_seed"] = values[SEED].override.value
        if tables.get("disorder", {}).keys() <= {"seed"}:  # only the nodes draw from it
            tables.pop("disorder", None)
    scene = parse_scene(tables, scene_name, names)
    if not entry_of(scene).resumable:
        known = ", ".join(resumable())
        raise SceneError(
            f'scenario = "{scene.scenario}": cannot be in an ensemble, only {known} can'
        )
    varied: dict[str, Any] = {
        key: value.override.value if key in used else None for key, value in values.items()
    }
    if homogeneous:
        varied[CV] = 0.0
        used[CV] = values[CV]
    name = "_".join(value.part for key, value in values.items() if key in used)
    if len(name) > LONGEST_NAME:
        raise SceneError(
            f"member '{name[:40]}...': a name of {len(name)} characters is too long for a folder "
            f"(at most {LONGEST_NAME}); vary fewer keys at a time"
        )
    return Member(name, varied, scene)


def _other_disorder(values: Mapping[str, Value]) -> bool:
    """Whether another varied key of ``[disorder]`` draws from the seed."""
    return any(
        value.text not in ("0", "0.0")
        for key, value in values.items()
        if key != CV and key.startswith("disorder.") and key.endswith(("_cv", "_data"))
    )


def _refuse_equal(members: Iterable[Member]) -> None:
    seen: dict[str, str] = {}
    for member in members:
        other = seen.setdefault(member.scene_sha256, member.name)
        if other != member.name:
            raise SceneError(f"members '{other}' and '{member.name}' are the same run")


# --- the record -----------------------------------------------------------------------------------


def write_plan(plan: Plan, folder: Path, threads: int) -> None:
    """Write ``ensemble.toml`` and the members' scenes."""
    (folder / SCENES).mkdir(exist_ok=True)
    for member in plan.members:
        solver = member.scene.solver.model_copy(update={"threads": threads})
        scene = member.scene.model_copy(update={"solver": solver})
        # not waited for one by one: `--resume` writes them again
        file = folder / SCENES / f"{member.name}.toml"
        write_whole(file, scene_to_toml(scene).encode(), sync=False)
    sync_folder(folder / SCENES)
    record = {
        "sha256": plan.hash,
        "version": __version__,
        "asked": dict(plan.asked),
        "member": [
            {
                "name": member.name,
                "scene_sha256": member.scene_sha256,
                "varied": {k: v for k, v in member.varied.items() if v is not None},
            }
            for member in plan.members
        ],
    }
    text = "# What `ldem ensemble` was asked for; --resume refuses another ensemble.\n"
    write_whole(folder / RECORD, (text + tomli_w.dumps(record)).encode())


def read_plan(folder: Path) -> Plan:
    """The plan of an ensemble's folder.

    Raises:
        SceneError: the folder holds no ensemble.
        DamagedFile: a file of it cannot be read.
    """
    record, path = _record(folder), folder / RECORD
    listed, asked = record.get("member"), record.get("asked", {})
    if not isinstance(listed, list) or not listed or not isinstance(asked, dict):
        raise DamagedFile(f"'{path}' is no record of an ensemble: it lists no members")
    keys: dict[str, None] = {}
    for place, member in enumerate(listed):
        varied = member.get("varied") if isinstance(member, dict) else None
        # a name from a file must not lead out of the folder
        if not isinstance(varied, dict) or not _NAME.fullmatch(str(member.get("name"))):
            raise DamagedFile(f"'{path}': entry {place + 1} is no member of an ensemble")
        keys |= dict.fromkeys(varied)
    ordered = sorted(keys, key=lambda key: key == SEED)
    members = [
        Member(
            str(member["name"]),
            {key: member["varied"].get(key) for key in ordered},
            read_scene(folder / SCENES / f"{member['name']}.toml"),
        )
        for member in listed
    ]
    return Plan(tuple(members), asked)


def _record(folder: Path) -> dict[str, Any]:
    path = folder / RECORD
    if not path.exists():
        raise SceneError(f"'{folder}' holds no ensemble: it has no {RECORD}")
    return read_toml(path)


def refuse_other_plan(plan: Plan, folder: Path) -> None:
    """Check that a folder holds this ensemble.

    Where the hashes differ the scenes decide: another version of the program knows keys that the
    one which began the ensemble did not, with defaults that leave everything as it was.

    Raises:
        SceneError: it holds another one; the message names a difference.
    """
    if _record(folder).get("sha256") == plan.hash:
        return
    difference = _difference(read_plan(folder), plan)
    if difference is not None:
        raise SceneError(f"--resume: '{folder}' holds another ensemble: {difference}")


def _difference(old: Plan, new: Plan) -> str | None:
    """A difference between two plans in words; None where they are the same ensemble."""
    before = {member.name: member for member in old.members}
    now = {member.name: member for member in new.members}
    for these, others, where in ((before, now, "there"), (now, before, "asked for")):
        only = [name for name in these if name not in others]
        if only:
            return f"only {where}: {', '.join(only[:4])}{' ...' if len(only) > 4 else ''}"
    for name, member in now.items():
        mine, theirs = canonical(member.scene), canonical(before[name].scene)
        for key in sorted(mine.keys() | theirs.keys()):
            if mine.get(key) != theirs.get(key) and key != "solver.threads":
                return f"{key} = {theirs.get(key)!r} there, {mine.get(key)!r} asked for ({name})"
    return None
