"""What is done to the samples of a record: integrals, baselines, filters, other steps."""

from __future__ import annotations

from fractions import Fraction

import numpy as np


def check_samples(name: str, values: np.ndarray, least: int = 2) -> None:
    """Raise ``ValueError`` naming what is not a row of ``least`` finite numbers or more."""
    if values.ndim != 1 or len(values) < least:
        raise ValueError(
            f"{name} must be a row of {least} samples or more, got shape {values.shape}"
        )
    wrong = np.flatnonzero(~np.isfinite(values))
    if len(wrong):
        raise ValueError(
            f"{name} must be finite, got {values[wrong[0]]} at sample {wrong[0]} and at "
            f"{len(wrong) - 1} others: fill the gaps before"
        )


def integrals(a: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and displacement, from rest, of accelerations (n, …) that are linear in between."""
    zero = np.zeros_like(a[:1])
    v = np.concatenate((zero, np.cumsum(0.5 * dt * (a[:-1] + a[1:]), axis=0)))
    step = dt * v[:-1] + dt**2 * (a[:-1] / 3.0 + a[1:] / 6.0)
    return v, np.concatenate((zero, np.cumsum(step, axis=0)))


def slopes(v: np.ndarray, dt: float) -> np.ndarray:
    """Accelerations (2n - 1,) at steps of dt/2 whose integral is v (n,) at every second of them."""
    at = np.gradient(v, dt, edge_order=2)
    a = np.empty(2 * len(v) - 1)
    a[::2] = at
    a[1::2] = 2.0 * np.diff(v) / dt - 0.5 * (at[1:] + at[:-1])
    return a


def at_rest(a: np.ndarray, dt: float, order: int, displacement: float | None) -> np.ndarray:
    """Accelerations less the polynomial that leaves the least velocity, and none at the end."""
    s = np.linspace(-1.0, 1.0, len(a))
    shapes = np.polynomial.legendre.legvander(s, order)
    if a[0] == 0.0 and a[-1] == 0.0:
        shapes *= (1.0 - s**2)[:, None]
        shapes[[0, -1]] = 0.0
    if len(a) - 2 < shapes.shape[1]:
        raise ValueError(f"order must be less than {len(a) - 2} for {len(a)} samples, got {order}")
    for _ in range(2):  # the second time for what round-off has left
        v, u = integrals(a, dt)
        V, U = integrals(shapes, dt)
        ends, wanted = V[-1:], v[-1:]
        if displacement is not None:
            ends, wanted = np.vstack((V[-1], U[-1])), np.array([v[-1], u[-1] - displacement])
        _, _, rows = np.linalg.svd(ends)
        first = np.linalg.lstsq(ends, wanted, rcond=None)[0]
        free = rows[len(ends) :].T
        rest = np.linalg.lstsq(V @ free, v - V @ first, rcond=None)[0]
        a = a - shapes @ (first + free @ rest)
    return a


def filtered(
    a: np.ndarray, dt: float, low: float | None, high: float | None, order: int, keep: bool
) -> np.ndarray:
    """Butterworth's filter, forwards and backwards, over samples padded with zeros."""
    from scipy.signal import butter, sosfiltfilt

    if low is None:
        corners, kind = high, "lowpass"
    elif high is None:
        corners, kind = low, "highpass"
    else:
        corners, kind = (low, high), "bandpass"
    pad = int(np.ceil(0.75 * order / ((low or high) * dt)))
    sections = butter(order, corners, kind, fs=1.0 / dt, output="sos")
    result = sosfiltfilt(sections, np.pad(a, pad), padlen=0)
    return result if keep else result[pad : pad + len(a)]


def band_limited(a: np.ndarray, dt: float, new: float) -> np.ndarray:
    """Samples at steps of ``new`` (s), without what those cannot show."""
    from scipy.signal import resample_poly

    ratio = Fraction(dt / new).limit_denominator(1000)
    if ratio == 0 or abs(float(ratio) * new / dt - 1.0) > 1e-9 or ratio.numerator > 1000:
        raise ValueError(
            f"dt must be in a ratio of whole numbers up to 1000 to the record's, {dt:.6g} s, for "
            f"'band-limited', got {new:.9g} s"
        )
    samples = int(np.ceil((len(a) - 1) * dt / new - 1e-6)) + 1
    found = resample_poly(np.pad(a, (0, ratio.denominator)), ratio.numerator, ratio.denominator)
    return found[:samples]


def energy_above(a: np.ndarray, dt: float, frequency: float) -> float:
    """Share of ∫ a² dt at higher frequencies (Hz)."""
    power = np.abs(np.fft.rfft(a)) ** 2
    whole = power.sum()
    return float(power[np.fft.rfftfreq(len(a), dt) > frequency].sum() / whole) if whole else 0.0
