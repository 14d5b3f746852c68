"""What grids say on several ranks, before and after they are partitioned anew, as JSON:
``mpiexec -n 3 python partitions.py out folder``."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from mpi4py import MPI

import meshio
import numpy as np
from dolfinx import fem
from dolfinx import mesh as dmesh

import mpm_fenicsx as mpm
from mpm_fenicsx.grid import dolfinx_versions, partition
from mpm_fenicsx.points.migration import Migration

SOIL = mpm.LinearElastic(young=20e6, poisson=0.25, density=1500.0)


def write_files(folder: Path) -> None:
    """Meshes in files: an uneven rectilinear one of which a corner is missing, and a crooked
    one."""
    lines = [np.array(v) for v in ([0.0, 0.4, 1.0, 1.5, 2.2], [0.0, 0.3, 1.0, 1.3])]
    rng = np.random.default_rng(4)
    i, j = (n.ravel() for n in np.meshgrid(*(np.arange(len(v) - 1) for v in lines)))
    there = ~((i == 3) & (j == 2))
    node = 5 * (j[there, None] + [0, 0, 1, 1]) + i[there, None] + [0, 1, 1, 0]
    x = np.stack([v.ravel() for v in np.meshgrid(*lines)], axis=1)
    x = np.column_stack((x, np.zeros(len(x))))
    name = rng.permutation(len(x))
    shuffled = np.empty_like(x)
    shuffled[name] = x
    cells = name[node][rng.permutation(len(node))]
    meshio.write(folder / "corner.vtu", meshio.Mesh(shuffled, [("quad", cells)]))
    shuffled[name[6], 0] += 0.1
    meshio.write(folder / "crooked.vtu", meshio.Mesh(shuffled, [("quad", cells)]))


FACETS = {"strip": lambda x: (x[1] < 1e-9) & (x[0] < 1.0 + 1e-9)}


def grids(folder: Path) -> dict:
    """Functions that make grids, by name."""
    lines = [[0.0, 0.4, 1.0, 1.5, 2.2], [0.0, 0.3, 1.0]]
    return {
        "box": lambda: mpm.Grid.box((0, 0), (2, 3), (4, 6), FACETS),
        "lines": lambda: mpm.Grid.rectilinear(lines, FACETS),
        "box in 3D": lambda: mpm.Grid.box((0, 0, 0), (2, 1, 1), (4, 3, 2), FACETS),
        "corner": lambda: mpm.Grid.read(folder / "corner.vtu", FACETS),
        "crooked": lambda: mpm.Grid.read(folder / "crooked.vtu", FACETS),
        "own mesh": own_mesh,
        "one cell": lambda: mpm.Grid.box((0, 0), (1, 1), (1, 1), FACETS),
    }


def own_mesh() -> mpm.Grid:
    """A crooked mesh that DOLFINx has cut its own way, without ghosts."""
    mesh = dmesh.create_rectangle(
        MPI.COMM_WORLD,
        [[0.0, 0.0], [4.0, 3.0]],
        [4, 3],
        dmesh.CellType.quadrilateral,
        ghost_mode=dmesh.GhostMode.none,
    )
    x, y, _ = mesh.geometry.x.T
    y += 0.02 * x * y * (3 - y)  # the edges stay where they are
    return mpm.Grid(mesh, FACETS)


def places(grid: mpm.Grid) -> dict:
    """Where what has a number lies: cells, nodes, facets of the grid's own cells."""
    mesh, dim = grid.mesh, grid.dim
    x = mesh.geometry.x[dolfinx_versions.cell_vertices(mesh)][: grid.owned_cells, :, :dim]
    number = grid.cell_numbers
    out = {"cells": dict(zip(number.tolist(), x.mean(axis=1).tolist(), strict=False))}
    dofs = dolfinx_versions.cell_dofs(grid.space)[: grid.owned_cells]
    nodes = grid.node_numbers
    assert len(nodes) == grid.nodes and len(number) == grid.cells
    assert len(np.unique(nodes)) == len(nodes) and len(np.unique(number)) == len(number)
    out["nodes"] = dict(zip(nodes[dofs].ravel().tolist(), x.reshape(-1, dim).tolist(), strict=True))
    numbers = grid.facet_numbers
    out["facets"] = {}
    for name in ("left", "top", "strip"):
        surface = grid.facets(name)
        for facet, middle in zip(surface.facets, middles(grid, surface.facets), strict=True):
            out["facets"][f"{name} {numbers[facet]}"] = middle.tolist()
    return out


def middles(grid: mpm.Grid, facets: np.ndarray) -> np.ndarray:
    """Middles of facets (n, dim), m."""
    topology = grid.mesh.topology
    topology.create_connectivity(grid.dim - 1, 0)
    topology.create_connectivity(grid.dim, 0)
    x = np.zeros((topology.index_map(0).size_local + topology.index_map(0).num_ghosts, grid.dim))
    of_cells = topology.connectivity(grid.dim, 0).array.reshape(-1, 2**grid.dim)
    vertices = dolfinx_versions.cell_vertices(grid.mesh)
    x[of_cells] = grid.mesh.geometry.x[vertices][:, :, : grid.dim]
    of_facets = topology.connectivity(grid.dim - 1, 0).array.reshape(-1, 2 ** (grid.dim - 1))
    return np.round(x[of_facets[facets]].mean(axis=1), 12)  # corners come in any order


