"""Which material each cell of a finite element run is made of."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from dolfinx import fem

from ..common.checks import chosen
from ..common.compiled import digits
from ..common.ranks import anywhere, together, warn
from ..grid import dolfinx_versions
from ..grid.grid import Grid
from ..mapping.shape_functions import Stencil
from ..materials.law_checks import check_law
from ..materials.material import NOTHING, Given, hooke
from ..points.location import enter
from ..points.material_points import MaterialPoints
from ..points.migration import Migration

INWARD = 1e-3  # of the way from corner to centre: where a cell is asked whether an edge cuts it
FULL = 1e-6  # of a cell: so much may be lacking


@dataclass(frozen=True, eq=False)
class MaterialRows:
    """The Gauss points of one ``material``.

    ``rows``: which of arrays over all Gauss points (a slice where there is no other material);
    ``numbers`` (n,): the same as numbers; ``count`` (n,): 0, 1, … n - 1.
    """

    material: object
    rows: slice | np.ndarray
    numbers: np.ndarray
    count: np.ndarray

    @property
    def finite(self) -> bool:
        """Whether its strain is finite."""
        return self.material.kinematics.finite

    def columns(self, history: np.ndarray) -> np.ndarray:
        """The columns of history (points, widest) that are this material's, a view."""
        return history[:, : len(self.material.history)]

    def given(self, size: np.ndarray | None, rows: slice | np.ndarray) -> Given:
        """Cell sizes, m, of some of all points (points,), if the material asks for them."""
        return {"size": size[rows]} if self.material.length else NOTHING

    def first(self, points: int) -> slice | np.ndarray:
        """Those of its rows that are among the first so many Gauss points."""
        if isinstance(self.rows, slice):
            return slice(0, points)
        return self.rows[: np.searchsorted(self.rows, points)]


def put_together(
    parts: Sequence[MaterialRows], function: Callable, like: Sequence[np.ndarray]
) -> tuple:
    """What ``function(part)`` gives for each part's rows, as arrays over all Gauss points.

    With one part of all points they are those themselves.  ``like``: arrays of their shapes; what
    no part gives is as there.
    """
    if len(parts) == 1 and isinstance(parts[0].rows, slice):
        return function(parts[0])
    found = tuple(a.copy() for a in like)
    for part in parts:
        for whole, value in zip(found, function(part), strict=True):
            whole[(part.rows, slice(value.shape[1])) if value.ndim > 1 else part.rows] = value
    return found


