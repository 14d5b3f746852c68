"""Earthquake records: what is exact about their motion, what files say, and their spectra beside
closed forms and a published library's."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from records import DT, synthetic

import mpm_fenicsx as mpm

G = 9.80665
SAMPLES = arrays(float, st.integers(4, 60), elements=st.floats(-5.0, 5.0, width=32))
STEPS = st.sampled_from([0.005, 0.01, 0.02])
EXACT = {"rtol": 0.0, "atol": 1e-12}


# -- the motion ------------------------------------------------------------------------------------


def test_motion_of_a_line_is_a_cubic():
    """a = j t: v = j t²/2, u = j t³/6, between samples too, and v goes on after the end."""
    record = mpm.Record(3.0 * np.linspace(0.0, 2.0, 5), 0.5)
    t = np.linspace(0.0, 2.0, 33)
    np.testing.assert_allclose(record(t), 3.0 * t, **EXACT)
    np.testing.assert_allclose(record.velocity_at(t), 1.5 * t**2, **EXACT)
    np.testing.assert_allclose(record.displacement_at(t), 0.5 * t**3, **EXACT)
    assert record(-1e-3) == record(2.001) == record.velocity_at(-1.0) == 0.0
    assert record(2.0 + 1e-12) == 6.0 and type(record(1.0)) is float
    assert record.velocity_at(5.0) == pytest.approx(6.0, rel=1e-14)
    assert record.displacement_at(5.0) == pytest.approx(4.0 + 18.0, rel=1e-14)


@settings(max_examples=50, deadline=None)
@given(SAMPLES, STEPS, st.integers(1, 7))
def test_a_run_with_steps_that_divide_has_the_exact_velocity(a, dt, parts):
    """And a displacement that is off by (a(t) - a(0)) Δt²/12, Euler and Maclaurin's term."""
    record = mpm.Record(a, dt)
    run = record.integrated(dt / parts)
    np.testing.assert_allclose(run.velocity, record.velocity_at(run.time), **EXACT)
    off = (record(run.time) - a[0]) * (dt / parts) ** 2 / 12.0
    np.testing.assert_allclose(run.displacement - record.displacement_at(run.time), off, **EXACT)
    np.testing.assert_allclose(run.velocity[::parts], record.velocity, **EXACT)


@settings(max_examples=50, deadline=None)
@given(SAMPLES, STEPS)
def test_a_record_of_a_velocity_has_that_velocity(v, dt):
    v[0] = 0.0
    record = mpm.Record.from_velocity(v / 50.0, dt)
    assert record.dt == dt / 2
    np.testing.assert_allclose(record.velocity[::2], v / 50.0, **EXACT)


def test_acceleration_of_a_smooth_velocity_is_of_second_order():
    def off(dt):
        t = dt * np.arange(round(2.0 / dt) + 1)
        record = mpm.Record.from_velocity(np.sin(3.0 * t) ** 2, dt)
        return np.abs(record.acceleration - 3.0 * np.sin(6.0 * record.time)).max()

    assert 3.8 < off(0.02) / off(0.01) < 4.2


@settings(max_examples=50, deadline=None)
@given(SAMPLES, STEPS, st.integers(0, 1), st.sampled_from([None, 0.0, 0.1]))
def test_after_a_baseline_the_ground_is_at_rest(a, dt, more, displacement):
    order = more + (displacement is not None)
    record = mpm.Record(np.pad(a, 4), dt)
    if displacement is not None:
        displacement *= record.duration**2
    record = record.baseline(order, displacement)
    assert abs(record.velocity[-1]) < 1e-11 * (1.0 + record.peak_velocity)
    assert record.acceleration[0] == record.acceleration[-1] == 0.0
    if displacement is not None:
        off = abs(record.displacement[-1] - displacement)
        assert off < 1e-11 * (1.0 + record.peak_displacement)


def test_a_baseline_takes_a_drift_off_and_nothing_else():
    """A polynomial that was put on a record at rest, of velocity without that polynomial."""
    t = np.linspace(0.0, 10.0, 1001)
    drift = 0.05 - 0.02 * t + 0.003 * t**2
    record = mpm.Record(drift, 0.01).baseline(order=2)
    assert record.peak_acceleration < 1e-12
    clean = synthetic().tapered(1.0).baseline()
    again = clean.baseline()
    np.testing.assert_allclose(again.acceleration, clean.acceleration, rtol=0.0, atol=1e-10)


