"""Response of oscillators to a record, and its spectra."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from ..common.checks import array, finite
from . import record_plots

BETWEEN = 5  # samples at least: a slow oscillator's velocity bends as the record does
LOOKS = 100  # a period: a peak between two of them is missed by 1 - cos(π/100) = 0.05 %


@dataclass(frozen=True, eq=False)
class ResponseSpectrum:
    """Largest responses, either way, of oscillators whose base moves with a record:

        ü + 2ζω u̇ + ω² u = -a,    ω = 2π/period

    ``periods`` (n,), s; ``damping`` ζ (-).  True ones: ``displacement`` (n,) of u, m, and
    ``velocity`` of u̇, m/s, both relative to the base, and ``acceleration`` of ü + a, m/s²,
    absolute.  Pseudo ones are made of the displacement.
    """

    periods: np.ndarray
    damping: float
    displacement: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    @property
    def pseudo_velocity(self) -> np.ndarray:
        """ω times the displacement, m/s; that of period 0 is zero."""
        with np.errstate(divide="ignore"):
            ω = np.where(self.periods > 0.0, 2.0 * np.pi / self.periods, 0.0)
        return ω * self.displacement

    @property
    def pseudo_acceleration(self) -> np.ndarray:
        """ω² times the displacement, m/s²; that of period 0 is the largest of the ground."""
        with np.errstate(divide="ignore"):
            ω = np.where(self.periods > 0.0, 2.0 * np.pi / self.periods, 0.0)
        return np.where(self.periods > 0.0, ω**2 * self.displacement, self.acceleration)

    def plot(self, ax=None, save: str | os.PathLike | None = None):
        """Draw the pseudo-acceleration over the period, and return matplotlib's ``Axes``; ``ax``:
        axes to draw in, ``save``: path of a picture to write."""
        return record_plots.response(self, ax, save)


@dataclass(frozen=True, eq=False)
class FourierSpectrum:
    """Amplitudes of a record: ``frequencies`` (n,), Hz, and ``amplitudes`` (n,), m/s."""

    frequencies: np.ndarray
    amplitudes: np.ndarray

    def plot(self, ax=None, save: str | os.PathLike | None = None):
        """Draw the amplitudes over the frequency, and return matplotlib's ``Axes``; ``ax``: axes to
        draw in, ``save``: path of a picture to write."""
        return record_plots.fourier(self, ax, save)


def response_spectrum(
    acceleration: np.ndarray, dt: float, periods: np.ndarray, damping: float
) -> ResponseSpectrum:
    """Largest responses to accelerations (n,), m/s², at steps of dt (s): see ``Record``."""
    T, ζ = np.atleast_1d(array("periods", periods)), finite("damping", damping)
    if T.ndim != 1 or not len(T) or not np.isfinite(T).all() or (T < 0.0).any():
        raise ValueError(f"periods must be a row of seconds, zero or more, got {periods}")
    if not 0.0 <= ζ < 1.0:
        raise ValueError(f"damping must lie in [0, 1), a ratio to the critical, got {ζ}")
    rows = np.array([_largest(acceleration, dt, period, ζ) for period in T])
    return ResponseSpectrum(T, ζ, *rows.T)


def _largest(a: np.ndarray, dt: float, period: float, ζ: float) -> tuple[float, float, float]:
    """Largest displacement, velocity and absolute acceleration of one oscillator."""
    if period == 0.0:
        return 0.0, 0.0, float(np.abs(a).max())
    looks = max(BETWEEN, int(np.ceil(LOOKS * dt / period)))
    fine = np.arange((len(a) - 1) * looks + 1) / looks
    a = np.interp(fine, np.arange(len(a)), a)
    s = _frequency(period, ζ)
    z = amplitude(a, dt / looks, s)
    after = z[-1] * np.exp(s * np.linspace(0.0, period, LOOKS + 1))  # free, for one period
    u, v = motion(np.concatenate((z, after)), s)
    absolute = 2.0 * s.real * v - abs(s) ** 2 * u
    return tuple(float(np.abs(one).max()) for one in (u, v, absolute))


def _frequency(period: float, ζ: float) -> complex:
    """s = -ζω + iω√(1 - ζ²)."""
    ω = 2.0 * np.pi / period
    return complex(-ζ * ω, ω * np.sqrt(1.0 - ζ**2))


def amplitude(a: np.ndarray, dt: float, s: complex) -> np.ndarray:
    """z (n,), m/s, of ż = s z + a from rest: exact for a (n,) that is linear between samples.

    z₁ = E z + (I - J) a + J a₁,  E = exp(x),  I = Δt (E - 1)/x,  J = Δt (E - 1 - x)/x²,  x = s Δt,
    which is Nigam & Jennings's recurrence (Bull. Seism. Soc. Am. 59, 909-922, 1969) in one complex
    number.
    """
    from scipy.signal import lfilter

    x = s * dt
    E, I, J = np.exp(x), dt * _divided(x, 1), dt * _divided(x, 2)
    return lfilter([J, I - J], [1.0, -E], a, zi=[-J * a[0]])[0]


def _divided(x: complex, k: int) -> complex:
    """Σ x^n/(n + k)!: (E - 1)/x for k = 1 and (E - 1 - x)/x² for k = 2."""
    if abs(x) > 0.5:
        return np.expm1(x) / x if k == 1 else (np.expm1(x) / x - 1.0) / x
    total = term = 1.0 / k  # 1/k! of k = 1 and 2
    for n in range(1, 14):
        term = term * x / (n + k)
        total = total + term
    return total


def motion(z: np.ndarray, s: complex) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (m) and velocity (m/s), relative to the base, of an ``amplitude``."""
    return -z.imag / s.imag, -(s * z).imag / s.imag