class CellMaterials:
    """The ``materials`` of a grid's cells.

    ``number`` (cells,): which of them each local and ghost cell is of, -1 for none (``without``).
    Equal materials count as one.  Where there is one, fields of its parameters are constants.
    """

    def __init__(self, grid: Grid, materials: Sequence, number: np.ndarray):
        self.grid, self.materials = grid, []
        of = []
        for material in materials:
            if material not in self.materials:
                self.materials.append(material)
            of.append(self.materials.index(material))
        self.number = np.array(of)[number]

    @classmethod
    def of(cls, grid: Grid, given) -> CellMaterials:
        """From one material, bodies of material points, or pairs of a material and its region.

        A cell is of the material of the points that lie in it.  A region maps x (dim, n), m, to
        bool (n,), and is asked at the cells' centres.
        Raises ``ValueError``, on all ranks, naming a cell in which there are several materials or
        none, or what is no material; for points that have stress, velocity or history; and for
        bodies that leave cells partly empty.  Warns of cells that a region's edge cuts, and of
        those that points made by hand do not fill.
        """
        if isinstance(given, CellMaterials):
            if given.grid is not grid:
                raise ValueError("material: these materials belong to the cells of another grid")
            return given
        if isinstance(given, MaterialPoints):
            given = [given]
        if _is_material(given):
            return cls(grid, [given], np.zeros(grid.cells, dtype=np.int64))
        listed = isinstance(given, Iterable) and not isinstance(given, (str, type))
        if not listed:
            check_law(given, grid.dim)
        entries = list(given) if listed else []
        if entries and all(isinstance(entry, MaterialPoints) for entry in entries):
            return cls(grid, [body.material for body in entries], _of_bodies(grid, entries))
        if entries and all(_is_region(entry) for entry in entries):
            materials, regions = zip(*entries, strict=True)
            found = cls(grid, materials, _of_regions(grid, regions))
            found._warn_of_cuts(materials, regions)
            return found
        raise ValueError(
            "material must be a material, a body of material points or several, or pairs "
            "(material, where) with where mapping x (dim, n) to bool (n,), got "
            f"{_named(entries if listed else given)}"
        )

    def without(self, cells: np.ndarray | None) -> CellMaterials:
        """The same but for cells (cells,), bool, that are of none of them."""
        if cells is None:
            return self
        found = copy(self)
        found.number = np.where(cells, -1, self.number)
        return found

    def __repr__(self) -> str:
        if len(self.materials) == 1:
            return repr(self.materials[0])
        cells = np.bincount(self.number, minlength=len(self.materials))
        where = zlib.crc32(np.ascontiguousarray(self.number, dtype=np.int64))
        each = [f"{law!r} in {n} cells" for law, n in zip(self.materials, cells, strict=True)]
        return f"{', '.join(each)}, which ones {where:08x}"

    @property
    def one(self):
        """The material, where there is but one; else all this."""
        return self.materials[0] if len(self.materials) == 1 else self

    @property
    def finite(self) -> bool:
        """Whether there is one of finite strain."""
        return any(material.kinematics.finite for material in self.materials)

    def alike(self, other: CellMaterials) -> bool:
        """Whether every cell, of all ranks, is of the same material in both."""
        pairs = set(zip(self.number.tolist(), other.number.tolist(), strict=True))
        same = all(self.materials[i] == other.materials[j] for i, j in pairs)
        return not anywhere(self.grid.comm, None if same else "other")

    def field(self, values: Sequence[float]) -> fem.Constant | fem.Function:
        """A parameter of forms with one value a material: a constant, or a field of the cells, zero
        in those of no material."""
        if len(values) == 1 and (dolfinx_versions.FORMS_FOLLOW or (self.number >= 0).all()):
            return fem.Constant(self.grid.mesh, np.array(values[0]))
        f = fem.Function(dolfinx_versions.space(self.grid.mesh, "DQ", 0))
        f.x.array[dolfinx_versions.cell_dofs(f.function_space)[:, 0]] = np.append(values, 0.0)[
            self.number
        ]
        return f

    def parts(self, per_cell: int) -> list[MaterialRows]:
        """The rows of Gauss points, ``per_cell`` in each cell, of each material."""
        numbers = np.arange(len(self.number) * per_cell, dtype=np.int32)
        if len(self.materials) == 1 and (self.number >= 0).all():
            return [MaterialRows(self.materials[0], slice(None), numbers, numbers)]
        of = np.repeat(self.number, per_cell)
        rows = [np.flatnonzero(of == k).astype(np.int32) for k in range(len(self.materials))]
        return [
            MaterialRows(material, here, here, numbers[: len(here)])
            for material, here in zip(self.materials, rows, strict=True)
        ]

    def elastic_stress(self, cells: np.ndarray, strain: np.ndarray) -> np.ndarray:
        """Stress rows (n, components), Pa, of ``cells`` (n,) after a strain (n, components)."""
        if len(self.materials) == 1 and (self.number[cells] >= 0).all():
            return hooke(self.materials[0].lame, strain, np.zeros_like(strain))
        found = np.zeros_like(strain)
        for k, material in enumerate(self.materials):
            here = self.number[cells] == k
            found[here] = hooke(material.lame, strain[here], found[here])
        return found

    def _warn_of_cuts(self, materials: Sequence, regions: Sequence[Callable]) -> None:
        """Warn where not all of a cell is of the material at its centre."""
        grid, x = self.grid, _corners(self.grid)
        near = x + INWARD * (x.mean(axis=1, keepdims=True) - x)
        held = np.zeros((len(self.materials), *x.shape[:2]), dtype=bool)
        with together(grid.comm):
            for material, where in zip(materials, regions, strict=True):
                inside = _asked(where, near.reshape(-1, grid.dim)).reshape(x.shape[:2])
                held[self.materials.index(material)] |= inside
        whole = held[self.number, np.arange(grid.cells)].all(axis=1)[: grid.owned_cells]
        cut = np.flatnonzero(~whole)
        first = anywhere(grid.comm, f"{x[cut[0]].mean(axis=0)}" if len(cut) else None)
        if first:
            count = grid.comm.allreduce(len(cut))
            warn(
                grid.comm,
                f"material: the edges of regions cut {count} cells, one with its centre at "
                f"x={first}; each is taken to be of the material at its centre: let grid lines "
                "follow the interface",
                4,
            )


