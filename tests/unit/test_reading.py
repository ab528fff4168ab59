"""Files that may be damaged: one line with the file's name and what is wrong."""

import os
import time
from pathlib import Path

import pytest
from support.refusals import one_line

from taichi_ldem import reading
from taichi_ldem.errors import DamagedFile
from taichi_ldem.reading import Named, parse_toml, read_bytes, read_json, read_text, read_toml
from taichi_ldem.scene import load_scene, parse_scene_text


def refusal(read, path: Path) -> str:
    with pytest.raises(DamagedFile) as error:
        read(path)
    message = one_line(error)
    assert path.name in message
    return message


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")
def test_a_pipe_a_device_or_a_folder_in_a_files_place_does_not_hang(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.json")
    (tmp_path / "folder.json").mkdir()
    (tmp_path / "device.json").symlink_to("/dev/zero")
    (tmp_path / "dangling.json").symlink_to("nowhere")
    for name, what in (
        ("pipe", "a pipe or a device, not a file"),
        ("device", "a pipe or a device, not a file"),
        ("folder", "a folder, not a file"),
        ("dangling", "No such file"),
        ("absent", "No such file"),
    ):
        for read in (read_bytes, read_json, read_toml):
            assert what in refusal(read, tmp_path / f"{name}.json")


def test_a_file_that_is_larger_than_the_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "history.csv"
    file.touch()
    os.truncate(file, 1 << 40)  # sparse: it takes no space on the disk
    monkeypatch.setattr(reading, "available_bytes", lambda: 1 << 30)
    assert "1,099,511,627,776 bytes, and 1,073,741,824" in refusal(read_bytes, file)


def test_text_that_is_not_utf8_and_a_mark_before_it(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    file.write_bytes(b"\xef\xbb\xbfone\ntwo")
    assert read_text(file) == "one\ntwo"
    file.write_bytes(b"one\n\xff")
    assert "line 2 is not UTF-8 text" in refusal(read_text, file)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "Expecting value"),
        ("{", "Expecting property name"),
        ('{"a": NaN}', "NaN is not a finite number"),
        ('{"a": [-Infinity]}', "-Infinity is not a finite number"),
        ('{"a": 1e999}', "1e999 is not a finite number"),
        ('{"a": ' + "9" * 400 + "}", "a whole number of 400 digits"),
        ('{"a": "\\ud800"}', "half of a character"),
        ('{"\\udfff": 1}', "half of a character"),
        ("[" * 50 + "]" * 50, "nested too deeply"),
        ("[" * 100_000, "nested too deeply"),
    ],
)
def test_json_that_no_run_writes(tmp_path: Path, text: str, what: str) -> None:
    file = tmp_path / "summary.json"
    file.write_text(text)
    assert what in refusal(read_json, file)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("a", "Expected '='"),
        ("a = nan", "nan is not a finite number"),
        ("a = " + "9" * 400, "a whole number of hundreds of digits"),
        ("a = 1979-05-27", "1979-05-27 is neither a number nor a text"),
        ("a = " + "[" * 5000 + "]" * 5000, "nested too deeply"),
    ],
)
def test_toml_that_no_ensemble_writes(tmp_path: Path, text: str, what: str) -> None:
    file = tmp_path / "ensemble.toml"
    file.write_text(text)
    assert what in refusal(read_toml, file)


def test_a_missing_column_is_named_with_its_file() -> None:
    columns = Named(Path("run", "history.csv"), "column", {"time_s": 1})
    assert (columns["time_s"], columns.get("force_n")) == (1, None)
    with pytest.raises(DamagedFile, match=r"'run.history\.csv' has no column 'force_n'"):
        columns["force_n"]


@pytest.mark.parametrize("key", ["a.", "'a.b'. ", '"a" .\t'])
def test_a_key_of_twenty_thousand_parts_is_refused_at_once(key: str, tmp_path: Path) -> None:
    """Before, it took minutes."""
    long = key * 20_000 + "a"
    begun = time.process_time()
    for text in (f"x = 1\n{long} = 1", f"x = 1\n[{long}]", f"x = 1\ny = {{{long} = 1}}"):
        with pytest.raises(ValueError, match=r"a key of more than 32 parts \(at line 2\)"):
            parse_toml(text)
        (tmp_path / "scene.toml").write_text(text)
        with pytest.raises(ValueError, match="more than 32 parts"):
            load_scene(tmp_path / "scene.toml")
        with pytest.raises(ValueError, match="more than 32 parts"):
            parse_scene_text(text, "scene")
    assert time.process_time() - begun < 1.0
    assert parse_toml("a.b = 1\nd = [0.1, 1.5e-3]") == {"a": {"b": 1}, "d": [0.1, 1.5e-3]}


LONG = ["x" * 10**6, '"\n' * 10**5, "a." * 31 + ", " * 10**5, "'" * 10**6]


@pytest.mark.parametrize("text", LONG, ids=["word", "lines", "parts", "quotes"])
def test_looking_for_long_keys_takes_time_in_proportion(text: str) -> None:
    begun = time.process_time()
    with pytest.raises(ValueError, match=r"\S"):
        parse_toml(text)
    assert time.process_time() - begun < 3.0
