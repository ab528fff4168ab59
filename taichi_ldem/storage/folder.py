"""The folder of one run: where its files are, what may be written there, and its small files.

Everything is in SI units. `history.csv` and `fields.vtkhdf` grow while the run goes on and stay
readable between writes; `summary.json` is written last, so its presence means a finished run.
"""

from __future__ import annotations

import json
import math
import re
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_ldem.errors import DamagedFile, SceneError
from taichi_ldem.reading import Named, read_object, refuse_special
from taichi_ldem.scene import Scene, load_tables, parse_scene
from taichi_ldem.storage.checkpoint import LATEST, NEW, PREVIOUS
from taichi_ldem.storage.durable import LOCK, TEMPORARY, locked, refuse_locked, write_whole
from taichi_ldem.storage.history import read_history
from taichi_ldem.storage.place import current, unlink

OF_EVERY_RUN = (
    "run.json",
    "scene.toml",
    "history.csv",
    "fields.vtkhdf",
    "fragments.csv",
    "body.png",
    "body.npy",
    "body.stl",
    "summary.json",
    LATEST,
    PREVIOUS,
    NEW,
)
"""Files that every run writes, or may write. Each may stand there with ``.tmp`` after a kill."""

_PICTURE = re.compile(r"crack_[0-9.]+ms_(below|above|cut)\.png")
"""Names of the pictures that a run draws at its end, at times that it does not know before."""


