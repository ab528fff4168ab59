"""The plan of an ensemble: its members, their names and scenes, and the record of the request.

The members are the full product of variabilities, seeds and varied keys. The hash of their names
and of their scenes' hashes identifies an ensemble.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

from taichi_ldem import __version__
from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios.registry import entry_of, resumable
from taichi_ldem.scene import (
    Scene,
    load_scene,
    load_tables,
    override_value,
    parse_scene,
    scene_to_toml,
)
from taichi_ldem.storage.durable import write_whole
from taichi_ldem.storage.provenance import canonical, scene_hash

CV, SEED = "disorder.fracture_energy_cv", "disorder.seed"
PLATE_SEED = "plate.perturbation_seed"
"""Equal to SEED in members whose nodes are perturbed, unless it is given itself."""
SHORT = {CV: "cv", SEED: "seed"}
"""Names of these keys in the members' names; another key is named by its last word."""

RECORD, SCENES, MEMBERS, ATTEMPTS = "ensemble.toml", "scenes", "members", "attempts"
MAX_MEMBERS = 100_000


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


@dataclass(frozen=True)
class Plan:
    """All members, in order, and the request that they follow from."""

    members: tuple[Member, ...]
    asked: Mapping[str, Any]

    @property
    def hash(self) -> str:
        """SHA-256 of the members' names and scenes."""
        hashes = {member.name: scene_hash(member.scene) for member in self.members}
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
    axes = list(_axes(cv, seeds, vary))
    if not axes:
        raise SceneError("nothing is varied: give --cv, --seeds or --vary")
    if len({key for key, _ in axes}) < len(axes):
        key = next(key for key, _ in axes if sum(key == other for other, _ in axes) > 1)
        raise SceneError(f"--vary {key}: the key is varied twice")
    count = 1
    for _, texts in axes:
        count *= len(texts)
    if count > MAX_MEMBERS:
        raise SceneError(f"an ensemble has at most {MAX_MEMBERS} members, not {count}")
    words = _words([key for key, _ in axes])
    members: dict[str, Member] = {}
    for chosen in itertools.product(*(texts for _, texts in axes)):
        member = _member(scene_file, dict(zip(words, chosen, strict=True)), words, settings)
        members.setdefault(member.name, member)
    _refuse_equal(list(members.values()))
    asked = {"scene": str(scene_file), "cv": cv, "seeds": seeds, "vary": [*vary]}
    asked = {key: value for key, value in asked.items() if value is not None}
    return Plan(tuple(members.values()), asked | {"set": [*settings]})


def _axes(
    cv: str | None, seeds: str | None, vary: Sequence[str]
) -> Iterator[tuple[str, list[str]]]:
    """Each varied key with its values as texts, the seed last."""
    if cv is not None:
        yield CV, _unique(f"--cv {cv}", [_variability(cv, text) for text in _split(cv)])
    for text in vary:
        key, equals, values = (part.strip() for part in text.partition("="))
        if not equals or not values or key.count(".") != 1:
            raise SceneError(f"--vary {text}: must have the form section.key=value,value,...")
        yield key, _unique(f"--vary {text}", _split(values))
    if seeds is not None:
        yield SEED, _unique(f"--seeds {seeds}", [str(seed) for seed in _seeds(seeds)])


def _variability(given: str, text: str) -> str:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise SceneError(f"--cv {given}: must be numbers of at least 0, as in 0.10,0.25")
    return repr(value)


def _seeds(text: str) -> list[int]:
    wish = f"--seeds {text}: must be whole numbers of at least 0, as in 0:4 or 1,5,7"
    found: list[int] = []
    for part in text.split(","):
        first, colon, last = (word.strip() for word in part.partition(":"))
        if not (first.isdecimal() and (last.isdecimal() or not colon)) or len(first + last) > 30:
            raise SceneError(wish)
        end = int(last) if colon else int(first) + 1
        if end - int(first) > MAX_MEMBERS:
            raise SceneError(f"--seeds {text}: must be at most {MAX_MEMBERS} seeds")
        found += range(int(first), end)
    if not found:
        raise SceneError(wish)
    return found


def _split(text: str) -> list[str]:
    """Values between commas; commas within brackets or quotes do not separate."""
    parts, depth, quote = [""], 0, ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        depth += (letter in "[{") - (letter in "]}")
        if letter == "," and depth == 0 and not quote:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def _unique(option: str, texts: list[str]) -> list[str]:
    for text in texts:
        if not text:
            raise SceneError(f"{option}: a value is missing")
        if texts.count(text) > 1:
            raise SceneError(f"{option}: {text} is given twice")
    return texts


def _words(keys: Sequence[str]) -> dict[str, str]:
    """The name of each key in a member's name: its last word, if no other key has the same one."""
    last = [key.rpartition(".")[2] for key in keys]
    return {
        key: SHORT.get(key, word if last.count(word) == 1 else key.replace(".", "-"))
        for key, word in zip(keys, last, strict=True)
    }


