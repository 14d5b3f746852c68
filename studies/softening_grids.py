"""Does the band follow the mesh?  The strip foundation on three grids, softening with and without
the cell's size.

40 kPa half-sine, fixed box, DM-GC and the FE twin.  Without ``length`` the softening modulus is the
same on every grid and a band takes less energy the finer the cells; with it the energy per area of
a band one cell wide is the same. Writes results/softening_grids.json.

    python studies/softening_grids.py
"""

from __future__ import annotations

import json
from dataclasses import replace

import nonlinear_step as scene
from rich.progress import track

from mpm_fenicsx import DM_GC, Energy, Newton, Probe

CELLS = (0.25, 0.125, 0.0625)


def measure(method: str, cell: float, length: float | None) -> dict:
    """Settlement and plastic work at the end of the pulse."""
    scene.cell, scene.soil = cell, replace(scene.soil, length=length)
    run = scene.elements(5e-3, Newton()) if method == "FE" else scene.points(5e-3, Newton(), DM_GC)
    probe = run.record(Probe("displacement", (scene.width / 2, scene.height)))
    energy = run.record(Energy())
    run.until(scene.end)
    return {
        "method": method,
        "cell_m": cell,
        "length_m": length,
        "settlement_m": float(-probe.values[-1, 1]),
        "plastic_work_j": float(energy["plastic"][-1]),
        "solves": run.equilibrium.solves / run.steps,
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
    scene.RESULTS.mkdir(exist_ok=True)
    (scene.RESULTS / "softening_grids.json").write_text(json.dumps(rows, indent=1) + "\n")
    return rows


if __name__ == "__main__":
    main()
