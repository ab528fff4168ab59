"""The wave scenario: what is refused, what a run leaves, and how its numbers are read."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.paths import CONFIGS

from taichi_ldem.cli import main
from taichi_ldem.errors import SceneError
from taichi_ldem.scenarios.wave import Packet, delay, phase_difference
from taichi_ldem.scene import load_scene
from taichi_ldem.storage.folder import RunFolder

SHEAR = [  # a block 24 x 40 x 40 modules, along another axis
    "plate.size=[0.0096, 0.016, 0.016]",
    "plate.modules_through_thickness=40",
    "pulse.axis=x",
    "pulse.kind=shear",
    "pulse.wavelength=0.0024",
    "pulse.position=-0.003",
    "pulse.probes=[-0.0016, -0.0004]",
    "solver.duration=4.2e-6",
    "output.history_interval=4e-8",
]


def _ldem(scene: str, out: Path, settings: list[str]) -> RunFolder:
    words = [word for text in settings for word in ("--set", text)]
    command = [sys.executable, "-m", "taichi_ldem.cli", "wave", str(CONFIGS / f"{scene}.toml")]
    done = subprocess.run(
        [*command, "--out", str(out), "--threads", "1", *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return RunFolder.open(out)


def test_a_pulse_through_a_bar_is_the_exact_one(tmp_path: Path) -> None:
    folder = _ldem("wave_quick", tmp_path / "run", [])
    summary = folder.read_summary()
    assert summary["waveform_error"] < 2e-3
    assert summary["speed_cross_correlation_error"] == pytest.approx(0.0, abs=1e-3)
    assert len(summary["dispersion"]) >= 4
    assert summary["dispersion_largest_error"] < 5e-3
    assert summary["side_arrival_s"] is None
    # two modules across: the long-wave speed is 2.1 % below sqrt(E / rho), see docs/waves.md
    speed = summary["lattice_long_wave_speed_m_s"] / np.sqrt(3.35e9 / 1190)
    assert speed == pytest.approx(0.979, abs=1e-3)
    for name in ("probes.csv", "profiles.csv", "pulse.png", "dispersion.png", "anisotropy.png"):
        assert (folder.path / name).stat().st_size > 1000
    probes = np.genfromtxt(folder.path / "probes.csv", delimiter=",", names=True)
    assert probes.dtype.names[:3] == ("time_s", "probe_1_m", "probe_2_m")
    # the largest strain of a Gaussian in displacement, u0 / w exp(-1/2), is the scene's 1e-6
    first = np.abs(probes["probe_1_m"]).max()
    assert first == pytest.approx(1e-6 * 0.008 / (2 * np.pi) * np.exp(0.5), rel=0.1)
    # --force takes them away again, and nothing else
    RunFolder.create(folder.path, force=True)
    assert sorted(path.name for path in folder.path.iterdir()) == ["run.json", "run.lock"]


@pytest.mark.slow
def test_a_pulse_through_a_bar_whose_modules_have_a_volume_is_the_exact_one(tmp_path: Path) -> None:
    summary = _ldem("wave_quick", tmp_path / "run", ["material.poisson_ratio=0.36"]).read_summary()
    assert summary["waveform_error"] < 1e-4
    assert abs(summary["speed_cross_correlation_error"]) < 1e-6
    assert len(summary["dispersion"]) >= 4
    assert summary["dispersion_largest_error"] < 5e-4


def test_modules_have_a_volume_where_bars_alone_are_not_isotropic() -> None:
    """The pulse then has the speed of the solid, and corner and centre nodes move apart in it."""
    loaded = load_scene(CONFIGS / "wave_thickness.toml", ["material.poisson_ratio=0.36"])
    assert loaded.plate.stiffness == "volumetric"
    packet = Packet(loaded)
    packet.check()
    speed = packet.frequencies[1] / packet.wave_numbers[1]
    assert speed / packet.reference[1] == pytest.approx(1.0, abs=1e-3)
    shares = np.abs(packet.probe_amplitudes / packet.amplitudes)
    assert shares[0] == pytest.approx(1.0)
    assert shares[len(shares) // 2] < 0.99
    still = load_scene(CONFIGS / "wave_thickness.toml")
    assert still.plate.stiffness == "equation-2"
    np.testing.assert_array_equal(Packet(still).probe_amplitudes, Packet(still).amplitudes)


@pytest.mark.slow
def test_a_shear_pulse_through_a_plate_is_the_exact_one(tmp_path: Path) -> None:
    folder = _ldem("wave_thickness", tmp_path / "run", SHEAR)
    summary = folder.read_summary()
    assert summary["long_wave_formula"] == "sqrt(C44/rho)"
    assert summary["long_wave_speed_m_s"] == pytest.approx(np.sqrt(0.4 * 3.35e9 / 1190))
    assert summary["waveform_error"] < 2e-3
    assert summary["dispersion_largest_error"] < 5e-3
    profiles = np.genfromtxt(folder.path / "profiles.csv", delimiter=",", names=True)
    np.testing.assert_allclose(
        profiles["displacement_m"],
        profiles["exact_m"],
        atol=2e-3 * np.abs(profiles["exact_m"]).max(),
    )


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("pulse.wavelength=0.001", r"pulse\.wavelength = 0\.001: must be at least 0\.0021"),
        ("pulse.axis=w", r'pulse\.axis = "w": must be "x", "y" or "z"'),
        ("pulse.amplitude=0.1", r"pulse\.amplitude = 0\.1: must be at most 0\.01"),
        ("pulse.probes=[0.016, -0.032]", r"pulse\.probes = .*in rising order between -0\.064 and"),
        ("pulse.position=-0.06", r"pulse\.position = -0\.06: must be at least -0\.056"),
        ("pulse.probes=[-0.045, 0.016]", r"pulse\.probes = .*the first must be at least -0\.044"),
        ("solver.duration=3e-5", r"solver\.duration = 3e-05: .*the run ends"),
        ("pulse.probes=[-0.032, 0.062]", r"pulse\.probes = .*its echo"),
        ("pulse.kind=longitudinal", r"plate\.size = .*take a wider plate"),
        ("plate.shape=disc", r"plate\.shape"),
        ("clamp.kind=rim", r"clamp"),
        ("floor.gap=0.0", r"table '\[floor\]': cannot be used with \[pulse\]"),
        ("plate.gravity=[0.0, 0.0, -9.81]", r"plate\.gravity = .*cannot be used with \[pulse\]"),
        ("plate.velocity=[1.0, 0.0, 0.0]", r"plate\.velocity = .*cannot be used with \[pulse\]"),
        ("scenario=impact", r'scenario = "impact": must be "wave" with a table \[pulse\]'),
        ("pulse.length=1", r"unknown key 'pulse\.length'"),
    ],
)
def test_a_scene_that_cannot_be_measured_is_refused(
    setting: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, out = str(CONFIGS / "wave.toml"), str(tmp_path / "run")
    assert main(["wave", scene, "--out", out, "--set", setting]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert re.search(message, error), error
    assert not Path(out).exists()


def test_each_command_runs_its_own_scenes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["impact", str(CONFIGS / "wave.toml")]) == 2
    assert "run it with `ldem wave`" in capsys.readouterr().err
    assert main(["wave", str(CONFIGS / "impact.toml")]) == 2
    assert "run it with `ldem impact`" in capsys.readouterr().err


def test_supports_would_disturb_a_pulse() -> None:
    settings = ["supports.span=0.024", "supports.diameter=0.004"]
    with pytest.raises(SceneError, match=r"table '\[supports\]': cannot be used with \[pulse\]"):
        load_scene(CONFIGS / "wave.toml", settings)


def test_a_pulse_is_needed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (CONFIGS / "wave.toml").read_text()
    start, end = text.index("[pulse]"), text.index("[solver]")
    file = tmp_path / "none.toml"
    file.write_text(text[:start] + text[end:])
    assert main(["wave", str(file)]) == 2
    assert "missing table '[pulse]'" in capsys.readouterr().err


@pytest.mark.parametrize("scene", ["wave", "wave_quick", "wave_thickness"])
def test_shipped_scenes_have_whole_modules_and_small_strain(scene: str) -> None:
    loaded = load_scene(CONFIGS / f"{scene}.toml")
    assert loaded.plate.actual_size == pytest.approx(loaded.plate.size, rel=1e-9)
    assert not loaded.material.damage
    assert loaded.pulse is not None
    assert loaded.pulse.amplitude == 1e-6


def test_delay_and_phase_of_a_shifted_signal() -> None:
    time = np.linspace(0.0, 20.0, 401)
    lag = 3.217  # not a whole number of samples
    signals = np.exp(-0.5 * np.stack([time - 6, time - 6 - lag], axis=1) ** 2)
    assert delay(time, signals) == pytest.approx(lag, abs=1e-4)
    for omega in (0.3, 1.0, 2.5):  # the last turns more than once
        turn = phase_difference(time, signals, omega, near=omega * lag + 1.0)
        assert turn == pytest.approx(omega * lag, rel=1e-6)