def areas(*surfaces) -> list[float]:
    """Areas of surfaces, m²."""
    return [
        s.grid.comm.allreduce(
            fem.assemble_scalar(fem.form(fem.Constant(s.grid.mesh, 1.0) * s.measure))
        )
        for s in surfaces
    ]


def filled(grid: mpm.Grid) -> dict:
    """Points that fill a grid but for a corner, moved at random, by the place that they come
    from."""
    body = mpm.MaterialPoints.fill(
        grid, SOIL, 2**grid.dim, lambda x: (x[0] < 1.2) | (x[1] < 0.6), jitter=0.4, seed=7
    )
    rows = np.concatenate(
        (body.x, body.half, body.exposed.reshape(len(body), 2 * grid.dim)), axis=1
    )
    return {
        ",".join(f"{v:.6f}" for v in seat): row.tolist()
        for seat, row in zip(body.seat, rows, strict=True)
    }


def weights(grid: mpm.Grid) -> np.ndarray:
    """Uneven weights of a rank's own cells, by their numbers."""
    return 1.0 + 5.0 * np.cos(1.7 * grid.cell_numbers[: grid.owned_cells]) ** 2


def together(comm: MPI.Comm, found: dict) -> dict:
    """What all ranks have found."""
    whole: dict = {}
    for part in comm.allgather(found):
        for what, rows in part.items():
            for key, row in rows.items():
                assert whole.setdefault(what, {}).setdefault(str(key), row) == row, (what, key)
    return whole


def everything(folder: Path) -> dict:
    """All cases, whole."""
    out, comm = {}, MPI.COMM_WORLD
    if comm.rank == 0:
        write_files(folder)
    comm.barrier()
    for name, make in grids(folder).items():
        grid = make()
        points = name not in ("crooked", "own mesh")
        surfaces = grid.facets("left"), grid.facets("top", "strip")
        tags = [s.tags for s in surfaces]
        before, size = together(comm, places(grid)), areas(*surfaces)
        fill = together(comm, {"points": filled(grid)}) if points else {}
        if comm.size > 1:
            grid.neighbours  # noqa: B018
        most = comm.allreduce(float(weights(grid).max(initial=0.0)), op=MPI.MAX)
        for weigh in (weights, lambda grid: np.zeros(grid.owned_cells), weights):
            grid.repartition(weigh(grid))
        sums = comm.allgather(float(weights(grid).sum()))
        again = together(comm, places(grid))
        for what, rows in before.items():
            assert again[what] == rows, (
                name,
                what,
                [(k, v, again[what].get(k)) for k, v in rows.items() if again[what].get(k) != v][
                    :3
                ],
            )
        assert [grid.facets("left").tags, grid.facets("top", "strip").tags] == tags, name
        np.testing.assert_allclose(areas(*surfaces), size, rtol=1e-13)
        cuts = np.ceil(np.log2(comm.size))  # each misses its share by no more than a cell
        assert max(sums) <= sum(sums) / comm.size + cuts * most, (name, sums)
        if points:
            assert together(comm, {"points": filled(grid)}) == fill, name
            grid.lattice  # noqa: B018  that all vertex neighbours are ghosts
            if comm.size > 1:
                Migration(grid)
        out[name] = {**before, **fill, "areas": {"": size}}
    refused(comm)
    slices(comm)
    return out


def refused(comm: MPI.Comm) -> None:
    """A weight that is none is refused by all ranks."""
    grid = mpm.Grid.box((0, 0), (1, 1), (4, 4))
    weight = np.ones(grid.owned_cells)
    if comm.rank == comm.size - 1:
        weight[0] = -1.0
    for wrong, words in ((weight, "not negative, got -1.0"), (np.ones(99), "weight must be one")):
        try:
            grid.repartition(wrong)
        except ValueError as error:
            assert words in str(error)
        else:
            raise AssertionError(words)


def slices(comm: MPI.Comm) -> None:
    """No rank makes, or is sent, the whole of a grid."""
    sizes, create = [], dolfinx_versions.create_mesh

    def watched(comm, x, cells, owners):
        sizes.append((len(x), len(cells), len(owners(comm.size)[0]) - 1))
        return create(comm, x, cells, owners)

    sends, send = [], partition.exchange.send

    def seen(comm, rows, to):
        came = send(comm, rows, to)
        sends.append(max(len(rows), len(came[0])))
        return came

    dolfinx_versions.create_mesh, partition.exchange.send = watched, seen
    try:
        grid = mpm.Grid.box((0, 0), (1, 1), (60, 60))
        grid.repartition(np.ones(grid.owned_cells))
    finally:
        dolfinx_versions.create_mesh, partition.exchange.send = create, send
    for nodes, cells, destinations in sizes:
        assert cells == destinations and abs(cells - 3600 / comm.size) < 2
        assert nodes < 3721 / comm.size + 62
    assert len(sizes) == 2 and max(sends, default=0) < 1.3 * 3721 / comm.size


if __name__ == "__main__":
    found = everything(Path(sys.argv[2]))
    if MPI.COMM_WORLD.rank == 0:
        Path(sys.argv[1]).write_text(json.dumps(found))
