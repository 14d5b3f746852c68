"""Site response
================

An earthquake comes up through rock into a layered, damped column of soil: its surface against the
exact answer in time, in transfer function and in spectra, and soil that yields against the
equivalent-linear method.

Built in ``mpm_fenicsx.scenes.soil_column``.  The record is noise of 0.3 to 6 Hz, made here, and is
that of the outcrop; half of it comes up as a wave, through dashpots which absorb what goes down.
The sides are tied, and nothing else holds the column.  Exact is the transfer function of the layers
with Rayleigh's damping.

Then the same layers are hysteretic: they obey Masing's rules on a hyperbolic backbone.  Under a
weak record they stay at small strain, and the run and the equivalent-linear method, which is exact
there, agree.  Under a strong one, 3 m/s² and strains of 0.3 %, they differ.  The equivalent-linear
column keeps one modulus and one damping ratio a layer all the time, those of 65 % of the largest
strain.  It resonates as linear ground does, where soil that yields bears no more than its strength:
its spectrum is higher by up to two thirds at periods of 0.2 to 0.5 s, and its peak by a third.  It
has no steep fronts, which soil sends up that unloads at full stiffness: its spectrum is lower by up
to a third at most periods below 0.15 s.  From 0.8 s on the two are alike within 10 %.  And it comes
back to where it was, while the surface of soil that has yielded stays 3 mm off.  Half the cell or
half the step changes spectra of the hysteretic column by 1 or 2 % from 0.08 s on.  Units: m, s, kg,
Pa.

Run it by::

    python demos/site_response.py            two or three minutes
    python demos/site_response.py --quick    finite elements alone, a shorter record
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

try:
    import matplotlib
    from rich.console import Console
except ImportError as error:
    raise ImportError(
        f"{error}: demos take matplotlib and rich, pip install 'mpm_fenicsx[demo]'"
    ) from error

from mpm_fenicsx import Energy, Hyperbolic, Hysteretic, RayleighDamping, Record
from mpm_fenicsx.scenes.soil_column import SoilColumn, Stratum, soil, synthetic_record

RESULTS = Path(__file__).parents[1] / "results"
GRAVITY = 9.81
ROCK = soil(800.0, 2300.0)
LAYERS = (  # thickness (m), speed of shear waves (m/s), density (kg/m³), ratio, reference strain
    (6.0, 160.0, 1800.0, 0.03, 1.0e-3),
    (8.0, 240.0, 1900.0, 0.02, 1.0e-3),
    (10.0, 380.0, 2050.0, 0.02, 1.5e-3),
)
FREQUENCIES = (1.5, 6.0)  # at which Rayleigh's damping has the ratio, Hz
SMALL_STRAIN = 0.01  # ratio of damping that hysteretic soil has besides
PEAKS = {"weak": 0.01, "strong": 3.0}  # of the outcrop, m/s²
PERIODS = np.geomspace(0.06, 4.0, 60)


def strata(hysteretic: bool) -> tuple[Stratum, ...]:
    """The layers, elastic and damped or hysteretic."""
    found = []
    for thickness, speed, density, ratio, strain in LAYERS:
        law = soil(speed, density)
        if hysteretic:
            law, ratio = Hysteretic(law, Hyperbolic(strain)), SMALL_STRAIN
        found.append(Stratum(law, thickness, RayleighDamping(ratio, FREQUENCIES)))
    return tuple(found)


def surface_of(column: SoilColumn, method: str, end: float):
    """Times (n,), accelerations (n,) of the surface, the energy not found, of the work, and how
    far (m) the surface has moved against the base at the end."""
    make = {"FE": column.finite_elements, "DM-GC": column.material_points}[method]
    run = make()
    top, energy = run.record(column.probe()), run.record(Energy())
    ends = [run.record(column.probe("displacement", depth)) for depth in (0.0, column.depth)]
    run.until(end)
    surface, base = (column.moved(probe)[-1] for probe in ends)
    lost = np.abs(energy.lost).max() / energy["work"].max()
    return top.times, column.moved(top), lost, surface - base


def difference(found, known) -> float:
    """L2 over time, of what is known."""
    return float(np.linalg.norm(found - known) / np.linalg.norm(known))


def spectrum(acceleration, dt):
    """Spectral acceleration (periods,), m/s², 5 % of damping."""
    return Record(acceleration, dt).response_spectrum(PERIODS).acceleration


def main(arguments=None) -> dict:
    """Run the columns, print what they found, write results/site_response.json and two figures."""
    parser = argparse.ArgumentParser(description="Site response of a layered, damped column")
    parser.add_argument("--quick", action="store_true", help="FE alone, a shorter record")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder for the results")
    chosen, console = parser.parse_args(arguments), Console()
    chosen.results.mkdir(parents=True, exist_ok=True)
    record = synthetic_record(2.0 if chosen.quick else 12.0, peak=1.0, high=6.0)
    end = record.duration + (0.5 if chosen.quick else 3.0)
    record = record.padded(after=end - record.duration)
    methods = ("FE",) if chosen.quick else ("FE", "DM-GC")
    column = SoilColumn(strata(False), ROCK, record, step=record.dt)
    curves, found = {}, {"linear": [], "hysteretic": []}
    for method in methods:
        times, surface, lost, _ = surface_of(column, method, end)
        exact = column.exact(times)
        curves[method] = surface
        apart = np.abs(spectrum(surface, record.dt) / spectrum(exact, record.dt) - 1).max()
        row = {
            "method": method,
            "error": difference(surface, exact),
            "spectrum_error": float(apart),
            "energy_not_found": float(lost),
        }
        found["linear"].append(row)
        console.print(
            f"{method:6} surface acceleration {100 * row['error']:.2f} % from exact (L2), spectrum "
            f"{100 * row['spectrum_error']:.2f} % at most"
        )
    linear_figure(column, times, curves, exact, chosen.results / "site_response.png")
    yielding = {}
    for name, peak in PEAKS.items():
        soft = replace(column, strata=strata(True), motion=record.scaled(peak=peak))
        times, surface, lost, stays = surface_of(soft, "FE", end)
        other = soft.equivalent_linear(times, 2.0 if chosen.quick else 1.0)
        by_method = other.ground.motion_at(0.0, soft.given(times), record.dt, soft.kind)
        yielding[name] = times, surface, by_method, soft.given(times)
        row = {
            "record": name,
            "outcrop_peak": peak,
            "surface_peak": float(np.abs(surface).max()),
            "equivalent_linear_peak": float(np.abs(by_method).max()),
            "difference": difference(by_method, surface),
            "largest_strain": float(other.strain.max() / 0.65),
            "least_reduction": float(other.reduction.min()),
            "most_damping": float(other.damping.max()),
            "iterations": other.iterations,
            "spectral_ratio": (
                spectrum(by_method, record.dt) / spectrum(surface, record.dt)
            ).tolist(),
            "displacement_left": float(stays),
            "energy_not_found": float(lost),
        }
        found["hysteretic"].append(row)
        console.print(
            f"{name:6} record, {peak:g} m/s²: surface {row['surface_peak']:.3g} m/s² hysteretic, "
            f"{row['equivalent_linear_peak']:.3g} m/s² equivalent-linear "
            f"({100 * row['difference']:.2g} % apart, L2); strains of "
            f"{100 * row['largest_strain']:.2g} %, G/G_max {row['least_reduction']:.2f} at least, "
            f"damping {100 * row['most_damping']:.0f} % at most; the surface stays "
            f"{1e3 * abs(stays):.2g} mm from where it was"
        )
    yielding_figure(yielding, record.dt, chosen.results / "site_response_yielding.png")
    (chosen.results / "site_response.json").write_text(json.dumps(found, indent=1) + "\n")
    return found


COLORS = {"FE": "#E69F00", "DM-GC": "#0072B2"}


def linear_figure(column, times, curves, exact, path):
    """Surface against exact: in time, as transfer function, as response spectra."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    dt, outcrop = times[1], column.given(times)
    fig, axes = plt.subplots(3, 1, figsize=(8.0, 9.0), layout="constrained")
    time, transfer, spectra = axes
    time.plot(times, exact, color="0.7", lw=4.0, label="exact")
    f = np.fft.rfftfreq(len(times), dt)
    band = (f > 0.3) & (f < 8.0)
    transfer.plot(
        f[band],
        np.abs(column.ground().transfer(f[band], kind="outcrop")),
        color="0.7",
        lw=4.0,
        label="exact",
    )
    spectra.loglog(PERIODS, spectrum(exact, dt), color="0.7", lw=4.0, label="surface, exact")
    for method, surface in curves.items():
        look = {"color": COLORS[method], "ls": "--" if method == "FE" else ":", "lw": 1.4}
        time.plot(times, surface, label=method, **look)
        ratio = np.abs(np.fft.rfft(surface)[band] / np.fft.rfft(outcrop)[band])
        transfer.plot(f[band], ratio, label=method, **look)
        spectra.loglog(PERIODS, spectrum(surface, dt), label=f"surface, {method}", **look)
    spectra.loglog(PERIODS, spectrum(outcrop, dt), color="0.2", lw=1.0, label="outcrop")
    time.set(xlabel="time (s)", ylabel="acceleration of the surface (m/s²)", xlim=(0.0, times[-1]))
    transfer.set(xlabel="frequency (Hz)", ylabel="surface / outcrop (-)", xlim=(0.0, 8.0))
    spectra.set(xlabel="period (s)", ylabel="spectral acceleration, 5 % (m/s²)")
    for axis in axes:
        axis.grid(alpha=0.3, which="both")
        axis.legend(fontsize=9)
    speeds = ", ".join(f"{layer[1]:g}" for layer in LAYERS)
    fig.suptitle(f"Layers of c_s = {speeds} m/s on rock of 800 m/s (h = {column.cell:g} m)")
    fig.savefig(path, dpi=150)
    plt.close(fig)


