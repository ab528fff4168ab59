import numpy as np
import pytest

from taichi_ldem.analysis.signals import (
    ForcePeaks,
    Puncture,
    damage_onset,
    energy_failure,
    force_peaks,
    low_pass,
    puncture,
    smooth_force,
    velocity_failure,
)

TIME = np.arange(0.0, 10e-3, 1e-5)  # s, the default sampling
ONSET = 1.0e-3
WINDOW = 0.2e-3


def _record(*corners: tuple[float, float]) -> np.ndarray:
    """A force of straight lines between (ms, N)."""
    at, force = np.array(corners).T
    return np.interp(TIME, 1e-3 * at, force)


# a hump, a valley a quarter deep, a higher one, failure; the tops are wider than the filter
TWO_PEAKS = (0, 0), (1.5, 600), (2.0, 600), (2.5, 450), (6.0, 750), (6.5, 750), (6.6, 100), (10, 90)


def test_the_filter_keeps_straight_lines_and_the_ends() -> None:
    line = 300.0 + 2e5 * TIME
    np.testing.assert_allclose(smooth_force(TIME, line, WINDOW), line, rtol=1e-10)
    assert smooth_force(TIME[:1], np.array([3.0]), WINDOW)[0] == 3.0


def test_the_filter_averages_a_fifth_of_a_millisecond() -> None:
    omega = 2 * np.pi * 2500.0
    smooth = smooth_force(TIME, np.sin(omega * TIME), WINDOW)
    # mean of 21 samples of a sine: sin(21 x / 2) / (21 sin(x / 2)), and no shift in time
    x = omega * 1e-5
    gain = np.sin(21 * x / 2) / (21 * np.sin(x / 2))
    inner = slice(10, -10)
    np.testing.assert_allclose(smooth[inner], gain * np.sin(omega * TIME)[inner], atol=1e-11)


def test_onset_is_a_thousandth_of_a_crack_through_the_thickness() -> None:
    fracture = 1e-3 * np.maximum(0.0, TIME - 2e-3)  # W = 1 mW from 2 ms on
    # 1e-3 x 1034 J/m2 x (1 mm)^2 = 1.034e-6 J is passed 1.034 ms later
    assert damage_onset(TIME, fracture, 1034.0, 1e-3) == pytest.approx(3.04e-3, abs=1e-9)
    assert damage_onset(TIME, 0 * fracture, 1034.0, 1e-3) is None


def test_two_peaks_and_failure() -> None:
    peaks = force_peaks(TIME, _record(*TWO_PEAKS), ONSET, WINDOW)
    assert peaks.first_force == pytest.approx(600.0, rel=1e-10)
    assert 1.59e-3 <= peaks.first_time <= 1.91e-3  # on the top, a filter's half width inside
    assert peaks.second_force == pytest.approx(750.0, rel=1e-10)
    assert 6.09e-3 <= peaks.second_time <= 6.41e-3
    # the average is half of 750 where the window holds 0.2 ms of a fall of 650 N in 0.1 ms:
    # x = t - 6.5 ms: 750 (0.1 - x) + 425 0.1 + 100 x = 0.2 x 375, so x = 0.0654 (ms)
    assert peaks.failure_time == pytest.approx(6.57e-3, abs=1.5e-5)


def test_noise_and_an_inertial_peak_before_onset_change_nothing() -> None:
    noise = 60.0 * np.sin(2 * np.pi * 20e3 * TIME)
    inertial = 500.0 * np.exp(-(((TIME - 0.5e-3) / 0.1e-3) ** 2))
    plain = force_peaks(TIME, _record(*TWO_PEAKS), ONSET, WINDOW)
    noisy = force_peaks(TIME, _record(*TWO_PEAKS) + noise + inertial, ONSET, WINDOW)
    assert noisy.first_force == pytest.approx(plain.first_force, rel=0.02)
    assert noisy.second_force == pytest.approx(plain.second_force, rel=0.02)
    assert noisy.failure_time == pytest.approx(plain.failure_time, abs=2e-5)


def test_a_fall_of_less_than_three_percent_is_no_peak() -> None:
    shallow = _record((0, 0), (1.5, 600), (2, 600), (2.5, 585), (6, 750), (6.5, 750), (6.6, 50))
    peaks = force_peaks(TIME, shallow, ONSET, WINDOW)
    assert peaks.first_force == pytest.approx(750.0, rel=1e-10)
    assert peaks.second_force is None
    assert peaks.failure_time == pytest.approx(6.57e-3, abs=2e-5)