def test_a_baseline_leaves_the_least_velocity():
    """Any other polynomial that ends at rest leaves more."""
    record = synthetic()
    best = record.baseline(order=3)
    s = np.linspace(-1.0, 1.0, len(record.acceleration))
    window = 1.0 - s**2
    for size in (1e-3, -1e-3):
        for k in (1, 3):  # odd in time: they end without velocity
            other = mpm.Record(best.acceleration + size * s**k * window, record.dt)
            assert abs(other.velocity[-1]) < 1e-12
            assert np.sum(other.velocity**2) > np.sum(best.velocity**2)


# -- other records ---------------------------------------------------------------------------------


def test_scaled_padded_cut_and_tapered():
    record = synthetic()
    assert record.scaled(peak=1.0).peak_acceleration == pytest.approx(1.0, rel=1e-14)
    np.testing.assert_array_equal(record.scaled(-2.0).velocity, -2.0 * record.velocity)
    padded = record.padded(0.5, 0.095)
    assert padded.duration == pytest.approx(20.6) and padded(0.5 + 3.21) == record(3.21)
    np.testing.assert_array_equal(padded.cut(0.5, 20.5).acceleration, record.acceleration)
    ones = mpm.Record(np.ones(101), 0.01).tapered(0.2)
    assert ones.acceleration[0] == ones.acceleration[-1] == 0.0
    assert ones(0.1) == pytest.approx(0.5) and ones(0.2) == ones(0.8) == 1.0


def test_a_record_does_not_change():
    record = synthetic()
    with pytest.raises(ValueError, match="read-only"):
        record.acceleration[0] = 1.0
    with pytest.raises(AttributeError):
        record.dt = 1.0
    a = np.ones(3)
    other = mpm.Record(a, 0.1)
    a[:] = 5.0
    assert other.acceleration[1] == 1.0


def sine(frequency, dt=DT, seconds=40.0):
    """Twenty seconds or so of a sine in the middle, m/s²."""
    t = dt * np.arange(round(seconds / dt) + 1)
    return mpm.Record(np.sin(2 * np.pi * frequency * t) * np.sin(np.pi * t / seconds) ** 4, dt)


@pytest.mark.parametrize(
    ("low", "high"), [(None, 2.0), (2.0, None), (0.5, 20.0), (2.5, 4.0), (3.0, None)]
)
@pytest.mark.parametrize("order", [2, 4])
def test_a_filter_leaves_what_butterworth_leaves_twice(low, high, order):
    """Phases stay and 1/(1 + x^2n) of the amplitude, with x = W/W₂, W₁/W or (W² - W₁W₂)/(W (W₂ -
    W₁)) and W = tan(πf dt): bilinear."""
    record = sine(2.0)
    room = 20000
    f = np.fft.rfftfreq(len(record.acceleration) + 2 * room, DT)
    W, W1, W2 = (np.tan(np.pi * DT * one) for one in (f, low or 0.0, high or 0.0))
    with np.errstate(divide="ignore"):
        x = W / W2 if low is None else W1 / W if high is None else (W**2 - W1 * W2) / W / (W2 - W1)
    there = np.fft.rfft(np.pad(record.acceleration, room)) / (1.0 + x ** (2 * order))
    exact = np.fft.irfft(there, n=len(record.acceleration) + 2 * room)[room:-room]
    found = record.filtered(low, high, order)
    np.testing.assert_allclose(found.acceleration, exact, rtol=0.0, atol=1e-6)


def test_at_its_corner_a_filter_leaves_half():
    record = sine(2.0)
    assert record.filtered(high=2.0)(20.0 + 0.125) == pytest.approx(0.5, abs=2e-3)


def test_padding_that_is_kept_holds_what_the_filter_spreads():
    record = mpm.Record(np.pad(np.ones(50), 200), 0.01)
    kept = record.filtered(low=0.5, keep_padding=True)
    pad = (len(kept.acceleration) - len(record.acceleration)) // 2
    assert 2 * pad * record.dt == pytest.approx(1.5 * 4 / 0.5)
    assert abs(kept.velocity[-1]) < 1e-3 < abs(record.filtered(low=0.5).velocity[-1])


