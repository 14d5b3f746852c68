"""Does the band follow the mesh?  The strip foundation on three grids, softening with and without
the cell's size.

40 kPa half-sine, fixed box, DM-GC and the FE twin.  Without ``length`` the softening modulus is the
same on every grid and a band takes less energy the finer the cells; with it the energy per area of
a band one cell wide is the same. Writes results/softening_grids.json.

    python studies/softening_grids.py
"""

from __future__ import annotations

from dataclasses import replace

import report
from nonlinear_step import elements, end, points, strip
from rich.progress import track

from mpm_fenicsx import DM_GC, Energy, Newton, Probe
from mpm_fenicsx.scenes.foundation import axis, height, soil

CELLS = (0.25, 0.125, 0.0625)


def measure(method: str, cell: float, length: float | None) -> dict:
    """Settlement and plastic work at the end of the pulse."""
    scene = strip(5e-3, cell, replace(soil(), length=length))
    run = elements(scene, Newton()) if method == "FE" else points(scene, Newton(), DM_GC)
    probe = run.record(Probe("displacement", (axis, height)))
    energy = run.record(Energy())
    run.until(end)
    return {
        "method": method,
        "cell_m": cell,
        "length_m": length,
        "settlement_m": float(-probe.values[-1, 1]),
        "plastic_work_j": float(energy["plastic"][-1]),
        "solves": run.solves / run.steps,
    }


def main() -> list[dict]:
    """Run all, print, write."""
    cases = [
        (method, cell, length)
        for length in (None, 0.125)
        for method in ("FE", "DM-GC")
        for cell in CELLS
    ]
    rows = [measure(*case) for case in track(cases)]
    for row in rows:
        print(
            f"{row['method']:6} h {row['cell_m']:6.4f} m  length {row['length_m']}  settlement "
            f"{1e3 * row['settlement_m']:6.2f} mm  plastic work {row['plastic_work_j']:7.1f} J/m"
        )
    report.write(report.HOME / "results" / "softening_grids.json", rows)
    return rows


if __name__ == "__main__":
    main()
