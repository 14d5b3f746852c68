"""Where forms integrate: over the cells with material and, where a term asks for them, the facets
that it joins."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import numpy as np
import ufl

from . import dolfinx_versions
from .grid import Grid


class Region:
    """All cells of a grid, until ``cover`` says which ones hold material.

    ``dx`` is the measure for forms, which follow it at once.  On several ranks, and in DOLFINx 0.5,
    which cannot, they go on over all cells.  The same holds of measures of a few cells (``some``),
    and of ``dS`` for the facets between cells, of which there are none until ``seams`` is called.
    """

    def __init__(self, grid: Grid):
        self.grid, self.follows = grid, grid.comm.size == 1 and dolfinx_versions.FORMS_FOLLOW
        self.cells = np.arange(grid.owned_cells, dtype=np.int32)
        self.dx, self._domains = dolfinx_versions.cell_measure(grid.mesh, self.cells)
        self._held: np.ndarray | None = None
        self.dS: ufl.Measure | None = None

    def cover(self, held: np.ndarray) -> None:
        """Only cells that are marked in ``held`` (cells,), or beside one that is, corners
        included."""
        if not self.follows or (self._held is not None and np.array_equal(held, self._held)):
            return
        self._held = held.copy()
        near = self.grid.lattice.spread(held.astype(bool))
        self.cells = np.flatnonzero(near[: self.grid.owned_cells]).astype(np.int32)
        self._domains[0] = (dolfinx_versions.MATERIAL, self.cells)

    def some(
        self, metadata: Mapping[str, object]
    ) -> tuple[ufl.Measure, Callable[[np.ndarray], None]]:
        """A measure of cells of its own, and what tells it which (n,), sorted; until then all."""
        if not self.follows:
            return self.dx(metadata=metadata), lambda cells: None
        number, mark = len(self._domains), dolfinx_versions.MATERIAL + len(self._domains)
        self._domains.append((mark, self.cells))

        def cover(cells: np.ndarray) -> None:
            if not np.array_equal(cells, self._domains[number][1]):
                self._domains[number] = (mark, cells)

        return self.dx(mark, metadata=metadata), cover

    # -- facets between cells ----------------------------------------------------------------------

    def seams(self) -> ufl.Measure:
        """Measure of the facets that ``sew`` chooses.  Raises ``ValueError`` if another term has
        them already."""
        if self.dS is not None:
            raise ValueError("terms: a scene takes one term on the facets between cells, got two")
        self._facets = dolfinx_versions.interior_facets(self.grid.mesh)
        self._sewn = self._room = np.full(len(self._facets), not self.follows)
        self.dS, self._seams = dolfinx_versions.facet_measure(
            self.grid.mesh, self._facets[self._sewn]
        )
        return self.dS

    def sew(self, light: np.ndarray, filled: np.ndarray) -> None:
        """Only facets between cells in ``filled`` (cells,), of which one at least is in ``light``
        (cells,)."""
        if not self.follows:
            return
        a, b = self._facets[:, 0], self._facets[:, 2]
        sewn = (light[a] | light[b]) & filled[a] & filled[b]
        if not np.array_equal(sewn, self._sewn):
            self._sewn, self._near = sewn, self.grid.lattice.spread(light)
            self._seams[:] = [(dolfinx_versions.MATERIAL, self._facets[sewn])]

    @property
    def outgrown(self) -> bool:
        """Whether facets are sewn that a matrix made in ``room`` has no place for."""
        return self.dS is not None and bool((self._sewn & ~self._room).any())

    @contextmanager
    def room(self) -> Iterator[None]:
        """Within, forms go over all cells, and over the facets that are sewn or may be soon."""
        before = self._seams[:]
        self._room = self._sewn | (self._near[self._facets[:, 0]] & self._near[self._facets[:, 2]])
        self._seams[:] = [(dolfinx_versions.MATERIAL, self._facets[self._room])]
        with self.whole():
            yield
        self._seams[:] = before

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