def test_finer_steps_are_between_the_samples():
    record = synthetic()
    fine = record.resampled(0.0025)
    np.testing.assert_allclose(fine.velocity[::4], record.velocity, **EXACT)
    assert fine.duration == pytest.approx(record.duration)
    third = record.resampled(0.003)
    np.testing.assert_allclose(third.acceleration, record(third.time), **EXACT)
    assert third.duration >= record.duration - 1e-9


def test_coarser_steps_alias_nothing():
    slow, fast = sine(3.0), sine(30.0)
    np.testing.assert_allclose(
        slow.resampled(0.025).acceleration, sine(3.0, 0.025).acceleration, rtol=0.0, atol=2e-3
    )
    assert fast.resampled(0.025).peak_acceleration < 2e-3  # 30 Hz would show as 10 Hz
    with pytest.raises(ValueError, match=r"1e\+02 % of the record's energy, above 20 Hz, as slow"):
        fast.resampled(0.025, "linear")
    assert slow.resampled(0.025, "linear").peak_acceleration > 0.99


def test_band_limited_steps_restore_a_smooth_wave():
    """Between the samples of eight a period, where a straight line is off by 7 %."""
    record = sine(12.5)
    exact = sine(12.5, DT / 4).acceleration
    off = {m: np.abs(record.resampled(DT / 4, m).acceleration - exact).max() for m in RESAMPLING}
    assert off["band-limited"] < 2e-3 and 0.05 < off["linear"] < 0.09


RESAMPLING = "linear", "band-limited"


# -- in a run --------------------------------------------------------------------------------------

SOIL = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)


def column(dt, **motion):
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 2.0), (1, 2))
    terms = [
        mpm.Fixed(grid.facets("left", "right", "bottom"), "y"),
        mpm.Fixed(grid.facets("bottom"), "x", **motion),
    ]
    return mpm.FiniteElements(grid, SOIL, mpm.Newmark(dt), terms)


def base(run, field):
    return run.nodal(field)[run.grid.space.tabulate_dof_coordinates()[:, 1] < 1e-9, 0]


def shaking():
    """2 s at rest at both ends, 0.1 m away from the start."""
    return synthetic().cut(4.0, 6.0).tapered(0.4).baseline(2, displacement=0.1)


@pytest.mark.parametrize("dt", [0.02, 0.01, 0.005])
def test_a_base_ends_where_the_record_does(dt):
    """At the record's steps, and at half of them; at twice, after it is resampled."""
    record = shaking().resampled(dt) if dt > DT else shaking()
    record = record if dt <= DT else record.tapered(0.1).baseline(2, displacement=0.1)
    run = column(dt, acceleration=record)
    run.until(2.1)
    assert np.abs(base(run, "velocity")).max() < 1e-12
    np.testing.assert_allclose(base(run, "displacement"), 0.1, rtol=0.0, atol=1e-12)


def test_a_base_moves_as_integrated_says():
    record = synthetic()
    with pytest.warns(
        UserWarning, match=r"Fixed: steps of 0\.04 s show .* above 12\.5 Hz, as slow"
    ):
        run = column(0.04, acceleration=record)
    said = record.integrated(0.04, 0.4)
    for _ in range(10):
        run.step()
    np.testing.assert_allclose(base(run, "velocity"), said.velocity[10], rtol=1e-12)
    np.testing.assert_allclose(base(run, "displacement"), said.displacement[10], rtol=1e-12)


def test_a_base_takes_the_whole_motion_at_any_step():
    record = shaking()
    run = column(
        0.003,
        value=record.displacement_at,
        velocity=record.velocity_at,
        acceleration=record,
    )
    for _ in range(100):
        run.step()
    np.testing.assert_allclose(base(run, "velocity"), record.velocity_at(0.3), rtol=1e-12)
    np.testing.assert_allclose(base(run, "displacement"), record.displacement_at(0.3), rtol=1e-11)


def test_a_run_with_a_record_goes_on_after_a_restart(tmp_path):
    record = shaking()
    whole, half = column(0.01, acceleration=record), column(0.01, acceleration=record)
    whole.until(0.4)
    half.until(0.2)
    mpm.Checkpoint(tmp_path / "half.npz")(half)
    again = column(0.01, acceleration=record)
    again.restart(tmp_path / "half.npz")
    again.until(0.4)
    for field in ("displacement", "velocity", "acceleration"):
        np.testing.assert_array_equal(again.nodal(field), whole.nodal(field))
    renamed = mpm.Record(record.acceleration, record.dt, "another name")
    column(0.01, acceleration=renamed).restart(tmp_path / "half.npz")
    with pytest.raises(ValueError, match="term 1, Fixed is"):
        column(0.01, acceleration=record.scaled(1.1)).restart(tmp_path / "half.npz")


