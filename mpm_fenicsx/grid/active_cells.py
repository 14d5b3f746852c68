"""Where forms integrate: over the cells with material and, where a term asks for them, the facets
that it joins."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from mpi4py import MPI

import numpy as np
import ufl

from . import dolfinx_versions
from .cells import Lattice
from .grid import Grid


class Region:
    """All cells of a grid, until ``cover`` says which ones hold material.

    ``dx`` is the measure for forms, which follow it at once; in DOLFINx 0.5, which cannot, they go
    on over all cells.  The same holds of measures of a few cells (``some``), and of ``dS`` for the
    facets between cells, of which there are none until ``seams`` is called.  On several ranks what
    one of them marks counts for all, and a rank may be left with none; methods are collective.
    """

    def __init__(self, grid: Grid):
        self.grid, self.follows = grid, dolfinx_versions.FORMS_FOLLOW
        self.cells = np.arange(grid.owned_cells, dtype=np.int32)
        self.dx, self._domains = dolfinx_versions.cell_measure(grid.mesh, self.cells)
        self._held: np.ndarray | None = None
        self.dS: ufl.Measure | None = None
        self.lattice: Lattice | None = None  # one that goes on over tied sides

    def leave_out(self, cells: np.ndarray | None) -> None:
        """All cells but those that are marked (cells,), bool."""
        if cells is None or not self.follows:
            return
        self.cells = np.flatnonzero(~cells[: self.grid.owned_cells]).astype(np.int32)
        self._domains[0] = (dolfinx_versions.MATERIAL, self.cells)

    def cover(self, held: np.ndarray) -> None:
        """Only cells that are marked in ``held`` (cells,), or beside one that is, corners
        included."""
        if not self.follows:
            return
        held = self.grid.marked_anywhere(held)  # support domains and faces reach into ghost cells
        if self._held is not None and np.array_equal(held, self._held):
            return
        self._held = held
        lattice = self.grid.lattice if self.lattice is None else self.lattice
        near = lattice.spread(held)
        self.cells = np.flatnonzero(near[: self.grid.owned_cells]).astype(np.int32)
        self._domains[0] = (dolfinx_versions.MATERIAL, self.cells)

    def some(
        self, metadata: Mapping[str, object]
    ) -> tuple[ufl.Measure, Callable[[np.ndarray], None]]:
        """A measure of cells of its own, and what tells it which (n,), sorted, each on any of the
        ranks that know it; until then all."""
        if not self.follows:
            return self.dx(metadata=metadata), lambda cells: None
        number, mark = len(self._domains), dolfinx_versions.MATERIAL + len(self._domains)
        self._domains.append((mark, self.cells))

        def cover(cells: np.ndarray) -> None:
            cells = self._on_owners(cells)
            if not np.array_equal(cells, self._domains[number][1]):
                self._domains[number] = (mark, cells)

        return self.dx(mark, metadata=metadata), cover

    def _on_owners(self, cells: np.ndarray) -> np.ndarray:
        """This rank's own of the cells (n,), sorted, that any rank names."""
        if self.grid.comm.size == 1:
            return cells
        marks = np.zeros(self.grid.cells, dtype=bool)
        marks[cells] = True
        named = self.grid.marked_anywhere(marks)[: self.grid.owned_cells]
        return np.flatnonzero(named).astype(np.int32)

    # -- facets between cells ----------------------------------------------------------------------

    def seams(self) -> ufl.Measure:
        """Measure of the facets that ``sew`` chooses.  Raises ``ValueError`` if another term has
        them already."""
        if self.dS is not None:
            raise ValueError("terms: a scene takes one term on the facets between cells, got two")
        self._facets = dolfinx_versions.interior_facets(self.grid.mesh)
        self._sewn = self._room = np.full(len(self._facets), not self.follows)
        self._light = np.zeros(self.grid.cells, dtype=bool)
        self.places, self._made = (np.zeros(self.grid.cells, dtype=bool) for _ in range(2))
        self.dS, self._seams = dolfinx_versions.facet_measure(
            self.grid.mesh, self._facets[self._sewn]
        )
        return self.dS

    def sew(self, light: np.ndarray, filled: np.ndarray) -> None:
        """Only facets between cells in ``filled`` (cells,), of which one at least is in ``light``
        (cells,); both as the cells' owners have them."""
        if not self.follows:
            return
        a, b = self._facets[:, 0], self._facets[:, 2]
        sewn = (light[a] | light[b]) & filled[a] & filled[b]
        self._light = light
        if not np.array_equal(sewn, self._sewn):
            self._sewn = sewn
            self._seams[:] = [(dolfinx_versions.MATERIAL, self._facets[sewn])]

    @property
    def outgrown(self) -> bool:
        """Whether facets are sewn that a matrix made in ``room`` has no place for, or ``places``
        are others than it was made for: those of a checkpoint, or of a step that is taken back."""
        if self.dS is None or not self.follows:
            return False
        other = not np.array_equal(self.places, self._made)
        return self._anywhere(other or self._lacking(self._room))

    @contextmanager
    def room(self) -> Iterator[None]:
        """Within, forms go over all cells, and over the facets between ``places``: cells (cells,)
        beside light ones, with which a matrix is the same again, zeros that it keeps included."""
        before, room = self._seams[:], self._between(self.places)
        if self._anywhere(self._lacking(room)):
            self.places[:] = self.grid.share_cells(self.grid.lattice.spread(self._light))
            room = self._between(self.places)
        self._made, self._room = self.places.copy(), room
        self._seams[:] = [(dolfinx_versions.MATERIAL, self._facets[room])]
        with self.whole():
            yield
        self._seams[:] = before

    def _lacking(self, room: np.ndarray) -> bool:
        return bool((self._sewn & ~room).any())

    def _anywhere(self, here: bool) -> bool:
        return here if self.grid.comm.size == 1 else self.grid.comm.allreduce(here, op=MPI.LOR)

    def _between(self, cells: np.ndarray) -> np.ndarray:
        """Which facets (facets,) lie between two cells in ``cells`` (cells,)."""
        return cells[self._facets[:, 0]] & cells[self._facets[:, 2]]

    @contextmanager
    def whole(self) -> Iterator[None]:
        """Within, forms go over all cells."""
        before = self._domains[:]
        if before:
            self._domains[0] = (
                dolfinx_versions.MATERIAL,
                np.arange(self.grid.owned_cells, dtype=np.int32),
            )
        yield
        self._domains[:] = before
