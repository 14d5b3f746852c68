"""Pictures of records and their spectra."""

from __future__ import annotations

import os

import numpy as np

from ..common.files import named

COLOURS = "#0072B2", "#D55E00", "#009E73"  # Okabe & Ito's: told apart by all


def motion(record, save: str | os.PathLike | None):
    """Acceleration, velocity and displacement over time, one below the other."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 1, sharex=True, figsize=(7.0, 5.5), layout="constrained")
    rows = (
        ("acceleration, m/s²", record.acceleration),
        ("velocity, m/s", record.velocity),
        ("displacement, m", record.displacement),
    )
    for ax, (label, values), colour in zip(axes, rows, COLOURS, strict=True):
        ax.plot(record.time, values, color=colour, linewidth=0.9)
        ax.axhline(0.0, color="0.6", linewidth=0.6)
        ax.set_ylabel(label)
    axes[0].set_title(record.name)
    axes[-1].set(xlabel="time, s", xlim=(0.0, record.duration))
    _save(figure, save, True)
    return axes


def response(spectrum, ax, save: str | os.PathLike | None):
    """Pseudo-acceleration over the period."""
    label = f"damping {100 * spectrum.damping:.3g} %"
    x, y = spectrum.periods, spectrum.pseudo_acceleration
    return _line(x, y, "period, s", "pseudo-acceleration, m/s²", label, ax, save)


def fourier(spectrum, ax, save: str | os.PathLike | None):
    """Amplitudes over the frequency, both on logarithmic axes; that of frequency 0 has no place."""
    x, y = spectrum.frequencies[1:], spectrum.amplitudes[1:]
    label = "Fourier amplitude of acceleration, m/s"
    return _line(x, y, "frequency, Hz", label, None, ax, save, lowest=1e-6)


def _line(x, y, across: str, upwards: str, label, ax, save, lowest: float | None = None):
    """A line over a logarithmic axis; upwards, too, from ``lowest`` times the largest."""
    made = ax is None
    if made:
        import matplotlib.pyplot as plt

        _, ax = plt.subplots(figsize=(6.0, 4.0), layout="constrained")
    ax.plot(x, y, label=label, linewidth=1.2, **({"color": COLOURS[0]} if made else {}))
    if np.any(x > 0.0):
        ax.set_xscale("log")
    if lowest is not None and np.any(y > 0.0):
        ax.set_yscale("log")
        ax.set_ylim(bottom=max(y[y > 0.0].min(), lowest * y.max()))
    ax.set(xlabel=across, ylabel=upwards)
    ax.grid(True, which="both", color="0.9")
    if label:
        ax.legend()
    _save(ax.figure, save, made)
    return ax


def _save(figure, save: str | os.PathLike | None, made: bool) -> None:
    """Write a picture, and close what was made for it."""
    if save is None:
        return
    path = named(save)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)
    if made:
        import matplotlib.pyplot as plt

        plt.close(figure)