def test_steps_that_follow_a_record_are_in_no_doubt():
    record = shaking()
    assert record.doubt_of_steps(0.01) is record.doubt_of_steps(0.0025) is None
    assert "of 0.03 s show" in record.doubt_of_steps(0.03)
    coarse = mpm.Record([0.0, 1.0, -1.0, 0.0], 0.1)
    assert "steps of 0.09 s do not follow the record 'record'" in coarse.doubt_of_steps(0.09)
    abrupt = mpm.Record(np.ones(11), 0.1)  # its last acceleration ends at once
    assert "1.05 m/s instead of 1 m/s" in abrupt.doubt_of_steps(0.1)


# -- spectra ---------------------------------------------------------------------------------------

MISSED = 1.0 - np.cos(np.pi / 100)  # a peak between two looks


def half_sine(period, ζ, duration, t):
    """Displacement, velocity and acceleration + a of an oscillator under a = sin(πt/duration)."""
    ω, Ω = 2 * np.pi / period, np.pi / duration
    s = complex(-ζ * ω, ω * np.sqrt(1 - ζ**2))
    forced = -1.0 / (ω**2 - Ω**2 + 2j * ζ * ω * Ω)  # of exp(iΩt)

    def free(u, v, t):
        c = -1j * (v - s.conjugate() * u) / s.imag  # u = Re c exp(st)
        return np.real(c * np.exp(s * t)), np.real(c * s * np.exp(s * t))

    def during(t):
        u, v = free(-forced.imag, -(1j * Ω * forced).imag, t)
        wave = forced * np.exp(1j * Ω * t)
        return u + wave.imag, v + (1j * Ω * wave).imag

    u, v = during(np.minimum(t, duration))
    u_after, v_after = free(*during(duration), t - duration)
    u, v = np.where(t < duration, u, u_after), np.where(t < duration, v, v_after)
    return u, v, -2 * ζ * ω * v - ω**2 * u


@pytest.mark.parametrize("ζ", [0.0, 0.05, 0.4])
def test_spectrum_of_half_a_sine_is_the_closed_form(ζ):
    """The pulse in 2000 lines is 2e-7 off, and a peak between two looks is missed by 5e-4."""
    duration = 0.5
    record = mpm.Record(np.sin(np.pi * np.arange(2001) / 2000), duration / 2000)
    periods = np.geomspace(0.03, 20.0, 25)
    found = record.response_spectrum(periods, ζ)
    for k, period in enumerate(periods):
        t = np.linspace(0.0, duration + period, 40001)
        exact = [np.abs(one).max() for one in half_sine(period, ζ, duration, t)]
        made = found.displacement[k], found.velocity[k], found.acceleration[k]
        for one, other in zip(made, exact, strict=True):
            assert -1.02 * MISSED < one / other - 1.0 < 1e-4


def test_response_to_straight_lines_is_exact_however_long_they_are():
    """A triangle in three samples: undamped, u = -(r(t) - 2 r(t - d) + r(t - 2d))/d, with the
    response (t - sin(ωt)/ω)/ω² of a ramp."""
    d = 0.7
    record = mpm.Record([0.0, 1.0, 0.0], d)
    periods = np.array([0.05, 0.3, 0.9, 1.4, 5.0, 50.0])
    found = record.response_spectrum(periods, 0.0)
    for k, period in enumerate(periods):
        ω, t = 2 * np.pi / period, np.linspace(0.0, 2 * d + period, 200001)

        def ramp(t, ω=ω):
            return np.where(t > 0.0, (t - np.sin(ω * t) / ω) / ω**2, 0.0)

        exact = np.abs(ramp(t) - 2 * ramp(t - d) + ramp(t - 2 * d)).max() / d
        assert -1.02 * MISSED < found.displacement[k] / exact - 1.0 < 1e-6
    np.testing.assert_allclose(found.pseudo_acceleration, found.acceleration, rtol=1e-12)


