"""Earthquake records: acceleration at equal steps of time, with the motion that it makes."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..common.checks import array, between, finite, in_short, one_of, positive, whole
from . import record_files, record_plots, record_processing
from .spectra import FourierSpectrum, ResponseSpectrum, response_spectrum
from .units import GRAVITY, LARGEST, doubt
from .waveform import Waveform

AT_AN_END = 1e-6  # of a step: times this close to the first or last sample are on it
RESAMPLING = ("linear", "band-limited")
ALIASED = 1e-3  # of ∫ a² dt: what steps may show as slower waves than it is
RESIDUAL = 1e-3  # of the largest velocity: what a run may add to that at the end, unsaid
ON_THE_WAY = 1e-2  # of the largest velocity: what it may be off by before


class IntegratedMotion(NamedTuple):
    """A record as a run integrates it: ``time`` (n,), s, ``acceleration`` (n,), m/s²,
    ``velocity`` (n,), m/s, and ``displacement`` (n,), m."""

    time: np.ndarray
    acceleration: np.ndarray
    velocity: np.ndarray
    displacement: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Record:
    """Acceleration of the ground at equal steps of time.

    Between samples the acceleration is linear, and nothing before the first (t = 0) and after the
    last; velocity and displacement are its exact integrals, from rest.  A record is a function of
    time, so that ``Fixed(base, "x", acceleration=record)`` takes it as it is.  The methods that
    change it return a new one.

    ``acceleration`` (n,), m/s²; ``dt``, s; ``name``, for pictures and messages.
    Raises ``ValueError`` for fewer than two samples, a sample that is no finite number, or a step
    that is not positive; warns of more than 10 g.
    """

    acceleration: np.ndarray
    dt: float
    name: str = field(default="record", compare=False)  # no part of what a restart compares

    def __post_init__(self) -> None:
        a, dt = array("acceleration", self.acceleration), positive("dt", self.dt)
        record_processing.check_samples("acceleration", a)
        if not isinstance(self.name, str):
            raise ValueError(f"name must be a text, got {in_short(self.name)}")
        peak = float(np.abs(a).max())
        if peak > LARGEST:
            import warnings

            warnings.warn(doubt(peak, "m/s2"), UserWarning, stacklevel=3)
        v, u = record_processing.integrals(a, dt)
        for name, value in (("acceleration", a), ("_velocity", v), ("_displacement", u)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        object.__setattr__(self, "dt", dt)

    @classmethod
    def read(
        cls,
        path: str | os.PathLike,
        unit: str | None = None,
        column: int | str | None = None,
        time_column: int | str | None = None,
        dt: float | None = None,
        skip: int = 0,
        name: str | None = None,
    ) -> Record:
        """A record from a file: PEER's AT2, CSV, or text in columns.

        ``unit`` of the accelerations: "g", "m/s2", "cm/s2" or "gal"; AT2 says it itself.
        ``column`` of the accelerations and ``time_column``, each by its name or its number, from 0;
        of two columns the first is time.  ``dt`` (s) where there is no time.  The first ``skip``
        lines are passed over; a line of names may follow.  Columns are parted by commas, semicolons
        (then numbers may have a decimal comma), tabs or blanks; "#" begins a comment.  Time need
        not begin at zero; the record does.  ``name`` is the file's by default.
        Raises ``ValueError`` for a unit that is missing or not known, a peak above 10 g, with the
        unit it is likely to be in, values that are no numbers, steps that are not equal, and an AT2
        whose header is missing or does not agree with its values; ``OSError`` where the file cannot
        be read.
        """
        a, dt = record_files.read(path, unit, column, time_column, dt, skip)
        return cls(a, dt, os.path.splitext(os.path.basename(path))[0] if name is None else name)

    @classmethod
    def from_velocity(cls, velocity: np.ndarray, dt: float, name: str = "record") -> Record:
        """The record whose velocity at the times 0, dt, 2 dt, … is ``velocity`` (n,), m/s.

        Its own step is ``dt``/2: at the times given the acceleration is the velocity's slope by
        differences of second order, and half-way such that the integral is exact.
        Raises ``ValueError`` for a velocity that does not start from zero, or has fewer than three
        samples.
        """
        v, dt = array("velocity", velocity), positive("dt", dt)
        record_processing.check_samples("velocity", v, least=3)
        if v[0] != 0.0:
            raise ValueError(
                f"velocity must start from zero, for a record starts from rest, got {v[0]:.6g} m/s:"
                " put a sample of zero before it, or take that off"
            )
        return cls(record_processing.slopes(v, dt), 0.5 * dt, name)

    # -- the motion --------------------------------------------------------------------------------

    @property
    def time(self) -> np.ndarray:
        """Times of the samples (n,), s, from 0."""
        return self.dt * np.arange(len(self.acceleration))

    @property
    def duration(self) -> float:
        """Time of the last sample, s."""
        return self.dt * (len(self.acceleration) - 1)

    @property
    def velocity(self) -> np.ndarray:
        """Velocity at the samples (n,), m/s."""
        return self._velocity

    @property
    def displacement(self) -> np.ndarray:
        """Displacement at the samples (n,), m."""
        return self._displacement

    def __call__(self, t: float | np.ndarray) -> float | np.ndarray:
        """Acceleration at time ``t`` (s), a number or an array: linear between samples, zero before
        the first and after the last, m/s²."""
        t = np.asarray(t, float)
        margin = AT_AN_END * self.dt
        inside = (t >= -margin) & (t <= self.duration + margin)
        return _plain(np.where(inside, np.interp(t, self.time, self.acceleration), 0.0))

    def velocity_at(self, t: float | np.ndarray) -> float | np.ndarray:
        """Velocity at time ``t`` (s), a number or an array: the exact integral, m/s; after the last
        sample it stays."""
        i, τ, a, slope, _ = self._within(t)
        return _plain(self.velocity[i] + τ * (a + 0.5 * τ * slope))

    def displacement_at(self, t: float | np.ndarray) -> float | np.ndarray:
        """Displacement at time ``t`` (s), a number or an array: the exact integral, m; after the
        last sample it goes on with the velocity there."""
        i, τ, a, slope, later = self._within(t)
        u = self.displacement[i] + τ * (self.velocity[i] + τ * (0.5 * a + τ * slope / 6.0))
        return _plain(u + later * self.velocity[-1])

    def waveform(self) -> Waveform:
        """Its displacement, velocity and acceleration as functions of time: a wave's motion."""
        return Waveform(self.displacement_at, self.velocity_at, self)

    def _within(self, t) -> tuple[np.ndarray, ...]:
        """Sample before t, time since, acceleration there and its slope, and time after the
        end."""
        t = np.asarray(t, float)
        a, dt = self.acceleration, self.dt
        i = np.clip(np.floor(t / dt), 0, len(a) - 2).astype(int)
        return (
            i,
            np.clip(t - dt * i, 0.0, dt),
            a[i],
            (a[i + 1] - a[i]) / dt,
            np.maximum(t - self.duration, 0.0),
        )

    def integrated(self, dt: float, until: float | None = None) -> IntegratedMotion:
        """The motion as a run with steps of ``dt`` (s) has it at the nodes that it moves, by its
        rule Δu = Δt v + ¼ Δt² (a + a₁), v₁ = v + ½ Δt (a + a₁).

        ``until`` (s) is the end of the record by default.  Where ``dt`` divides the record's step,
        the velocity is exact at every step, and the displacement is off by (a(t) - a(0)) Δt²/12.
        """
        dt = positive("dt", dt)
        end = self.duration if until is None else positive("until", until)
        time = dt * np.arange(int(np.ceil(end / dt - AT_AN_END)) + 1)
        a = self(time)
        v = np.concatenate(([0.0], np.cumsum(0.5 * dt * (a[1:] + a[:-1]))))
        u = np.concatenate(([0.0], np.cumsum(0.5 * dt * (v[1:] + v[:-1]))))
        return IntegratedMotion(time, a, v, u)

    def doubt_of_steps(self, dt: float) -> str | None:
        """What a run with steps of ``dt`` (s) makes of the record that it should not, in a
        sentence, or None: it is told by ``Fixed``."""
        run = self.integrated(dt, self.duration + dt)
        fast = record_processing.energy_above(self.acceleration, self.dt, 0.5 / dt)
        if fast > ALIASED:
            return (
                f"steps of {dt:.6g} s show {100 * fast:.2g} % of the energy of the record "
                f"{self.name!r}, above {0.5 / dt:.4g} Hz, as slower waves: take shorter steps, or "
                f"record.resampled({dt:.6g})"
            )
        off, largest = run.velocity - self.velocity_at(run.time), self.peak_velocity
        if abs(off[-1]) <= RESIDUAL * largest and np.abs(off).max() <= ON_THE_WAY * largest:
            return None
        return (
            f"steps of {dt:.6g} s do not follow the record {self.name!r}, whose step is "
            f"{self.dt:.6g} s and whose last acceleration is {self.acceleration[-1]:.3g} m/s²: the "
            f"velocity is off by up to {np.abs(off).max():.3g} m/s, and at the end it is "
            f"{run.velocity[-1]:.3g} m/s instead of {self.velocity[-1]:.3g} m/s: take steps that "
            "divide the record's, and let it end by tapered() and baseline()"
        )

    # -- other records -----------------------------------------------------------------------------

    def scaled(self, factor: float | None = None, *, peak: float | None = None) -> Record:
        """The record times ``factor``, or so that its largest acceleration is ``peak`` (m/s²)."""
        if (factor is None) == (peak is None):
            raise ValueError("scaled takes a factor, or a peak (m/s²), one of them")
        if factor is None:
            if self.peak_acceleration == 0.0:
                raise ValueError(f"peak: the record {self.name!r} has no acceleration to scale")
            factor = positive("peak", peak) / self.peak_acceleration
        return self._of(finite("factor", factor) * self.acceleration)

    def padded(self, before: float = 0.0, after: float = 0.0) -> Record:
        """The record with rest before and after it, s, rounded up to whole steps."""
        counts = []
        for name, seconds in (("before", before), ("after", after)):
            if finite(name, seconds) < 0.0:
                raise ValueError(f"{name} must not be negative, got {seconds:.6g} s: see cut")
            counts.append(int(np.ceil(seconds / self.dt - AT_AN_END)))
        return self._of(np.pad(self.acceleration, counts))

    def cut(self, start: float = 0.0, end: float | None = None) -> Record:
        """The samples from ``start`` to ``end`` (s); the motion starts from rest there."""
        start, end = finite("start", start), self.duration if end is None else finite("end", end)
        margin = AT_AN_END * self.dt
        if not -margin <= start < end <= self.duration + margin:
            raise ValueError(
                f"start and end must lie in order between 0 and {self.duration:.6g} s, got "
                f"{start:.6g} and {end:.6g} s"
            )
        first, last = np.ceil(start / self.dt - AT_AN_END), np.floor(end / self.dt + AT_AN_END)
        if last - first < 1:
            raise ValueError(
                f"start and end must have two samples between them, {self.dt:.6g} s apart, got "
                f"{start:.6g} and {end:.6g} s"
            )
        return self._of(self.acceleration[int(first) : int(last) + 1])

    def tapered(self, seconds: float) -> Record:
        """The record with ``seconds`` at both its ends that rise from zero, and fall to it, as half
        a cosine."""
        seconds = positive("seconds", seconds)
        if 2.0 * seconds > self.duration * (1.0 + AT_AN_END):
            raise ValueError(
                f"seconds must be at most half the duration of {self.duration:.6g} s, got "
                f"{seconds:.6g}"
            )
        t = self.time
        inside = np.minimum(np.minimum(t, t[::-1]) / seconds, 1.0)
        return self._of(self.acceleration * (0.5 - 0.5 * np.cos(np.pi * inside)))

    def baseline(self, order: int = 2, displacement: float | None = None) -> Record:
        """The record less a polynomial of this ``order``, after which the ground is at rest at its
        end.

        Of the polynomials that leave no velocity at the end it is that which leaves the least on
        the way (least squares).  With ``displacement`` (m) this, too, is reached at the end, and
        ``order`` must be 1 or more.  Where the record begins and ends without acceleration, as
        after ``tapered``, the polynomial is multiplied by t (T - t), so that it still does: then a
        run is at rest after it, too.
        """
        order = whole("order", order, least=0)
        if displacement is not None:
            displacement = finite("displacement", displacement)
            if order < 1:
                raise ValueError(
                    f"order must be 1 or more for a displacement that is reached, got {order}"
                )
        return self._of(record_processing.at_rest(self.acceleration, self.dt, order, displacement))

    def filtered(
        self,
        low: float | None = None,
        high: float | None = None,
        order: int = 4,
        keep_padding: bool = False,
    ) -> Record:
        """What the record has between the frequencies ``low`` and ``high`` (Hz), or on one side of
        one of them.

        Butterworth's filter of this ``order``, forwards and backwards: phases stay, and at ``low``
        and ``high`` half the amplitude is left.  Before, the record is padded with 1.5 ``order`` /
        ``low`` s of zeros in all (Boore 2005); with ``keep_padding`` these stay, else what the
        filter has spread into them is lost, and ``tapered`` and ``baseline`` bring the ground to
        rest.
        Raises ``ValueError`` for frequencies that are not in order below half the sampling rate.
        """
        order, half = whole("order", order), 0.5 / self.dt
        if low is None and high is None:
            raise ValueError("filtered needs low or high, a frequency in Hz, or both, got none")
        for name, frequency in (("low", low), ("high", high)):
            if frequency is not None and not 0.0 < finite(name, frequency) < half:
                raise ValueError(
                    f"{name} must lie between 0 and {half:.6g} Hz, half the record's sampling "
                    f"rate, got {frequency:.6g} Hz"
                )
        if low is not None and high is not None and not low < high:
            raise ValueError(f"low must be below high, got {low:.6g} and {high:.6g} Hz")
        return self._of(
            record_processing.filtered(
                self.acceleration, self.dt, low, high, order, bool(keep_padding)
            )
        )

    def resampled(self, dt: float, method: str | None = None) -> Record:
        """The record at other steps, ``dt`` (s).

        "linear" takes what is between the samples; it is what a run does, and the choice where
        ``dt`` is not larger than the record's.  "band-limited", the choice where it is, leaves out
        what is faster than the new steps can show, f > 1/(2 dt), without a shift of phase; its
        ``dt`` must be in a ratio of whole numbers up to 1000 to the record's.
        Raises ``ValueError`` for "linear" steps that would take more than 0.1 % of the record's
        energy for slower waves (aliasing).
        """
        dt = positive("dt", dt)
        method = one_of("method", method or RESAMPLING[dt > self.dt], RESAMPLING)
        if method == "band-limited":
            return self._of(record_processing.band_limited(self.acceleration, self.dt, dt), dt)
        share = record_processing.energy_above(self.acceleration, self.dt, 0.5 / dt)
        if share > ALIASED:
            raise ValueError(
                f"method 'linear' with dt={dt:.6g} s would show {100 * share:.2g} % of the record's"
                f" energy, above {0.5 / dt:.4g} Hz, as slower waves: take 'band-limited', or "
                "filtered(high=...) before"
            )
        return self._of(self(dt * np.arange(np.ceil(self.duration / dt - AT_AN_END) + 1)), dt)

    def _of(self, acceleration: np.ndarray, dt: float | None = None) -> Record:
        return Record(acceleration, self.dt if dt is None else dt, self.name)

    # -- what it is like ---------------------------------------------------------------------------

    @property
    def peak_acceleration(self) -> float:
        """Largest acceleration either way, m/s²."""
        return float(np.abs(self.acceleration).max())

    @property
    def peak_velocity(self) -> float:
        """Largest velocity at a sample either way, m/s."""
        return float(np.abs(self.velocity).max())

    @property
    def peak_displacement(self) -> float:
        """Largest displacement at a sample either way, m."""
        return float(np.abs(self.displacement).max())

    @property
    def arias_intensity(self) -> float:
        """π/(2g) ∫ a² dt (Arias 1970), by the trapezoidal rule, m/s."""
        return float(self._energy()[-1] * np.pi / (2.0 * GRAVITY))

    def significant_duration(self, start: float = 0.05, end: float = 0.95) -> float:
        """Time between these shares of the Arias intensity, s; D5-95 by default."""
        start = between("start", start, 0.0, 1.0)
        end = between("end", end, start, 1.0)
        energy = self._energy()
        if energy[-1] == 0.0:
            raise ValueError(
                f"significant_duration: the record {self.name!r} has no acceleration at all"
            )
        first, last = np.interp([start, end], energy / energy[-1], self.time)
        return float(last - first)

    def _energy(self) -> np.ndarray:
        """∫ a² dt up to each sample, m²/s³."""
        squares = self.acceleration**2
        return np.concatenate(([0.0], np.cumsum(0.5 * self.dt * (squares[1:] + squares[:-1]))))

    def response_spectrum(self, periods: np.ndarray, damping: float = 0.05) -> ResponseSpectrum:
        """Largest responses of oscillators with these ``periods`` (s) and this ratio of
        ``damping``: see ``ResponseSpectrum``.

        The response to acceleration that is linear between samples is exact (Nigam & Jennings
        1969), during the record and for a period after it; it is looked at a hundred times a
        period or more, and five times a sample, so that a peak of the oscillation is missed by
        0.05 % at most.  Period 0 is a stiff one, which moves with the ground.
        Raises ``ValueError`` for a negative period, or a ratio outside [0, 1).
        """
        return response_spectrum(self.acceleration, self.dt, periods, damping)

    def fourier_spectrum(self) -> FourierSpectrum:
        """Magnitudes of ∫ a exp(-2πi f t) dt at frequencies f from 0 to half the sampling
        rate."""
        return FourierSpectrum(
            np.fft.rfftfreq(len(self.acceleration), self.dt),
            self.dt * np.abs(np.fft.rfft(self.acceleration)),
        )

    def plot(self, save: str | os.PathLike | None = None):
        """Draw acceleration, velocity and displacement over time, and return matplotlib's three
        ``Axes``; ``save``: path of a picture to write."""
        return record_plots.motion(self, save)

    def __str__(self) -> str:
        return (
            f"Record {self.name!r}: {self.duration:.4g} s, {len(self.acceleration)} samples every "
            f"{self.dt:.6g} s; peaks {self.peak_acceleration:.3g} m/s² "
            f"({self.peak_acceleration / GRAVITY:.3g} g), {self.peak_velocity:.3g} m/s, "
            f"{self.peak_displacement:.3g} m; at the end {_tidy(self.velocity)} m/s, "
            f"{_tidy(self.displacement)} m"
        )

    __repr__ = __str__


def _plain(value: np.ndarray) -> float | np.ndarray:
    """A number where one was asked for."""
    return float(value) if value.ndim == 0 else value


def _tidy(values: np.ndarray) -> str:
    """The last value, in few digits, round-off as zero."""
    last = values[-1]
    return "0" if abs(last) <= 1e-9 * np.abs(values).max() else f"{last:.3g}"
