"""A strip load on the surface of an elastic half-space in plane strain: how the surface moves
(Lamb, Phil. Trans. R. Soc. A 203, 1-42, 1904)."""

from __future__ import annotations

import numpy as np


def compliance(k: np.ndarray, ω: np.ndarray, p_speed: float, s_speed: float, density: float):
    """Settlement of the surface under a pressure e^{i(ωt − kx)} of 1 Pa (m/Pa).

    w = k_s² η_p/(μ (4k² η_p η_s − (2k² − k_s²)²)), η² = k² − ω²/c², η with a positive real part;
    k (1/m), ω (1/s) with a negative imaginary part, or 0 and not on a pole.  At rest it is
    (1 − ν)/(μ k).
    """
    μ, k_s = density * s_speed**2, ω / s_speed
    η_p, η_s = (np.sqrt(k**2 - (ω / c) ** 2 + 0j) for c in (p_speed, s_speed))
    return k_s**2 * η_p / (μ * (4 * k**2 * η_p * η_s - (2 * k**2 - k_s**2) ** 2))


def settlement_beside_a_strip(
    x: float,
    half: float,
    times: np.ndarray,
    pressure: np.ndarray,
    p_speed: float,
    s_speed: float,
    density: float,
) -> np.ndarray:
    """Settlement (n,), m, of the surface at ``x`` (m) from the middle of a strip of half-width
    ``half`` (m) under ``pressure`` (n,), Pa, at even ``times`` (n,), s, from 0 on, where nothing
    moves yet.

    A sum of harmonic waves, in time of e^{-εt} times the pressure, so that no pole lies on the way,
    and along x of strips so far apart that their waves come after the end.
    """
    n, step = len(times), times[1] - times[0]
    many = 2 * n
    ε = 18.0 / (many * step)  # what comes round again is e^-18 of itself
    damped = np.exp(-ε * times)
    ω = 2 * np.pi * np.fft.rfftfreq(many, step) - 1j * ε
    apart = 1.1 * p_speed * times[-1] + abs(x) + 2 * half
    k = 2 * np.pi / apart * np.arange(1, int(60 * apart / half))
    strip = 2 * np.sin(k * half) / k * np.cos(k * x)
    waves = np.array([compliance(k, one, p_speed, s_speed, density) @ strip for one in ω])
    waves = (2 * waves + 2 * half / (1j * ω * density * p_speed)) / apart  # and k = 0
    found = np.fft.irfft(np.fft.rfft(pressure * damped, many) * waves, many)
    return found[:n] / damped