def test_spectrum_is_that_of_eqsig():
    """Its numbers are in the file, with how they came about; 0.1 % is asked for."""
    table = np.loadtxt(Path(__file__).parent / "response_spectra_eqsig.txt").T
    found = synthetic().response_spectrum(table[0])
    made = (
        *(found.displacement, found.velocity, found.acceleration),
        *(found.pseudo_velocity, found.pseudo_acceleration),
    )
    assert len(table[0]) == 60
    for one, other in zip(made, table[1:], strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-3)
    record = synthetic()
    assert record.arias_intensity == pytest.approx(1.16179062 * 9.81 / G, rel=1e-8)
    assert record.significant_duration() == pytest.approx(
        8.29, abs=2 * DT
    )  # it counts samples inside


def test_ends_of_a_response_spectrum():
    """A stiff oscillator moves with the ground; a soft one stays where it is."""
    record = shaking()
    found = record.response_spectrum([0.0, 0.004, 300.0], 0.05)
    assert found.pseudo_acceleration[0] == found.acceleration[0] == record.peak_acceleration
    assert found.displacement[0] == found.pseudo_velocity[0] == 0.0
    assert found.acceleration[1] == pytest.approx(record.peak_acceleration, rel=0.02)
    assert found.displacement[2] == pytest.approx(record.peak_displacement, rel=0.02)
    assert found.velocity[2] == pytest.approx(record.peak_velocity, rel=0.02)


def test_fourier_spectrum_of_a_gaussian_is_a_gaussian():
    """∫ exp(-t²/2s²) exp(-2πi f t) dt = s √(2π) exp(-2π² s² f²), and Parseval's sum."""
    s, t = 0.1, 0.01 * np.arange(-200, 201)
    record = mpm.Record(np.exp(-0.5 * (t / s) ** 2), 0.01)
    found = record.fourier_spectrum()
    exact = s * np.sqrt(2 * np.pi) * np.exp(-2.0 * (np.pi * s * found.frequencies) ** 2)
    np.testing.assert_allclose(found.amplitudes, exact, rtol=0.0, atol=1e-12)
    energy = 2 * np.sum(found.amplitudes**2) - found.amplitudes[0] ** 2
    energy *= found.frequencies[1] * np.pi / (2 * G)
    assert energy == pytest.approx(record.arias_intensity, rel=1e-12)


def test_arias_intensity_and_duration_of_a_constant():
    record = mpm.Record(np.full(1001, 2.0), 0.01)
    assert record.arias_intensity == pytest.approx(np.pi / (2 * G) * 40.0, rel=1e-13)
    assert record.significant_duration() == pytest.approx(9.0, rel=1e-12)
    assert record.significant_duration(0.25, 0.75) == pytest.approx(5.0, rel=1e-12)


# -- files -----------------------------------------------------------------------------------------

AT2 = """PEER NGA STRONG MOTION DATABASE RECORD
Somewhere 01, 1/1/1970, Station 1, 090
ACCELERATION TIME SERIES IN UNITS OF G
NPTS=      7, DT=   .0050 SEC
  0.0000000E+00  .1000000E-01 -.2000000E-01  .3000000E+00 -.1500000E+00
  .5000000E-01  0.0000000E+00
"""
IN_G = np.array([0.0, 0.01, -0.02, 0.3, -0.15, 0.05, 0.0])


def test_an_at2_says_all_itself(tmp_path):
    old = AT2.replace("NPTS=      7, DT=   .0050 SEC", "    7   0.0050   NPTS, DT")
    for k, text in enumerate((AT2, old, AT2.replace("      7, DT=   .0050", " 7, DT= 5.0E-03"))):
        path = tmp_path / f"RSN{k}.AT2"
        path.write_text(text)
        record = mpm.Record.read(path)
        np.testing.assert_allclose(record.acceleration, G * IN_G, rtol=1e-15)
        assert record.dt == 0.005 and record.name == f"RSN{k}"
        assert mpm.Record.read(path, unit="g", dt=0.005, name="a").name == "a"