@dataclass(frozen=True)
class RunFolder:
    """The folder of one run and the places of its files."""

    path: Path

    @classmethod
    def create(cls, path: Path, *, force: bool, files: Sequence[str] = ()) -> RunFolder:
        """Make the folder ready for a new run, and begin its record ``run.json``.

        With `force`, files that the record of an earlier run lists are removed; any other file
        stays.

        Args:
            files: names that this run writes in addition to those of every run.

        Raises SceneError as `check` does, and when an old file cannot be removed.
        """
        path = Path(path)
        cls._check_place(path, force=force, files=files)
        folder = cls(path)
        try:
            path.mkdir(parents=True, exist_ok=True)
            # The summary goes first: a folder half emptied must not look like a finished run. The
            # record is replaced last: until then it lists what is left.
            old = [name for name in folder.own_files() if name != folder.provenance_file.name]
            for name in ("summary.json", *old):
                unlink(path / name)
            folder._write_record({"processes": [], "files": sorted({*OF_EVERY_RUN, *files})})
        except OSError as error:
            raise SceneError(f"cannot use '{path}' as run folder: {error.strerror}") from None
        return folder

    @staticmethod
    def check(
        path: Path, *, force: bool, files: Sequence[str] = (), source: Path | None = None
    ) -> None:
        """Raise SceneError where `create` would refuse; nothing that exists is changed.

        Refused: a path that is no folder, a folder with anything in it unless `force`, files that
        no run's record lists and that the new run would replace, the scene's own file among them; a
        place where files cannot be written; a folder that another process works in, which `create`
        leaves to `held`.

        Args:
            files: as for `create`.
            source: the file of the scene that is to be run.
        """
        path = Path(path)
        RunFolder._check_place(path, force=force, files=files)
        if source is not None and force:
            for name in (*RunFolder(path).own_files(), *OF_EVERY_RUN, *files):
                with suppress(OSError):
                    if source.samefile(path / name):
                        raise SceneError(
                            f"run folder '{path}' holds the scene '{source}' itself, which --force "
                            "would replace; give another folder with --out, or another scene file"
                        )
        refuse_locked(path)

    @staticmethod
    def _check_place(path: Path, *, force: bool, files: Sequence[str]) -> None:
        try:
            for place in (path, *path.parents):
                if place.is_symlink() and not place.exists():
                    raise SceneError(f"run folder '{path}': '{place}' is a link to nothing")
            if path.exists() and not path.is_dir():
                raise SceneError(f"run folder '{path}' is a file; give a folder with --out")
            if path.is_dir():
                RunFolder(path)._refuse_others_files(force, files)
            existing = next(p for p in (path, *path.absolute().parents) if p.exists())
            # Permission bits lie (root, read-only mounts, quotas): only writing tells.
            with tempfile.TemporaryFile(dir=existing):
                pass
        except OSError as error:
            raise SceneError(f"cannot write to run folder '{path}': {error.strerror}") from None

    def _refuse_others_files(self, force: bool, files: Sequence[str]) -> None:
        present = {path.name for path in self.path.iterdir()} - {LOCK}
        if present and not force:
            raise SceneError(f"run folder '{self.path}' is not empty; --force replaces its run")
        wanted = {name for name in present if name in (*OF_EVERY_RUN, *files)}
        wanted |= {name for name in present if _PICTURE.fullmatch(name)}
        if others := sorted(wanted - set(self.own_files())):
            raise SceneError(
                f"run folder '{self.path}': no run's record (run.json) lists '{others[0]}', so "
                "--force does not replace it; move it, or give another folder with --out"
            )

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

    def now(self) -> RunFolder:
        """The folder where it is now: it may have been renamed since it was held.

        Raises:
            OSError: it has been removed, or replaced by another one.
        """
        path = current(self.path)
        if path != self.path:
            print(
                f"note: '{self.path}' is another folder now: this run is in '{path}'",
                file=sys.stderr,
            )
        return RunFolder(path)

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
    def fragments_file(self) -> Path:
        """The pieces of the plate over time; there only where the scene asks for them."""
        return self.path / "fragments.csv"

    @property
    def summary_file(self) -> Path:
        """Numbers of a finished run, JSON."""
        return self.path / "summary.json"

    @property
    def provenance_file(self) -> Path:
        """What wrote the run: versions, machine and command line of each process, JSON."""
        return self.path / "run.json"

    @property
    def begun(self) -> bool:
        """Whether a run has begun here: its record is there, which is written first."""
        return bool(self._record())

    @property
    def has_checkpoint(self) -> bool:
        """Whether there is a checkpoint, which may turn out to be damaged."""
        return any((self.path / name).is_file() for name in (LATEST, PREVIOUS))

    @property
    def can_go_on(self) -> bool:
        """Whether there is a run that has finished or has a checkpoint."""
        return self.begun and (self.summary_file.is_file() or self.has_checkpoint)

    def processes(self) -> list[Any]:
        """What ``run.json`` says of each process that has worked on the run, the first first."""
        if not self.provenance_file.exists():
            return []
        earlier = read_object(self.provenance_file).get("processes")
        if not isinstance(earlier, list):
            raise DamagedFile(f"'{self.provenance_file}' has no list of processes")
        return earlier

    def own_files(self) -> list[str]:
        """Names of the files that the run has written or may write, as its record lists them.

        ``run.json`` lists them before they are written. Without a record there are none.
        """
        listed = [name for name in self._record().get("files", []) if _is_plain(name)]
        begun = self.provenance_file.name + TEMPORARY  # all that a kill at the very start leaves
        return list(dict.fromkeys([*listed, *(name + TEMPORARY for name in listed), begun]))

    def claim(self, names: Iterable[str]) -> None:
        """Add names to the record's list, before files of these names are written.

        A folder whose record has no list stays as it is: an earlier version made it.

        Raises:
            SceneError: a file of this name is there, and no run has written it.
        """
        record = self._record()
        if "files" not in record:
            return
        new = [name for name in names if name not in record["files"]]
        for name in new:
            if (self.path / name).exists():
                raise SceneError(
                    f"'{self.path / name}' is not this run's, so it is not replaced; move it"
                )
        if new:
            self._write_record(record | {"files": sorted({*record["files"], *new})})

    def _record(self) -> dict[str, Any]:
        """The contents of ``run.json`` as far as they have the right shape."""
        found: Any = None
        with suppress(OSError, DamagedFile):
            found = read_object(self.provenance_file)
        if not isinstance(found, dict) or not isinstance(found.get("processes"), list):
            return {}
        record: dict[str, Any] = {"processes": found["processes"]}
        if isinstance(found.get("files"), list):
            record["files"] = [name for name in found["files"] if isinstance(name, str)]
        return record

    def _write_record(self, record: Mapping[str, Any]) -> None:
        write_whole(self.provenance_file, (json.dumps(record, indent=2) + "\n").encode())

    def write_provenance(self, provenance: dict[str, Any]) -> None:
        """Add a process to those that have worked on the run."""
        record = self._record()
        self._write_record(record | {"processes": [*record.get("processes", []), provenance]})

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


def _is_plain(name: Any) -> bool:
    """Whether a name from a record is that of a file in the folder itself."""
    return isinstance(name, str) and name not in ("", ".", "..") and not {"/", "\\", "\0"} & {*name}


_MEASURE = re.compile(r"_(j_m2|m_s|m2|pa|m|n|j|s)$|_cracks$|^broken_bars|^bars|^nodes|^steps")
"""Names of a summary's numbers, which end in their unit, and of its counts."""


_LIST = re.compile(r"^(probes_m|frequencies_hz|residuals|crack_(from|to)_m)$|_centre_m$")
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