def test_what_a_record_does_not_show_is_none() -> None:
    rising = _record((0, 0), (10, 900))
    assert force_peaks(TIME, rising, ONSET, WINDOW) == ForcePeaks()
    assert force_peaks(TIME, _record(*TWO_PEAKS), None, WINDOW) == ForcePeaks()
    cut = TIME < 5e-3  # ends before the plate fails
    peaks = force_peaks(TIME[cut], _record(*TWO_PEAKS)[cut], ONSET, WINDOW)
    assert peaks.first_force == pytest.approx(600.0, rel=1e-10)
    assert (peaks.second_force, peaks.second_time, peaks.failure_time) == (None, None, None)


def test_what_comes_back_after_failure_is_no_peak() -> None:
    plain = force_peaks(TIME, _record(*TWO_PEAKS), ONSET, WINDOW)
    back = _record(*TWO_PEAKS[:-1], (7.5, 100), (8, 800), (8.5, 800), (8.6, 20), (10, 20))
    assert force_peaks(TIME, back, ONSET, WINDOW) == plain


def test_cracks_that_pop_in_are_no_failure() -> None:
    """The force falls to a third at once and comes back; the onset is the moment of the fall."""
    plain = (1.75, 600), (1.8, 200), (3, 350), (6.5, 700), (6.6, 50), (10, 50)
    peaks = force_peaks(TIME, _record((0, 0), *plain), 1.75e-3, WINDOW)
    # the average over 0.2 ms of a force that rises by 600 N in 1.75 ms is largest 0.1 ms before
    # the fall, or a little later, as the fall takes 0.05 ms
    assert peaks.first_time == pytest.approx(1.66e-3, abs=2e-5)
    assert peaks.first_force == pytest.approx(600 * 1.66 / 1.75, rel=0.01)
    assert peaks.second_force == pytest.approx(690.0, rel=0.02)
    assert peaks.failure_time == pytest.approx(6.57e-3, abs=2e-5)


def test_a_plate_that_fails_at_its_first_peak_has_no_second() -> None:
    debris = (3.0, 100), (3.2, 150), (3.4, 20), (10, 20)  # the plug, caught by the striker
    record = _record((0, 0), (1.5, 600), (2.0, 600), (2.1, 50), *debris)
    peaks = force_peaks(TIME, record, ONSET, WINDOW)
    assert peaks.first_force == pytest.approx(600.0, rel=1e-10)
    assert (peaks.second_force, peaks.second_time) == (None, None)
    # half of 600 where the window holds 0.2 ms of a fall of 550 N in 0.1 ms, x = t - 2 ms:
    # 600 (0.1 - x) + 325 0.1 + 50 x = 0.2 x 300, so x = 0.0591 (ms)
    assert peaks.failure_time == pytest.approx(2.065e-3, abs=1.0e-5)


@pytest.mark.parametrize("frequency", [300.0, 1460.0, 3000.0, 8000.0])
def test_the_low_pass_has_butterworths_gain_and_no_delay(frequency: float) -> None:
    time = np.arange(0.0, 40e-3, 1e-5)
    cutoff = 1460.0
    wave = np.sin(2 * np.pi * frequency * time)
    filtered = low_pass(time, wave, cutoff, None)
    # |H|^2 of the second order after the bilinear transform, once for each direction
    warped = np.tan(np.pi * frequency * 1e-5) / np.tan(np.pi * cutoff * 1e-5)
    inner = (time > 10e-3) & (time < 30e-3)
    np.testing.assert_allclose(filtered[inner], wave[inner] / (1 + warped**4), atol=1e-6)


def test_the_low_pass_begins_at_t1_and_keeps_lines() -> None:
    line = 300.0 + 2e5 * TIME
    filtered = low_pass(TIME, line, 1460.0, 1.75e-3)
    assert np.isnan(filtered[TIME < 1.7499e-3]).all()
    np.testing.assert_allclose(filtered[TIME >= 1.7499e-3], line[TIME >= 1.7499e-3], rtol=1e-6)
    assert np.isnan(low_pass(TIME, line, 1460.0, TIME[-5])).all()


def test_failure_by_energy_is_the_largest_strain_energy_if_it_is_lost() -> None:
    strain, nothing = np.where(TIME < 7e-3, 1e6 * TIME**2, 5.0), 0 * TIME
    assert energy_failure(TIME, strain, 1e-3, nothing) == pytest.approx(6.99e-3, abs=1e-9)
    assert energy_failure(TIME, 1e6 * TIME**2, 1e-3, nothing) is None  # never lost
    assert energy_failure(TIME, nothing, 1e-3, nothing) is None
    assert energy_failure(TIME[:0], TIME[:0], 1e-3, TIME[:0]) is None


