"""Bad input: one line that names the fault, exit code 2, nothing written, Taichi not imported."""

import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from support.scenes import GOOD

from taichi_ldem.cli import main
from taichi_ldem.scene import NATURAL, TABLES, key_for


class Bad(NamedTuple):
    """A fault: `old` of the good scene replaced by `new`, and what the message must contain."""

    old: str
    new: str
    message: str


MASS, SIZE, STEP = "mass = 18.49", "size = [0.0928, 0.0928, 0.0032]", "duration = 0.010"
NOTCH = f"{STEP}\n[[notch]]\nnormal = 'x'\nposition = 0\nfrom = [0, 0]\nto = [0.01, 0.001]"

BAD = {
    # types
    "number_as_text": Bad(MASS, 'mass = "heavy"', 'striker.mass = "heavy": must be a number'),
    "number_as_flag": Bad(MASS, "mass = true", "striker.mass = true: must be a number"),
    "fraction_of_a_module": Bad(
        "thickness = 6", "thickness = 6.5", "modules_through_thickness = 6.5: must be a whole"
    ),
    "flag_as_number": Bad(SIZE, f"{SIZE}\nsurface_weights = 1", "= 1: must be true or false"),
    "two_sides": Bad(SIZE, "size = [0.1, 0.1]", "plate.size = [0.1, 0.1]: must be a list of 3 num"),
    "size_as_number": Bad(SIZE, "size = 0.1", "plate.size = 0.1: must be a list of 3 numbers"),
    "table_as_number": Bad('"impact"', '"impact"\noutput = 3', "output = 3: must be a table"),
    "line_break_in_a_value": Bad(
        '"rings"', '"ri\\nngs"', r'clamp.kind = "ri\nngs": must be "rings"'
    ),
    # names
    "unknown_key": Bad(
        "youngs_modulus",
        "youngs_modulos",
        "unknown key 'material.youngs_modulos'; did you mean 'youngs_modulus'?",
    ),
    "natural_name_of_a_key": Bad(
        SIZE,
        f"{SIZE}\nthickness = 0.002",
        "unknown key 'plate.thickness'; give plate.size = [x, y, thickness]",
    ),
    "natural_name_in_another_table": Bad(
        "velocity = 1.065", "speed = 1.065", "unknown key 'striker.speed'; give striker.velocity"
    ),
    "unknown_table": Bad("[striker]", "[stricker]", "unknown key 'stricker'; did you mean 'str"),
    "unknown_kind": Bad('"rings"', '"glued"', 'must be "rings", "bonded", "rim" or "free"'),
    "unknown_scenario": Bad('"impact"', '"impakt"', 'scenario = "impakt": must be "impact"'),
    "disorder_of_nothing": Bad(
        STEP,
        f"{STEP}\n[disorder]\nseed = 1",
        "'[disorder]' names no property that varies; give one of",
    ),
    "cv": Bad(
        STEP,
        f"{STEP}\n[disorder]\ndensity_cv = 2",
        "disorder.density_cv = 2: must be at most 1.5",
    ),
    "cv_and_data": Bad(
        STEP,
        f"{STEP}\n[disorder]\ndensity_cv = 0.1\ndensity_data = [1, 2, 3]",
        "disorder.density_cv = 0.1: cannot be given together with disorder.density_data",
    ),
    "two_data": Bad(
        STEP, f"{STEP}\n[disorder]\ndensity_data = [1, 2]", "must be at least 3 values that differ"
    ),
    "data_of_text": Bad(
        STEP,
        f"{STEP}\n[disorder]\ndensity_data = 1",
        "disorder.density_data = 1: must be a list of numbers",
    ),
    "correlation_within_a_module": Bad(
        STEP,
        f"{STEP}\n[disorder]\ndensity_cv = 0.1\ncorrelation_length = 1e-4",
        "disorder.correlation_length = 0.0001: must be 0 (no correlation) or at least",
    ),
    "perturbation": Bad(
        SIZE, f"{SIZE}\nperturbation = 0.4", "plate.perturbation = 0.4: must be at most 0.25"
    ),
    "missing_key": Bad("density = 1190.0\n", "", "missing key 'material.density'"),
    "missing_table": Bad(f"[solver]\n{STEP}", "", "missing table '[solver]'"),
    "missing_scenario": Bad('scenario = "impact"', "", "missing key 'scenario'"),
    # values
    "negative_size": Bad(SIZE, "size = [0.09, -0.09, 0.0032]", "plate.size[1] = -0.09: must be gr"),
    "negative_modulus": Bad("3.35e9", "-3", "material.youngs_modulus = -3: must be greater than 0"),
    "modulus_in_mpa": Bad(
        "3.35e9",
        "3350",
        "material.youngs_modulus = 3350.0: gives a peak strain eps_p = R_f sqrt(G_f / E) = 17.47, "
        "which must be less than 1; give SI units: E in Pa",
    ),
    "no Poisson's ratio": Bad(
        "= 0.25",
        "= 0.0",
        "material.poisson_ratio = 0.0: must be at least 0.16 where bars break, or above 0 with "
        'plate.stiffness = "equation-2": below it a broken bar gives energy to its modules',
    ),
    "incompressible": Bad(
        "= 0.25", "= 0.5", "material.poisson_ratio = 0.5: must be less than 0.5 and at least 0"
    ),
    "nan": Bad(MASS, "mass = nan", "striker.mass = nan: must be a finite number"),
    "infinity": Bad(MASS, "mass = inf", "striker.mass = inf: must be a finite number"),
    "zero_duration": Bad(STEP, "duration = 0", "solver.duration = 0: must be greater than 0"),
    "absurd_time_step": Bad(
        STEP, f"{STEP}\ntime_step = 1e50", "time_step = 1e+50: must be smaller than solver.duration"
    ),
    "zero_time_step": Bad(STEP, f"{STEP}\ntime_step = 0", "time_step = 0: must be a number of sec"),
    "nan_time_step": Bad(STEP, f"{STEP}\ntime_step = nan", "time_step = nan: must be a number of"),
    "endless_steps": Bad(STEP, f"{STEP}\ntime_step = 1e-300", "must give at most 1e+12 steps"),
    "safety_above_one": Bad(
        STEP, f"{STEP}\nsafety = 1.1", "solver.safety = 1.1: must be at most 1"
    ),
    "no_threads": Bad(STEP, f"{STEP}\nthreads = 0", "solver.threads = 0: must be at least 1"),
    "metal_in_f64": Bad(STEP, f'{STEP}\narch = "metal"', 'arch "metal" has no f64, use "f32"'),
    "history_interval_above_duration": Bad(
        STEP, f"{STEP}\n[output]\nhistory_interval = 1", "output.history_interval = 1.0: must be at"
    ),
    "image_after_the_end": Bad(
        STEP,
        f"{STEP}\n[output]\nimage_times = [1.0]",
        "output.image_times = 1.0: must lie between 0 and solver.duration = 0.01; "
        'for no snapshots give --set "output.image_times=[]"',
    ),
    "filter_above_half_of_the_sampling_rate": Bad(
        STEP,
        f"{STEP}\n[output]\nhistory_interval = 1e-4\nfilter_frequencies = [1e3, 5e3]",
        "output.filter_frequencies = 5000.0: must be below 5000",
    ),
    "too_many_frames": Bad(
        STEP,
        f"{STEP}\n[output]\nfield_interval = 1e-9",
        "output.field_interval = 1e-09: must be at",
    ),
    # what does not fit together
    "side_between_modules": Bad(
        SIZE, "size = [0.0928, 0.0061, 0.0032]", "0.000533333 m: 0.00586667 or 0.0064"
    ),
    "astronomic_lattice": Bad(SIZE, "size = [100, 100, 0.0032]", "modules in all, not 2.11e+11"),
    "size_in_millimetres": Bad(
        SIZE,
        "size = [92.8, 92.8, 3.2]",
        "plate.size[0] = 92.8: must be at most 10: sides are in metres, and 92.8 mm are 0.0928 m",
    ),
    "thickness_in_millimetres": Bad(
        SIZE,
        "size = [0.0928, 0.0928, 3.2]",
        "with which bars dissipate more than G_f; plate.size is in metres",
    ),
    "coarse": Bad(
        SIZE,
        "size = [0.0928, 0.0928, 3.2]",
        'or give material.fracture = "crack", with which a crack still costs about G_f, or',
    ),
    "coarse_before_uneven": Bad(
        SIZE, "size = [0.0928, 0.0928, 0.006]", "too coarse for longitudinal bars to"
    ),
    "astronomic_size": Bad(
        SIZE, "size = [1, 1e300, 1e-3]", "plate.size[1] = 1e+300: must lie betw"
    ),
    "disc_without_diameter": Bad(SIZE, f'{SIZE}\nshape = "disc"', "needs plate.diameter"),
    "disc_above_the_side": Bad(
        SIZE,
        f'{SIZE}\nshape = "disc"\ndiameter = 0.1',
        "plate.diameter = 0.1: must be at most 0.0928",
    ),
    "rectangle_with_diameter": Bad(
        SIZE, f"{SIZE}\ndiameter = 0.05", 'is for plate.shape = "disc" only'
    ),
    "clamp_outside_the_plate": Bad(
        "outer_diameter = 0.090", "outer_diameter = 0.1", "clamp.outer_diameter = 0.1: must fit ins"
    ),
    "clamp_inside_out": Bad(
        "inner_diameter = 0.076",
        "inner_diameter = 0.091",
        "must be smaller than clamp.outer_diamet",
    ),
    "rings_without_diameter": Bad(
        "outer_diameter = 0.090", "", "missing key 'clamp.outer_diameter' (clamp.kind = \"rings\")"
    ),
    "striker_beside_the_plate": Bad(
        MASS, f"{MASS}\nposition = [0.05, 0]", "striker.position = [0.05, 0.0]: must be over the pl"
    ),
    "striker_on_the_ring": Bad(
        MASS, f"{MASS}\nposition = [0.035, 0]", "must stay inside clamp.inner_diameter = 0.076"
    ),
    "striker_wider_than_the_clamp": Bad(
        "diameter = 0.0127",
        "diameter = 0.08",
        "striker.diameter = 0.08: must be smaller than clamp",
    ),
    "bend_without_supports": Bad(
        '"impact"', '"bend"', "missing table '[supports]' (scenario = \"bend\")"
    ),
    "clamped_bend": Bad(
        'scenario = "impact"',
        'scenario = "bend"\nsupports = { span = 0.08, diameter = 0.004 }',
        'clamp.kind = "rings": must be "free" or absent',
    ),
    "supports_beside_the_plate": Bad(
        'scenario = "impact"',
        'scenario = "impact"\nsupports = { span = 0.1, diameter = 0.004 }',
        "supports.span = 0.1: must be at most 0.0928",
    ),
    "supports_that_overlap": Bad(
        'scenario = "impact"',
        'scenario = "impact"\nsupports = { span = 0.01, diameter = 0.011 }',
        "supports.diameter = 0.011: must be at most supports.span = 0.01",
    ),
    "negative_friction": Bad(
        "mass = 18.49",
        "mass = 18.49\nfriction = -0.1",
        "striker.friction = -0.1: must be at least 0",
    ),
    "friction_of_rings": Bad(
        'kind = "rings"', 'kind = "rings"\nfriction = -1', "clamp.friction = -1: must be at least 0"
    ),
    "floor_in_the_plate": Bad(
        'scenario = "impact"',
        'scenario = "impact"\nfloor = { gap = -0.001 }',
        "floor.gap = -0.001: must be at least 0",
    ),
    "friction_of_the_floor": Bad(
        'scenario = "impact"',
        'scenario = "impact"\nfloor = { friction = -0.5 }',
        "floor.friction = -0.5: must be at least 0",
    ),
    "gravity_without_direction": Bad(
        "modules_through_thickness = 6",
        "modules_through_thickness = 6\ngravity = 9.81",
        "plate.gravity = 9.81: must be a list of 3 numbers",
    ),
    "velocity_in_the_plane": Bad(
        "modules_through_thickness = 6",
        "modules_through_thickness = 6\nvelocity = [1.0, 0.0]",
        "plate.velocity = [1.0, 0.0]: must be a list of 3 numbers",
    ),
    "factor_and_strain": Bad(
        "failure_factor = 31.45",
        "failure_factor = 31.45\nfailure_strain = 0.0175",
        "material.failure_strain = 0.0175: cannot be given together with material.failure_factor",
    ),
    "damage_without_strain": Bad("failure_factor = 31.45", "", "missing key 'material.failure_fac"),
    "damage_without_energy": Bad(
        "fracture_energy = 1034.0", "", "'material.fracture_energy' (or ma"
    ),
    "limit_below_failure": Bad(
        "failure_factor = 31.45",
        "failure_strain = 0.02\nlimit_strain = 0.01",
        "material.limit_strain = 0.01: must be at least material.failure_strain = 0.02",
    ),
    "too_coarse_for_the_strain": Bad("failure_factor = 31.45", "failure_strain = 0.0224", "K_r = "),
    "limit_below_derived_failure": Bad(
        "failure_factor = 31.45", "failure_factor = 31.45\nlimit_strain = 0.01", "limit_strain"
    ),
    "notch_outside": Bad(
        STEP, NOTCH.replace("position = 0", "position = 1"), "notch[0].position = 1.0: must lie ins"
    ),
    "notch_beside": Bad(
        STEP,
        NOTCH.replace("[0.01,", "[-0.05,").replace("[0, 0]", "[-0.06, 0]"),
        "must cut the plate",
    ),
    "notch_without_area": Bad(
        STEP, NOTCH.replace("[0, 0]", "[0.01, 0]"), "must differ from notch[0]"
    ),
    "notch_in_one_dimension": Bad(
        STEP, NOTCH.replace("[0, 0]", "[0]"), "notch[0].from = [0]: must be"
    ),
    # files
    "not_toml": Bad("[plate]", "[plate", "line 3"),
    "key_twice": Bad(MASS, f"{MASS}\n{MASS}", "not valid TOML"),
    "nested_too_deeply": Bad(MASS, f"mass = {'[' * 5000}{']' * 5000}", "not valid TOML"),
    "integer_without_end": Bad(MASS, f"mass = {'9' * 5000}", "not valid TOML"),
    "huge_integer": Bad(MASS, f"mass = 0x{'f' * 5000}", "striker.mass = an integer of hundreds"),
    "huge_file": Bad('scenario = "impact"', "#" * (1 << 20), "larger than 1 MiB"),
}


