"""Facets of the grid one by one: their nodes, and how much of them touches material."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..grid import dolfinx_versions
from ..grid.grid import Grid, GridSurface


def on_facets(grid: Grid, on: GridSurface, there: np.ndarray) -> tuple[float, float]:
    """Area of facets with material, and area, of all ranks."""
    touched = area = 0.0
    for nodes, x in each_facet(grid, on):
        extent = np.ptp(x, axis=0)
        whole = np.delete(extent, np.argmin(extent)).prod()
        touched, area = touched + whole * there[nodes].mean(), area + whole
    return grid.comm.allreduce(touched), grid.comm.allreduce(area)


def each_facet(grid: Grid, on: GridSurface) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Nodes and their places of each facet that this rank owns."""
    topology, dim = grid.mesh.topology, grid.dim
    for pair in ((dim - 1, 0), (dim, 0)):
        topology.create_connectivity(*pair)
    vertices, corners = (topology.connectivity(d, 0) for d in (dim - 1, dim))
    node = np.zeros(
        topology.index_map(0).size_local + topology.index_map(0).num_ghosts, dtype=np.int32
    )
    # the dofs of a cell come in its vertices' order
    node[corners.array] = dolfinx_versions.cell_dofs(grid.space).ravel()
    x = grid.space.tabulate_dof_coordinates()[:, :dim]
    for facet in on.facets[on.facets < topology.index_map(dim - 1).size_local]:
        nodes = node[vertices.links(facet)]
        yield nodes, x[nodes]