TABLES = {
    "comma": "time (s),north,east\n0.00,0.0,1\n0.01,0.1,2\n0.02,-0.2,3\n",
    "no names": "0.00,0.0,1\n0.01,0.1,2\n0.02,-0.2,3\n",
    "semicolon": "time (s);north;east\n0,00;0,0;1\n0,01;0,1;2\n0,02;-0,2;3\n",
    "tab": "# of somewhere\ntime (s)\tnorth\teast\n0.00\t0.0\t1\n0.01\t0.1\t2\n0.02\t-0.2\t3\n",
    "blanks": "   0.00   0.0  1  # rest\n   0.01   1.0e-1  2\n\n   0.02  -0.2  3",
    "comma at the end": "t,a,b,\n0.00,0.0,1,\n0.01,0.1,2,\n0.02,-0.2,3,\n",
    "from 10 s": "t a b\n10.00 0.0 1\n10.01 0.1 2\n10.02 -0.2 3\n",
}


@pytest.mark.parametrize("kind", TABLES)
def test_columns(kind, tmp_path):
    path = tmp_path / "somewhere.csv"
    path.write_text(TABLES[kind])
    record = mpm.Record.read(path, unit="m/s2", column=1, time_column=0)
    np.testing.assert_array_equal(record.acceleration, [0.0, 0.1, -0.2])
    assert record.dt == 0.01 and record.name == "somewhere"
    if "time (s)" in TABLES[kind]:
        record = mpm.Record.read(path, unit="gal", column="north", time_column="time (s)")
        np.testing.assert_allclose(record.acceleration, [0.0, 0.001, -0.002], rtol=1e-15)