def _refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Run `ldem` in this process; the one line of its refusal."""
    code = main(arguments)
    output, errors = capsys.readouterr()
    assert code == 2
    assert output == ""
    assert errors.endswith("\n")
    (line,) = errors.splitlines()
    assert line.startswith("error: ")
    assert len(line) < 1100
    return line


@pytest.fixture
def good(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "scene.toml"
    path.write_text(GOOD)
    return path


@pytest.mark.parametrize("name", BAD)
@pytest.mark.parametrize("command", ["impact", "info"])
def test_a_bad_scene_is_refused_in_one_line(
    command: str, name: str, good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = BAD[name]
    assert bad.old in GOOD
    good.write_text(GOOD.replace(bad.old, bad.new, 1))
    line = _refused(capsys, command, "scene.toml")
    assert bad.message in line
    assert line.startswith("error: scene.toml: ")
    assert [path.name for path in good.parent.iterdir()] == ["scene.toml"]


def test_an_earlier_end_is_noted_on_a_line_of_its_own(
    good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good.write_text(GOOD + "[output]\nimage_times = [1e-3, 6e-3]\n")
    settings = ["--set", "solver.duration=5e-3", "--set", "striker.mass=-1"]
    assert main(["impact", str(good), *settings]) == 2
    note, error = capsys.readouterr().err.splitlines()
    assert note == (
        "note: output.image_times: left out what lies after solver.duration = 0.005: [0.006]"
    )
    assert error.startswith("error: command line: striker.mass = -1: must be greater than 0")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--set", "striker"], "--set striker: must have the form section.key=value"),
        (["--set", "a.b.c=1"], "--set a.b.c=1: must have the form section.key=value"),
        (["--set", "strker.mass=1"], "unknown section 'strker'; did you mean 'striker'?"),
        (["--set", "striker.maß=1"], "command line: unknown key 'striker.maß'"),
        (["--set", "striker.mass=1 kg"], "the value is neither TOML nor a bare word"),
        (["--set", "striker.mass=1\nx=2"], "the value is neither TOML nor a bare word"),
        (["--set", "striker.mass="], "the value is neither TOML nor a bare word"),
        (["--set", "striker.mass=-1"], "command line: striker.mass = -1: must be greater than 0"),
        (["--set", "plate.size=[1, 1, inf]"], "command line: plate.size[2] = inf: must be a fin"),
        (["--set", "notch.a\nb=1"], "command line: unknown key 'notch[0].a b'"),
        (["--set", "solver.a\nb=1"], "unknown key 'solver.a b'"),
        (["--set", f"solver.{'a' * 10000}=1"], "unknown key 'solver.aaa"),
        (["--set", "notch.position=1"], "command line: notch[0].position = 1.0: must lie inside"),
        (["--set", "disorder.seed=1"], "table '[disorder]' names no property that varies"),
        (["--set", "solver.arch=cpu", "--arch", "gpgpu"], 'solver.arch = "gpgpu": must be "cpu"'),
        (["--precision", "f16"], 'solver.precision = "f16": must be "f64" or "f32"'),
        (["--threads", "two"], "Invalid value for '--threads'"),
        (["--threads", "-1"], "command line: solver.threads = -1: must be at least 1"),
        (["--speed", "11"], "No such option: --speed"),
        (["--speed", "11"], "; keys of the scene: --set striker.velocity=..."),
        (["--youngs-modulus", "1"], "; keys of the scene: --set material.youngs_modulus=..."),
        (["--wibble", "1"], "; keys of the scene: --set SECTION.KEY=VALUE"),
    ],
    ids=lambda value: value[1][:40] if isinstance(value, list) else "",
)
def test_bad_options_are_refused(
    arguments: list[str], message: str, good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if "notch." in arguments[1]:
        good.write_text(GOOD.replace(STEP, NOTCH))
    assert message in _refused(capsys, "impact", "scene.toml", *arguments)
    assert [path.name for path in good.parent.iterdir()] == ["scene.toml"]


def test_files_that_cannot_be_read_are_refused(
    good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "no.toml: no such scene file" in _refused(capsys, "impact", "no.toml")
    assert "is a directory" in _refused(capsys, "impact", str(good.parent))
    assert "cannot be read: Not a directory" in _refused(capsys, "impact", "scene.toml/x.toml")
    good.write_bytes(b"scenario = 'impact'\n# \xff\n")
    assert "scene.toml: line 2 is not UTF-8" in _refused(capsys, "impact", "scene.toml")


def test_an_existing_run_is_not_overwritten(good: Path, capsys: pytest.CaptureFixture[str]) -> None:
    history = good.parent / "outputs" / "scene" / "history.csv"
    history.parent.mkdir(parents=True)
    history.write_text("time_s\n")
    assert "--force" in _refused(capsys, "impact", "scene.toml")
    assert "--force" in _refused(capsys, "impact", "scene.toml", "--out", str(history.parent))
    assert history.read_text() == "time_s\n"
    assert list(history.parent.iterdir()) == [history]


def test_a_command_refuses_another_one_s_scene(
    good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert 'scenario = "impact": run it with `ldem impact`' in _refused(
        capsys, "bend", "scene.toml"
    )
    assert [path.name for path in good.parent.iterdir()] == ["scene.toml"]


def test_commands_without_set_do_not_name_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--set" not in _refused(capsys, "plot", "x", "--speed", "1")


def test_every_natural_name_leads_to_a_key_that_there_is() -> None:
    for word in NATURAL:
        key = key_for(f"--{word.replace('_', '-')}")
        if word != "radius":  # of several things
            assert key is not None, word
            section, _, name = key.partition(".")
            assert name in TABLES[section].model_fields, word


@pytest.mark.parametrize("force", [[], ["--force"]], ids=["plain", "force"])
@pytest.mark.parametrize("out", ["scene.toml", "scene.toml/run", "/proc/run"])
def test_a_place_that_cannot_hold_a_run_is_refused(
    out: str, force: list[str], good: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if out.startswith("/proc") and not Path("/proc/version").exists():
        pytest.skip("no /proc, the one place where not even root can write")
    assert "run folder" in _refused(capsys, "impact", "scene.toml", "--out", out, *force)
    assert good.read_text() == GOOD


@pytest.mark.parametrize("command", ["render", "plot"])
def test_pictures_need_a_run(command: str, good: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no run folder" in _refused(capsys, command, "nowhere")
    assert "no run folder" in _refused(capsys, command, str(good.parent))


@pytest.mark.parametrize("arguments", [[], ["walk"], ["impact"], ["impact", "a", "b"]], ids=str)
def test_a_command_line_without_sense(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    if arguments:
        _refused(capsys, *arguments)
    else:
        assert main(arguments) == 0
        assert "impact" in capsys.readouterr().out


LISTEN = """
import sys
from taichi_ldem.cli import main
code = main(sys.argv[1:])
print(sorted({name.split(".")[0] for name in sys.modules} & {"taichi", "matplotlib", "scipy"}))
sys.exit(code)
"""


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["impact", "scene.toml", "--set", "striker.mass=nan"], 2),
        (["info", "scene.toml", "--set", "material.failure_strain=0.0224"], 2),
        (["impact", "scene.toml", "--out", "scene.toml"], 2),
        (["--help"], 0),
    ],
    ids=["value", "ductility", "folder", "help"],
)
def test_refusals_and_help_import_nothing_heavy(
    arguments: list[str], code: int, good: Path
) -> None:
    process = subprocess.run(
        [sys.executable, "-c", LISTEN, *arguments], capture_output=True, text=True, timeout=60
    )
    assert process.returncode == code
    assert process.stdout.splitlines()[-1] == "[]"
    assert len(process.stderr.splitlines()) == (1 if code else 0)


def test_a_process_refuses_in_one_line(good: Path) -> None:
    command = [sys.executable, "-m", "taichi_ldem.cli", "impact", "scene.toml", "--threads", "0"]
    process = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert process.returncode == 2
    assert process.stdout == ""
    fault = "command line: solver.threads = 0: must be at least 1 and at most 1024"
    assert process.stderr == f"error: {fault}\n"
