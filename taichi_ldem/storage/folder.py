"""The folder of one run: where its files are, what may be written there, and its small files.

Everything is in SI units. `history.csv` and `fields.vtkhdf` grow while the run goes on and stay
readable between writes; `summary.json` is written last, so its presence means a finished run.
"""

from __future__ import annotations

import json
import math
import re
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.errors import DamagedFile, SceneError
from taichi_ldem.reading import Named, read_object, refuse_special
from taichi_ldem.scene import Scene, load_tables, parse_scene
from taichi_ldem.storage.durable import LOCK, locked, refuse_locked, write_whole
from taichi_ldem.storage.history import read_history

# What a run and its pictures leave in the folder: all that `--force` may remove.
_OWN_FILES = re.compile(
    r"(scene\.toml|history\.csv|fields\.vtkhdf|summary\.json|run\.json)(\.tmp)?"
    r"|checkpoint(\.previous|\.new)?\.h5(\.tmp)?"
    r"|(force|force_displacement|velocity|energy|stress_strain)\.png"
    r"|(crack_map|cracks|crack_growth)\.png"
    r"|(pulse|dispersion|anisotropy)\.png|(probes|profiles)\.csv"
    r"|modes\.(csv|md|png|vtkhdf)"
    r"|crack_[0-9.]+ms_(below|above|cut)\.png"
    r"|shot_[0-9.]+ms(_(below|above|cut)(_az[-+.e0-9]+)?(_el[-+.e0-9]+)?(_[xyz][-+.e0-9]+)?"
    r"(_velocity|_energy)?)?\.png"
    r"|movie\.(mp4|gif)|report\.html"
)