def _is_material(value) -> bool:
    return not isinstance(value, type) and hasattr(value, "density") and hasattr(value, "respond")


def _named(value) -> str:
    """What was given instead, in words: a body's points are not listed."""
    if isinstance(value, list):
        return f"[{', '.join(_named(entry) for entry in value)}]"
    if isinstance(value, type):
        return f"the class {value.__name__}: make one, {value.__name__}(…)"
    return f"a body of {value.material!r}" if isinstance(value, MaterialPoints) else repr(value)


def _is_region(entry) -> bool:
    pair = isinstance(entry, (tuple, list)) and len(entry) == 2
    return pair and _is_material(entry[0]) and callable(entry[1])


def _corners(grid: Grid) -> np.ndarray:
    """Places of the vertices of all cells (cells, 2^dim, dim), m."""
    return grid.mesh.geometry.x[dolfinx_versions.cell_vertices(grid.mesh)][..., : grid.dim]


def _refuse(grid: Grid, message: str | None) -> None:
    message = anywhere(grid.comm, message)
    if message:
        raise ValueError(f"material: {message}")


# -- regions ---------------------------------------------------------------------------------------


def _of_regions(grid: Grid, regions: Sequence[Callable]) -> np.ndarray:
    """Which region holds the centre of each cell (cells,)."""
    centre = _corners(grid).mean(axis=1)
    with together(grid.comm, Exception):
        held = np.array([_asked(where, centre) for where in regions])
    bad, message = np.flatnonzero(held.sum(axis=0) != 1), None
    if len(bad):
        c = bad[0]
        which = np.flatnonzero(held[:, c]).tolist()
        message = f"cell {c} with its centre at x={centre[c]} lies in " + (
            f"the regions {which}: a cell is of one material"
            if which
            else "no region: finite elements have no empty cells, so every cell needs a material"
        )
    _refuse(grid, message)
    cells = grid.comm.allreduce(held[:, : grid.owned_cells].sum(axis=1))
    if not cells.all():
        raise ValueError(f"material: region {int(np.argmin(cells))} holds the centre of no cell")
    return held.argmax(axis=0)


def _asked(where: Callable, x: np.ndarray) -> np.ndarray:
    """Whether places x (n, dim) lie in a region, bool (n,)."""
    return chosen("where", where, x.T)


# -- bodies ----------------------------------------------------------------------------------------


def _of_bodies(grid: Grid, bodies: Sequence[MaterialPoints]) -> np.ndarray:
    """Which body's points lie in each cell (cells,); the last of those of equal materials."""
    for n, body in enumerate(bodies):
        _refuse(grid, _in_motion(n, body))
    bodies, cells = zip(*(_entered(grid, body) for body in bodies), strict=True)
    number, centre, message = np.full(grid.cells, -1), _corners(grid).mean(axis=1), None
    for n, (body, cell) in enumerate(zip(bodies, cells, strict=True)):
        before = np.unique(number[cell])
        others = [k for k in before if k >= 0 and bodies[k].material != body.material]
        shared = cell[np.isin(number[cell], others)]
        if len(shared) and message is None:
            c = shared[0]
            message = (
                f"cell {c} with its centre at x={centre[c]} holds points of bodies {number[c]} and "
                f"{n}: finite elements have no interface inside a cell; use a mesh whose lines "
                "follow the bodies"
            )
        number[cell] = n
    empty = np.flatnonzero(number[: grid.owned_cells] < 0)
    if len(empty) and message is None:
        message = (
            f"cell {empty[0]} with its centre at x={centre[empty[0]]} holds no material points: "
            "finite elements have no empty cells; use a mesh of the bodies"
        )
    _refuse(grid, message)
    _check_filling(grid, bodies, cells, centre)
    return grid.share_cells(number)