def test_one_and_two_columns_need_no_choice(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("Station\nof 1970\n0.0\n0.1\n-0.2\n")
    for unit, one in (("g", G), ("m/s²", 1.0), ("cm/s2", 0.01)):
        record = mpm.Record.read(path, unit=unit, dt=0.02, skip=2)
        np.testing.assert_allclose(record.acceleration, one * np.array([0.0, 0.1, -0.2]))
    path.write_text("0 0.0\n0.0033 0.1\n0.0067 -0.2\n0.01 0.0\n")  # thirds of 0.01, rounded
    assert mpm.Record.read(path, unit="g").dt == pytest.approx(0.01 / 3, rel=1e-9)


REFUSED = [
    (
        "a.AT2",
        AT2.replace("      7", "      8"),
        {},
        "NPTS is 8 in the header, and there are 7 val",
    ),
    ("a.at2", AT2.split("SEC\n")[1], {}, "an AT2 has the number of samples and their step in its"),
    ("a.AT2", AT2.replace("ACCELERATION", "VELOCITY"), {}, "the header says velocity, and a recor"),
    ("a.AT2", AT2.replace(".3000000E+00", "*"), {}, r"line 5 is not of numbers: .*\*"),
    ("a.AT2", AT2.replace(".3000000E+00", "NaN"), {}, "value 4 of 7 is nan"),
    ("a.AT2", AT2, {"unit": "cm/s2"}, "the header says units of g, got unit='cm/s2'"),
    ("a.AT2", AT2, {"dt": 0.01}, "the file's step is 0.005 s, got dt=0.01"),
    ("a.AT2", AT2, {"column": 1}, "an AT2 has no columns to choose from"),
    ("a.AT2", AT2.replace("OF G", ""), {}, 'unit must be given, .* "g", "m/s2" or "cm/s2"'),
    (
        "a.AT2",
        AT2.replace(".3000000E+00", ".3E+02"),
        {},
        r"30 in 'g' .* 'm/s2' \(3.06 g\) or 'cm/s",
    ),
    ("a.txt", "0\n400\n0\n", {"unit": "m/s2", "dt": 0.01}, r"40.8 g, .* to be 'cm/s2' \(0.408 g\)"),
    ("a.txt", "0\n1\n0\n", {"dt": 0.01}, "unit must be given"),
    ("a.txt", "0\n1\n0\n", {"unit": "ft/s2", "dt": 0.01}, "unit must be one of g, m/s2.*'ft/s2'"),
    ("a.txt", "0\n1\n0\n", {"unit": "g"}, "dt must be given, for the file has no column of time"),
    (
        "a.txt",
        "0 1\n.1 2\n.3 3\n.4 4\n",
        {"unit": "g"},
        "steps of time must be equal, got 0.1 s mos",
    ),
    ("a.txt", "0 1\n0 2\n0 3\n", {"unit": "g"}, "steps of time must be equal, got 0 s mostly"),
    (
        "a.txt",
        "0 1 2\n.1 2 3\n",
        {"unit": "g"},
        "column must say where accelerations are, one of 0",
    ),
    (
        "a.txt",
        "0 1 2\n1 2 3\n",
        {"unit": "g", "column": 1},
        "time_column, one of 0, 1, 2, or dt mus",
    ),
    ("a.txt", "0 1\n1 2\n", {"unit": "g", "dt": 0.1}, "column must say where accelerations are"),
    ("a.txt", "0 1\n1 2\n", {"unit": "g", "column": 2}, "column must be one of 0, 1, got 2"),
    ("a.txt", "0 1\n1 2\n", {"unit": "g", "column": "a"}, "column must be one of 0, 1, got 'a'"),
    ("a.csv", "t,a\n0,1\n1,2\n", {"unit": "g", "column": "A"}, "one of 0 't', 1 'a', got 'A'"),
    ("a.csv", "t,a\n0,1\n1,\n", {"unit": "g"}, "value 2 of 2 is nan"),
    ("a.csv", "t,a\n0,1\n1,x\n", {"unit": "g"}, "'x' in row 2 of column 'a' is no number"),
    ("a.csv", "t,a\n", {"unit": "g"}, "there are no values after the line"),
    ("a.csv", "t,a\n0,1\n", {"unit": "g"}, "a record has two samples or more, got 1"),
    ("a.txt", "Of 1970\n0 1 2\n1 2 3 4\n", {"unit": "g"}, "not all as many columns"),
    ("a.txt", "\n\n", {"unit": "g"}, "has no lines"),
    ("a.txt", "# a\n", {"unit": "g"}, "nothing but comments"),
    ("a.txt", "0 1\n1 2\n", {"unit": "g", "column": 0, "time_column": 0}, "are the same, 0"),
]


@pytest.mark.parametrize(("name", "text", "given", "words"), REFUSED, ids=lambda x: str(x)[:30])
def test_files_that_are_refused(name, text, given, words, tmp_path):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(ValueError, match=words) as found:
        mpm.Record.read(path, **given)
    assert str(path) in str(found.value) or "unit must be one" in str(found.value)


def test_a_file_that_is_not_there_is_said_by_python():
    with pytest.raises(OSError, match=r"nowhere\.AT2"):
        mpm.Record.read("nowhere.AT2")


BAD = [
    (lambda r: mpm.Record([1.0], 0.1), r"a row of 2 samples or more, got shape \(1,\)"),
    (lambda r: mpm.Record([[1.0, 2.0]], 0.1), r"got shape \(1, 2\)"),
    (lambda r: mpm.Record([1.0, np.nan], 0.1), "acceleration must be finite, got nan at sample 1"),
    (lambda r: mpm.Record([1.0, 2.0], 0.0), "dt must be positive, got 0.0"),
    (lambda r: mpm.Record([1.0, 2.0], 0.1, name=3), "name must be a text, got 3"),
    (
        lambda r: mpm.Record.from_velocity([1.0, 2.0, 0.0], 0.1),
        "must start from zero, .* got 1 m/s",
    ),
    (lambda r: r.scaled(), "scaled takes a factor, or a peak"),
    (lambda r: r.scaled(2.0, peak=1.0), "one of them"),
    (lambda r: r.scaled(peak=-1.0), "peak must be positive, got -1.0"),
    (lambda r: r.scaled(0.0).scaled(peak=1.0), "has no acceleration to scale"),
    (lambda r: r.padded(before=-1.0), "before must not be negative, got -1 s"),
    (lambda r: r.cut(3.0, 2.0), "in order between 0 and 20 s, got 3 and 2 s"),
    (lambda r: r.cut(0.0, 21.0), "got 0 and 21 s"),
    (lambda r: r.cut(0.001, 0.0011), "two samples between them, 0.01 s apart"),
    (lambda r: r.tapered(11.0), "at most half the duration of 20 s, got 11"),
    (lambda r: r.baseline(order=-1), "order must be a whole number of at least 0, got -1"),
    (lambda r: r.baseline(0, displacement=0.0), "order must be 1 or more for a displacement"),
    (lambda r: r.cut(0.0, 0.03).baseline(order=3), "order must be less than 2 for 4 samples"),
    (lambda r: r.filtered(), "filtered needs low or high"),
    (lambda r: r.filtered(high=60.0), "high must lie between 0 and 50 Hz, .* got 60 Hz"),
    (lambda r: r.filtered(2.0, 1.0), "low must be below high, got 2 and 1 Hz"),
    (
        lambda r: r.resampled(0.01, "cubic"),
        "method must be one of linear, band-limited, got 'cubic",
    ),
    (lambda r: r.resampled(0.01 * np.pi), "ratio of whole numbers up to 1000"),
    (lambda r: r.response_spectrum([-1.0]), r"periods must be a row of seconds, .* got \[-1.0\]"),
    (lambda r: r.response_spectrum([1.0], 5.0), r"damping must lie in \[0, 1\), .* got 5.0"),
    (lambda r: r.scaled(0.0).significant_duration(), "has no acceleration at all"),
    (lambda r: r.integrated(0.0), "dt must be positive, got 0.0"),
]


@pytest.mark.parametrize(("make", "words"), BAD, ids=lambda x: x if isinstance(x, str) else "")
def test_what_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make(synthetic())


def test_more_than_the_ground_has_done_is_told():
    with pytest.warns(UserWarning, match=r"400 in 'm/s2' is 40.8 g.*likely to be 'cm/s2'"):
        mpm.Record([0.0, 400.0, 0.0], 0.01)


def test_a_record_in_one_line():
    assert str(shaking()).startswith(
        "Record 'synthetic': 2 s, 201 samples every 0.01 s; peaks "
    ) and str(shaking()).endswith("; at the end 0 m/s, 0.1 m")
    assert "\n" not in repr(synthetic())


def test_pictures(tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    record = synthetic()
    axes = record.plot(save=tmp_path / "new" / "motion.png")
    np.testing.assert_array_equal(axes[1].lines[0].get_ydata(), record.velocity)
    assert [ax.get_ylabel().split(", ")[1] for ax in axes] == ["m/s²", "m/s", "m"]
    spectrum = record.response_spectrum(np.geomspace(0.1, 4.0, 9))
    ax = spectrum.plot(save=tmp_path / "response.png")
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), spectrum.pseudo_acceleration)
    assert spectrum.plot(ax) is ax and len(ax.lines) == 2
    record.fourier_spectrum().plot(save=tmp_path / "fourier.png")
    assert {p.name for p in tmp_path.rglob("*.png")} == {
        "motion.png",
        "response.png",
        "fourier.png",
    }