def _member(
    scene_file: Path, texts: dict[str, str], words: Mapping[str, str], settings: Sequence[str]
) -> Member:
    homogeneous = CV in texts and float(texts[CV]) == 0 and not _other_disorder(texts)
    used = {
        key: text
        for key, text in texts.items()
        if not (homogeneous and key.startswith("disorder."))
    }
    overrides = [f"{key}={text}" for key, text in used.items()]
    tables = load_tables(scene_file, [*settings, *overrides])
    names = {text.partition("=")[0].strip() for text in [*settings, *overrides]}
    if homogeneous:
        tables.pop("disorder", None)
    if SEED in texts and PLATE_SEED not in names and tables.get("plate", {}).get("perturbation"):
        used[SEED] = texts[SEED]
        tables["plate"]["perturbation_seed"] = override_value(f"{PLATE_SEED}={texts[SEED]}")
        if tables.get("disorder", {}).keys() <= {"seed"}:  # only the nodes draw from it
            tables.pop("disorder", None)
    scene = parse_scene(tables, scene_file.name, names)
    if not entry_of(scene).resumable:
        known = ", ".join(resumable())
        raise SceneError(
            f'scenario = "{scene.scenario}": cannot be in an ensemble, only {known} can'
        )
    varied: dict[str, Any] = {
        key: override_value(f"{key}={text}") if key in used else None for key, text in texts.items()
    }
    if homogeneous:
        varied[CV] = 0.0
        used[CV] = texts[CV]
    parts = [f"{words[key]}{_plain(text)}" for key, text in texts.items() if key in used]
    return Member("_".join(parts), varied, scene)


def _other_disorder(texts: Mapping[str, str]) -> bool:
    """Whether another varied key of ``[disorder]`` draws from the seed."""
    return any(
        text not in ("0", "0.0")
        for key, text in texts.items()
        if key != CV and key.startswith("disorder.") and key.endswith(("_cv", "_data"))
    )


def _plain(text: str) -> str:
    """A value as a part of a file's name."""
    try:
        text = f"{float(text):.12g}"
    except ValueError:
        text = re.sub(r"[^0-9A-Za-z.+-]+", "x", text).strip("x")
    return text


def _refuse_equal(members: Sequence[Member]) -> None:
    seen: dict[str, str] = {}
    for member in members:
        other = seen.setdefault(scene_hash(member.scene), member.name)
        if other != member.name:
            raise SceneError(f"members '{other}' and '{member.name}' are the same run")


# --- the record -----------------------------------------------------------------------------------


def write_plan(plan: Plan, folder: Path, threads: int) -> None:
    """Write ``ensemble.toml`` and the members' scenes."""
    (folder / SCENES).mkdir(exist_ok=True)
    for member in plan.members:
        solver = member.scene.solver.model_copy(update={"threads": threads})
        scene = member.scene.model_copy(update={"solver": solver})
        write_whole(folder / SCENES / f"{member.name}.toml", scene_to_toml(scene).encode())
    record = {
        "sha256": plan.hash,
        "version": __version__,
        "asked": dict(plan.asked),
        "member": [
            {
                "name": member.name,
                "scene_sha256": scene_hash(member.scene),
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
        SceneError: the folder holds no ensemble, or a file of it cannot be read.
    """
    record = _record(folder)
    try:
        keys = list(dict.fromkeys(k for m in record["member"] for k in m["varied"]))
        keys.sort(key=lambda key: key == SEED)
        members = [
            Member(
                str(m["name"]),
                {key: m["varied"].get(key) for key in keys},
                load_scene(folder / SCENES / f"{m['name']}.toml"),
            )
            for m in record["member"]
        ]
        return Plan(tuple(members), record["asked"])
    except (KeyError, TypeError, AttributeError) as error:
        raise SceneError(f"'{folder / RECORD}' is no record of an ensemble: {error!r}") from None


def _record(folder: Path) -> dict[str, Any]:
    path = folder / RECORD
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise SceneError(f"'{folder}' holds no ensemble: it has no {RECORD}") from None
    except (OSError, ValueError) as error:
        raise SceneError(f"cannot read '{path}': {error}") from None


def refuse_other_plan(plan: Plan, folder: Path) -> None:
    """Check that a folder holds this ensemble.

    Raises:
        SceneError: it holds another one; the message names a difference.
    """
    if _record(folder).get("sha256") == plan.hash:
        return
    old = read_plan(folder)
    raise SceneError(f"--resume: '{folder}' holds another ensemble: {_difference(old, plan)}")


def _difference(old: Plan, new: Plan) -> str:
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
    return f"{RECORD} has been changed, or another version wrote it"