def test_a_plate_that_springs_back_has_no_failure_by_energy() -> None:
    strain, nothing = np.where(TIME < 7e-3, 1e6 * TIME**2, 5.0), 0 * TIME
    assert energy_failure(TIME, strain, None, nothing) is None  # nothing is damaged
    assert energy_failure(TIME, strain, 8e-3, nothing) is None  # damaged later
    lost = strain[TIME < 7e-3][-1] - 5.0
    for share, failed in ((0.4, True), (0.6, False)):
        given_back = np.where(TIME < 7e-3, 3.0, 3.0 + share * lost)
        assert (energy_failure(TIME, strain, 1e-3, given_back) is not None) == failed


def test_failure_by_velocity_is_where_the_deceleration_ends() -> None:
    """600 N with 200 N of oscillation at 1.46 kHz on 18.49 kg, which ends at 7.5 ms."""
    force = 600.0 + 200.0 * np.sin(2 * np.pi * 1460.0 * TIME)
    for gravity in (0.0, 9.81):
        pull = np.where(TIME < 7.5e-3, force / 18.49, 0.0) - gravity
        velocity = 1.065 - np.append(0.0, np.cumsum(pull[:-1] * 1e-5))
        assert velocity_failure(TIME, velocity, ONSET, WINDOW) == pytest.approx(7.5e-3, abs=5e-5)
        # a record that ends a tenth of a millisecond later still shows it
        short = TIME < 7.61e-3
        assert velocity_failure(TIME[short], velocity[short], ONSET, WINDOW) == pytest.approx(
            7.5e-3, abs=5e-5
        )
        assert velocity_failure(TIME, velocity, None, WINDOW) is None
    steady = 1.065 - 600.0 / 18.49 * TIME
    assert velocity_failure(TIME, steady, ONSET, WINDOW) is None


def test_puncture_of_a_spring_that_breaks() -> None:
    """F = k s up to 4 mm at 1 m/s, then nothing: the energy is k s^2 / 2."""
    stiffness, displacement = 200e3, 1.0 * TIME
    # the history's force is the mean since the last sample
    middle = displacement - 0.5e-5
    force = np.where((displacement > 0) & (displacement <= 4e-3 + 1e-9), stiffness * middle, 0.0)
    found = puncture(TIME, force, displacement, WINDOW)
    # the average over 0.2 ms is largest 0.1 ms before the end: 780 N
    assert found.peak_load == pytest.approx(stiffness * 3.9e-3, rel=0.01)
    assert found.peak_time == pytest.approx(3.9e-3, abs=2e-5)
    assert found.peak_deflection == pytest.approx(3.9e-3, abs=2e-5)
    assert found.peak_energy == pytest.approx(stiffness * 3.9e-3**2 / 2, rel=0.01)
    assert found.total_energy == pytest.approx(stiffness * 4e-3**2 / 2, rel=1e-6)
    assert puncture(TIME, 0 * force, displacement, WINDOW) == Puncture()


def test_a_force_that_fell_long_before_the_onset_has_no_peak_there() -> None:
    """Before, the force half a window before the onset was the peak, whatever it was."""
    thrown_back = _record((0, 0), (0.3, 200), (1.2, 0), (10, 0))
    assert force_peaks(TIME, thrown_back, 0.8e-3, WINDOW) == ForcePeaks()
    again = _record((0, 0), (0.3, 200), (1.2, 20), (3.0, 600), (3.4, 600), (3.5, 50), (10, 50))
    peaks = force_peaks(TIME, again, 0.8e-3, WINDOW)
    assert peaks.first_force == pytest.approx(600.0)
    assert peaks.failure_time == pytest.approx(3.46e-3, abs=2e-5)


@pytest.mark.parametrize("falls", [2.295, 2.299, 2.301])
def test_a_force_that_falls_within_the_sample_of_the_onset_has_its_peak_before(
    falls: float,
) -> None:
    """The plate cracks at once; the ledger shows it at the sample that follows, here 2.30 ms."""
    force = _record((0, 0), (falls, 750), (falls + 0.001, 100), (2.4, 400), (2.6, 200), (10, 200))
    peaks = force_peaks(TIME, force, 2.3e-3, WINDOW)
    # the mean over 0.2 ms is largest a tenth of a millisecond before the fall: 717 N
    assert peaks.first_force == pytest.approx(750 * 2.2 / 2.3, rel=0.01)
    assert peaks.first_time == pytest.approx(2.2e-3, abs=2e-5)


def test_a_striker_that_is_thrown_back_has_not_broken_the_plate() -> None:
    velocity = np.interp(TIME, [0.0, 2e-3, 10e-3], [2.0, -1.0, -1.0])  # leaves the plate at 2 ms
    assert velocity_failure(TIME, velocity, ONSET, WINDOW) is None
    through = velocity_failure(TIME, velocity + 2.0, ONSET, WINDOW)
    assert through == pytest.approx(2e-3, abs=2 * WINDOW)
