"""A record for tests: made of numbers alone, the same on every machine."""

import numpy as np

import mpm_fenicsx as mpm

DT, SAMPLES = 0.01, 2001


def synthetic(dt=DT, samples=SAMPLES, peak=2.5):
    """Forty sines from 0.2 to 20 Hz under an envelope that starts and ends at zero, m/s²."""
    t = dt * np.arange(samples)
    k = np.arange(40)
    frequency, phase = np.geomspace(0.2, 20.0, 40), 2 * np.pi * (k * 0.6180339887498949 % 1.0)
    waves = np.sin(2 * np.pi * frequency * t[:, None] + phase) @ (1.0 / np.sqrt(1.0 + k))
    share = t / t[-1]
    a = waves * (share * (1.0 - share)) ** 2 * np.exp(-4.0 * share)
    a[0] = a[-1] = 0.0
    return mpm.Record(peak * a / np.abs(a).max(), dt, "synthetic")