def test_a_record_is_no_displacement_and_names_its_direction():
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (1, 1))
    base, soil = grid.facets("bottom"), mpm.LinearElastic(1e7, 0.3, 1800.0)
    record = mpm.Record(np.array([0.0, 0.1, 0.0]), 0.1)
    rates = {"velocity": record.velocity_at, "acceleration": record}
    for motion in ({"value": record}, {"value": record, **rates}):
        with pytest.raises(ValueError, match="value of Fixed must not be a Record"):
            mpm.FiniteElements(grid, soil, mpm.Newmark(0.1), [mpm.Fixed(base, "x", **motion)])
    with pytest.warns(UserWarning, match="Fixed moves x and y alike by one Record"):
        mpm.FiniteElements(grid, soil, mpm.Newmark(0.1), [mpm.Fixed(base, acceleration=record)])


@pytest.mark.parametrize(
    "header, unit, words",
    [
        ("t (s),acc (g)", "gal", r"named 'acc \(g\)', got unit='gal'"),
        ("t (s),a [cm/s^2]", "m/s2", "got unit='m/s2'"),
        ("t (ms),acc (g)", "g", r"time must be in s, and its column is named 't \(ms\)'"),
    ],
)
def test_units_that_contradict_a_header_are_refused(tmp_path, header, unit, words):
    path = tmp_path / "a.csv"
    path.write_text(f"{header}\n0,0\n0.01,0.2\n0.02,0\n")
    with pytest.raises(ValueError, match=words):
        mpm.Record.read(path, unit=unit)


def test_units_that_agree_with_a_header_are_read(tmp_path):
    path = tmp_path / "a.csv"
    for name, unit in (("a (cm/s²)", "gal"), ("a (g)", "g"), ("a (EW)", "g"), ("a", "m/s2")):
        path.write_text(f"t (s),{name}\n0,0\n0.01,0.2\n0.02,0\n")
        assert len(mpm.Record.read(path, unit=unit).acceleration) == 3
