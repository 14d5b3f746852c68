"""Background grids of the strip foundation, as VTU files.  Units: m.

    python meshes/foundation.py          writes them beside this script

``foundation_fixed``: the body, 6 × 4, with room above for heave; Fixed acts on its edge.
``foundation_absorbing``: room all around, because absorbing boundaries drift.
Each with the paper's cells of 0.0625, and ``_coarse`` with cells of 0.125.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import meshio
import numpy as np

FOLDER = Path(__file__).parent
WIDTH, HEIGHT = 6.0, 4.0  # of the body, whose lower left corner is the origin
ROOM = 0.25
EXTENTS = {
    "fixed": ((0.0, 0.0), (WIDTH, HEIGHT + ROOM)),
    "absorbing": ((-ROOM, -ROOM), (WIDTH + ROOM, HEIGHT + ROOM)),
}
CELLS = {"": 0.0625, "_coarse": 0.125}


def quads(lower, upper, cell) -> meshio.Mesh:
    """Equal quadrilaterals of side ``cell`` between two corners."""
    x, y = (
        a + cell * np.arange(round((b - a) / cell) + 1) for a, b in zip(lower, upper, strict=True)
    )
    points = np.stack([*np.meshgrid(x, y), np.zeros((len(y), len(x)))], -1).reshape(-1, 3)
    first = (len(x) * np.arange(len(y) - 1)[:, None] + np.arange(len(x) - 1)).ravel()
    ring = np.array([0, 1, len(x) + 1, len(x)])
    return meshio.Mesh(points, [("quad", first[:, None] + ring)])


def meshes() -> dict[str, meshio.Mesh]:
    """All of them, by file name."""
    return {
        f"foundation_{kind}{fineness}.vtu": quads(*extent, cell)
        for kind, extent in EXTENTS.items()
        for fineness, cell in CELLS.items()
    }


def main(arguments=None) -> None:
    """Write the files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where to write them")
    folder = parser.parse_args(arguments).folder
    folder.mkdir(parents=True, exist_ok=True)
    for name, mesh in meshes().items():
        meshio.write(folder / name, mesh, binary=True, compression="zlib")
        print(
            f"{folder / name}: {len(mesh.cells[0].data)} cells, "
            f"{(folder / name).stat().st_size / 1e3:.0f} kB"
        )


if __name__ == "__main__":
    main()