def yielding_figure(runs, dt, path):
    """Hysteretic soil against the equivalent-linear method: in time, and as spectra."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(2, 2, figsize=(11.0, 6.0), layout="constrained")
    for (name, (times, surface, other, outcrop)), column in zip(runs.items(), axes.T, strict=True):
        time, spectra = column
        window = (times > 0.1 * times[-1]) & (times < 0.4 * times[-1])
        time.plot(times[window], other[window], color="#D55E00", lw=1.0, label="equivalent-linear")
        time.plot(
            times[window], surface[window], color="#0072B2", lw=1.2, ls="--", label="FE, hysteretic"
        )
        spectra.loglog(
            PERIODS, spectrum(other, dt), color="#D55E00", lw=1.0, label="equivalent-linear"
        )
        spectra.loglog(
            PERIODS, spectrum(surface, dt), color="#0072B2", lw=1.2, ls="--", label="FE, hysteretic"
        )
        spectra.loglog(PERIODS, spectrum(outcrop, dt), color="0.5", lw=1.0, label="outcrop")
        time.set(xlabel="time (s)", title=f"{name}: outcrop of {PEAKS[name]:g} m/s²")
        spectra.set(xlabel="period (s)")
        for axis in column:
            axis.grid(alpha=0.3, which="both")
    axes[0, 0].set_ylabel("acceleration of the surface (m/s²)")
    axes[1, 0].set_ylabel("spectral acceleration, 5 % (m/s²)")
    axes[0, 0].legend(fontsize=9)
    axes[1, 0].legend(fontsize=9)
    fig.savefig(path, dpi=150)
    plt.close(fig)


if __name__ == "__main__":
    main()