def _entered(grid: Grid, body: MaterialPoints) -> tuple[MaterialPoints, np.ndarray]:
    """The body and the cell (n,) of each point; on several ranks copies of its points where this
    rank has their cells: it may have been made on another grid."""
    if grid.comm.size == 1:
        return body, enter(body, grid)
    mine = copy(body)
    mine.parameters = dict(body.parameters)
    cell = enter(mine, grid, Migration(grid))
    return mine, cell


def _in_motion(number: int, body: MaterialPoints) -> str | None:
    """What a body brings that finite elements do not take over."""
    varying = [name for name in body.parameters if name != "size"]
    if varying:
        return (
            f"{varying[0]} of body {number} differs from point to point, and finite elements have "
            "parameters that are the same in a material: give several materials, or take points"
        )
    for name in ("stress", "velocity", "acceleration", "history"):
        value = getattr(body, name)
        if name == "history" and value is not None:
            value = value - body.material.initial_history(np.zeros_like(body.stress))
        if value is not None and np.any(value):
            return (
                f"{name} of body {number} is not zero, and finite elements start unstressed and at "
                'rest: give points as fill makes them, and stress=, set run.nodal("velocity"), or '
                "go on from a run with start"
            )
    return None


def _check_filling(
    grid: Grid, bodies: Sequence[MaterialPoints], cells: Sequence[np.ndarray], centre: np.ndarray
) -> None:
    """Refuse bodies made by ``fill`` that leave cells partly empty; warn of others."""
    part = _filled(grid, bodies, cells)[: grid.owned_cells]
    lacking, message = np.flatnonzero(np.abs(part - 1.0) > FULL), None
    if len(lacking):
        c = lacking[np.argmin(part[lacking])]
        message = (
            f"bodies fill {part[c]:.3g} of cell {c} with its centre at x={centre[c]}, and finite "
            "elements all of it"
        )
    if all(body.exposed is not None for body in bodies):
        _refuse(grid, message and f"{message}: use a mesh of the bodies")
    message = anywhere(grid.comm, message)
    if message:
        warn(grid.comm, f"material: {message}", 5)


def _filled(
    grid: Grid, bodies: Sequence[MaterialPoints], cells: Sequence[np.ndarray]
) -> np.ndarray:
    """The part of each cell (cells,) that support domains fill, as they were before jitter."""
    volume = fem.Function(dolfinx_versions.space(grid.mesh, "DQ", 0))
    dofs = dolfinx_versions.cell_dofs(volume.function_space)[:, 0]
    neighbour = grid.lattice.neighbour
    for body, cell in zip(bodies, cells, strict=True):
        stencil = Stencil(grid, len(body), support=True)
        stencil.place(body.x if body.seat is None else body.seat, body.half, cell)
        for corner in digits(2, grid.dim):
            beyond, weight = cell, body.volume
            for d, over in enumerate(corner):
                weight = weight * stencil.share[:, d, over]
                if over:
                    across = neighbour[beyond, d, (stencil.side[:, d] + 1) // 2]
                    beyond = np.where(weight > 0.0, across, 0)
                    weight = np.where(beyond >= 0, weight, 0.0)
                    beyond = np.maximum(beyond, 0)
            np.add.at(volume.x.array, dofs[beyond], weight)
    dolfinx_versions.gather(volume)
    return volume.x.array[dofs] / grid.lattice.volume