@dataclass(frozen=True)
class RunFolder:
    """The folder of one run and the places of its files."""

    path: Path

    @classmethod
    def create(cls, path: Path, *, force: bool) -> RunFolder:
        """Make the folder ready for a new run.

        With `force`, files that an earlier run wrote are removed; any other file stays.

        Raises SceneError as `check` does, and when an old file cannot be removed.
        """
        cls._check_place(Path(path), force=force)
        folder = cls(Path(path))
        try:
            folder.path.mkdir(parents=True, exist_ok=True)
            # The summary goes first: a folder half emptied must not look like a finished run.
            for old in (folder.summary_file, *folder._own_files()):
                old.unlink(missing_ok=True)
        except OSError as error:
            raise SceneError(f"cannot use '{path}' as run folder: {error.strerror}") from None
        return folder

    @staticmethod
    def check(path: Path, *, force: bool) -> None:
        """Raise SceneError where `create` would refuse; nothing that exists is changed.

        Refused: a path that is no folder, a folder with anything in it unless `force`, a place
        where files cannot be written; a folder that another process works in, which `create` leaves
        to `held`.
        """
        RunFolder._check_place(Path(path), force=force)
        refuse_locked(Path(path))

    @staticmethod
    def _check_place(path: Path, *, force: bool) -> None:
        try:
            if path.exists() and not path.is_dir():
                raise SceneError(f"run folder '{path}' is a file; give a folder with --out")
            if path.is_dir() and not force and any(p.name != LOCK for p in path.iterdir()):
                raise SceneError(f"run folder '{path}' is not empty; --force overwrites its run")
            existing = next(p for p in (path, *path.absolute().parents) if p.exists())
            # Permission bits lie (root, read-only mounts, quotas): only writing tells.
            with tempfile.TemporaryFile(dir=existing):
                pass
        except OSError as error:
            raise SceneError(f"cannot write to run folder '{path}': {error.strerror}") from None

    @staticmethod
    @contextmanager
    def held(path: Path) -> Iterator[None]:
        """Make the folder and hold it for this process; SceneError where another one has it."""
        try:
            Path(path).mkdir(parents=True, exist_ok=True)
            with locked(Path(path)):
                yield
        except PermissionError as error:
            raise SceneError(f"cannot write to run folder '{path}': {error.strerror}") from None

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """The folder of an existing run, finished or not; SceneError names what it lacks."""
        folder = cls(Path(path))
        if not folder.path.is_dir():
            raise SceneError(f"'{path}' is no run folder: there is no such folder")
        for file in (folder.scene_file, folder.history_file):
            if not file.exists():
                raise SceneError(f"'{path}' is no run folder: it has no {file.name}")
            refuse_special(file)
        return folder

    @property
    def scene_file(self) -> Path:
        """The resolved scene, TOML."""
        return self.path / "scene.toml"

    @property
    def history_file(self) -> Path:
        """Scalars over time."""
        return self.path / "history.csv"

    @property
    def fields_file(self) -> Path:
        """Fields and broken bars, VTKHDF."""
        return self.path / "fields.vtkhdf"

    @property
    def summary_file(self) -> Path:
        """Numbers of a finished run, JSON."""
        return self.path / "summary.json"

    @property
    def provenance_file(self) -> Path:
        """What wrote the run: versions, machine and command line of each process, JSON."""
        return self.path / "run.json"

    def processes(self) -> list[Any]:
        """What ``run.json`` says of each process that has worked on the run, the first first."""
        if not self.provenance_file.exists():
            return []
        earlier = read_object(self.provenance_file).get("processes")
        if not isinstance(earlier, list):
            raise DamagedFile(f"'{self.provenance_file}' has no list of processes")
        return earlier

    def write_provenance(self, provenance: dict[str, Any]) -> None:
        """Add a process to those that have worked on the run."""
        processes = [*self.processes(), provenance]
        text = json.dumps({"processes": processes}, indent=2) + "\n"
        write_whole(self.provenance_file, text.encode())

    def picture_metadata(self) -> dict[str, str]:
        """Text chunks of the run's PNG files: the last process's scene and version."""
        with suppress(KeyError, TypeError, IndexError):
            run = self.processes()[-1]
            tags = {"scene_sha256": "Scene-SHA256", "version": "Version", "git": "Git"}
            return {tag: str(run[key]) for key, tag in tags.items() if run[key]}
        return {}

    def read_scene(self) -> Scene:
        """The resolved scene; errors as for ``read_scene``."""
        return read_scene(self.scene_file)

    def write_scene(self, text: str) -> None:
        """Write the resolved scene (TOML)."""
        write_whole(self.scene_file, text.encode())

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Write the summary whole or not at all; what is not finite becomes null."""
        text = json.dumps(_plain(summary), indent=2, allow_nan=False) + "\n"
        write_whole(self.summary_file, text.encode())

    def read_summary(self) -> dict[str, Any]:
        """The summary; empty where the run has not finished.  Raises SceneError if unreadable."""
        summary = read_object(self.summary_file) if self.summary_file.exists() else {}
        for key, value in summary.items():
            if _LIST.search(key):
                if not _are_numbers(value):
                    raise DamagedFile(f"'{self.summary_file}': {key} is no list of numbers")
            elif _MEASURE.search(key) and not _are_numbers([value]):
                raise DamagedFile(f"'{self.summary_file}': {key} is no number")
        return Named(self.summary_file, "number", summary)

    def read_history(self) -> dict[str, NDArray[np.float64]]:
        """Columns of `history.csv` by header name, each (n,); see `history.read_history`."""
        return read_history(self.history_file)

    def _own_files(self) -> Iterable[Path]:
        return [p for p in self.path.iterdir() if _OWN_FILES.fullmatch(p.name) and p.is_file()]


_MEASURE = re.compile(r"_(j_m2|m_s|m2|pa|m|n|j|s)$|_cracks$|^broken_bars|^bars|^nodes|^steps")
"""Names of a summary's numbers, which end in their unit, and of its counts."""


_LIST = re.compile(r"^(probes_m|frequencies_hz|residuals)$|_centre_m$")
"""Names of its lists of numbers."""


def _are_numbers(value: Any) -> bool:
    """Whether a value is a list of numbers, or null; null may also stand in the list."""
    kinds = (int, float, type(None))
    return value is None or (isinstance(value, list) and all(type(item) in kinds for item in value))


def read_scene(path: Path) -> Scene:
    """The scene in a file that this program wrote.

    Raises:
        DamagedFile: it is no TOML file.
        SceneError: it has been edited, and is no scene that can be run.
    """
    refuse_special(path)
    try:
        tables = load_tables(path)
    except SceneError as error:
        raise DamagedFile(str(error)) from None
    return parse_scene(tables, path.name)


def _plain(value: Any) -> Any:
    """`value` in JSON's own types; NaN and infinities, which JSON lacks, become None."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
