"""Ties: nodes that cut cells hold by next to nothing go with the nodes beside them.

A node i at which the body ends a hair beyond a grid line has hardly any mass and stiffness, while
the stress of the points there pulls at it in full: its equation says no more than that the stress
at the body's edge is zero at a point inside the body, and strain recovered from composite patches
does not feel such a node at all.  No iteration balances it, and in dynamics it is thrown.  It is no
degree of freedom of its own here: it continues the line through the two nodes a and b next to it in
the body,

    u_i = u_a + (u_a − u_b) |x_i − x_a| / |x_a − x_b|,

or the mean of these over the directions and cells that have them: u = P u.  Forces go the other
way, Pᵀ r, and the system is PᵀKP: virtual work of all motions that the body is left with.  Linear
motions are kept, so that forces and their moments are too.  (Extended B-splines, Höllig, Reif &
Wipper 2001; aggregated elements, Badia, Verdugo & Martín 2018.)
"""

from __future__ import annotations

from collections.abc import Callable

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from ..common.compiled import digits, jit
from ..common.ranks import of_all
from ..grid import dolfinx_versions
from ..grid.cells import Lattice
from ..grid.grid import Grid
from .projection import HATS, QUADRATICS
from .tied_sides import TiedSides

HEAVY, HEAVY_ENOUGH = 0.25, 0.0625
"""Of what a full cell gives to each of its nodes: a node is held by a cell with a point in it that
gives so much, and one half full does; and in dynamics that do not start from stress, by what a
quarter of a cell gives.  With less than the first, bodies at rest settle slowly or not at all; with
more than the second, a dashpot that crosses cells is less accurate (the column's base: 0.41 % at a
quarter, 0.43 % at a half, 0.42 % without ties), and so are the free ends of a bar that moves
(stress 0.18 % at a quarter and without ties, 0.46 % at a half)."""
TRACE = 1e-8
"""Of what a full cell gives to a node: a cell with less holds nothing, be it round-off or a corner
over a line."""
MOST = 0.5
"""Of its own mass: a node with less when light ones have handed it theirs, which may be less than
none, is left out."""
LAYERS = 4
"""How often what is tied may tie others: nodes across edges and corners of the body come in
turn."""


class Ties:
    """Which nodes of a grid are light, and what they are tied to: ``P`` (dofs, dofs), or None while
    nothing is tied.

    ``fixed`` (dofs,): those whose motion is known, which stay as they are; ``tied`` (dofs,): those
    that are.  ``sides``: tied sides of the grid, if any, copies of whose nodes follow the first.
    """

    def __init__(self, grid: Grid, fixed: np.ndarray, sides: TiedSides | None = None):
        self.grid, self._fixed, self.sides = grid, fixed, sides
        self.P: PETSc.Mat | None = None
        self.tied, self._follows = np.zeros_like(fixed), np.zeros_like(fixed)
        self._of_sides: PETSc.Mat | None = None
        if sides is not None:
            self._of_sides, self._follows = sides.matrix(fixed)
            self._take(self._of_sides)
        self._shown = np.zeros(2 * grid.nodes + grid.cells, dtype=bool)
        self._known: list[tuple[np.ndarray, ...]] = []  # layers that P is made of

    def tie(self, light: np.ndarray, heavy: np.ndarray, cells: np.ndarray) -> bool:
        """Tie light nodes to heavy ones (nodes,) through ``cells`` (cells,); whether what is tied
        has changed."""
        shown = np.concatenate((light, heavy, cells))
        if not of_all(self.grid.comm, int(not np.array_equal(shown, self._shown)), MPI.MAX):
            return False
        self._shown = shown
        layers = self._layers(light, heavy, cells)
        same = len(layers) == len(self._known) and all(
            np.array_equal(a, b)
            for layer, known in zip(layers, self._known, strict=True)
            for a, b in zip(layer, known, strict=True)
        )
        if not of_all(self.grid.comm, int(not same), MPI.MAX):
            return False
        before, self._known = self.P, layers
        self._take(self._product(layers))
        return before is not None or self.P is not None

    def _take(self, P: PETSc.Mat | None) -> None:
        self.P = P
        self.tied |= self._follows
        if P is not None:
            mask = P.createVecRight()
            mask.array[:] = ~self._fixed[: len(mask.array)]
            self.free = P.copy()
            self.free.diagonalScale(None, mask)
            self._x, self._y = P.createVecs()

    @property
    def lattice(self) -> Lattice:
        """The cells, over tied sides, too."""
        return self.grid.lattice if self.sides is None else self.sides.lattice

    def _layers(
        self, light: np.ndarray, known: np.ndarray, cells: np.ndarray
    ) -> list[tuple[np.ndarray, ...]]:
        """What ``_beside`` finds, with the number of ties (nodes,) of each node: of nodes beside
        ``known`` ones, then of those beside these, and so on."""
        layers, sides = [], self.sides
        for _ in range(LAYERS):
            node, beside, weight = self._beside(light & ~known, known, cells)
            found = summed(self.grid, np.bincount(node, minlength=self.grid.nodes).astype(float))
            if sides is not None:
                sides.add_up(found[:, None])
            if not of_all(self.grid.comm, float(found.max(initial=0.0)), MPI.MAX) > 0.0:
                break
            layers.append((node, beside, weight, found))
            known = known | (found > 0.0)
        return layers

    def _product(self, layers: list[tuple[np.ndarray, ...]]) -> PETSc.Mat | None:
        P, self.tied, sides = None, np.zeros_like(self._fixed), self.sides
        for node, beside, weight, found in layers:
            layer = self._layer(node, beside, weight / found[node][:, None], found > 0.0)
            P = layer if P is None else layer.matMult(P)
            self.tied |= np.repeat(found > 0.0, self.grid.dim)
        self.tied &= ~self._fixed
        if sides is not None:
            P = self._of_sides if P is None else self._of_sides.matMult(P)
        return P

    def _beside(
        self, light: np.ndarray, known: np.ndarray, cells: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Light nodes (m,), the next two nodes on a line with each (m, 2), both known, and their
        weights (m, 2)."""
        grid, lat = self.grid, self.lattice
        base, h = 4 ** np.arange(grid.dim), lat.upper - lat.lower
        patch = lat.patch[: grid.owned_cells]
        rows = []
        for corner in digits(2, grid.dim):
            place = (1 + corner) @ base
            at = np.flatnonzero(light[patch[:, place]] & cells[: grid.owned_cells])
            for d in range(grid.dim):
                step = (1 - 2 * corner[d]) * base[d]
                a = patch[at, place + step]
                b = patch[at, place + 2 * step]
                beyond = lat.neighbour[at, d, 1 - corner[d]]
                fits = (beyond >= 0) & known[a] & known[b] & cells[beyond]
                ratio = h[at, d][fits] / h[beyond, d][fits]
                rows.append(
                    (
                        patch[at, place][fits],
                        np.stack((a[fits], b[fits]), 1),
                        np.stack((1 + ratio, -ratio), 1),
                    )
                )
        node, beside, weight = (np.concatenate(part) for part in zip(*rows, strict=True))
        return node, beside, weight

    def _layer(
        self, node: np.ndarray, beside: np.ndarray, weight: np.ndarray, found: np.ndarray
    ) -> PETSc.Mat:
        """Rows of ties, added up, where they are ``found`` (nodes,); elsewhere every dof is its
        own."""
        grid, numbers = self.grid, self.grid.space.dofmap.index_map
        dim, owned = grid.dim, numbers.size_local
        tied = (found[:, None] & ~self._fixed.reshape(-1, dim)).ravel()
        number = (
            numbers.local_to_global(np.arange(grid.nodes, dtype=np.int32))
            if self.sides is None
            else self.sides.first
        )
        number = dim * number.astype(PETSc.IntType)
        component = np.arange(dim, dtype=PETSc.IntType)
        moves = tied.reshape(-1, dim)[node].ravel()
        rows = (number[node][:, None] + component).ravel()[moves]
        columns = (number[beside][:, None, :] + component[:, None]).reshape(-1, 2)[moves]
        values = np.repeat(weight, dim, axis=0)[moves]
        P = PETSc.Mat().create(grid.comm)
        P.setSizes(((dim * owned, None), (dim * owned, None)))
        P.setType("aij")
        P.setBlockSizes(dim, dim)
        most = np.where(tied[: dim * owned], 1 + 4 * dim, 1)
        here, elsewhere = dim * owned, dim * (numbers.size_global - owned)
        P.setPreallocationNNZ(
            tuple(np.minimum(most, n).astype(PETSc.IntType) for n in (here, elsewhere))
        )
        P.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        own = np.arange(
            *P.getOwnershipRange(), dtype=PETSc.IntType
        )  # zeros too: PᵀAP needs a whole diagonal
        _add(P, own, own[:, None], np.where(tied[: dim * owned], 0.0, 1.0)[:, None])
        _add(P, rows, columns, values)
        P.assemble()
        return P

    @property
    def light(self) -> bool:
        """Whether any node is light."""
        return self.P is not self._of_sides

    def condense(self, A: PETSc.Mat, into: PETSc.Mat | None) -> PETSc.Mat:
        """PᵀAP without what is fixed, ``into`` that of an earlier step with the same ties."""
        return A.PtAP(self.free) if into is None else A.PtAP(self.free, result=into)

    def all_copies(self, marks: np.ndarray) -> np.ndarray:
        """Which of this rank's own nodes (n,), bool, are marked with all copies of theirs on tied
        sides.  Collective."""
        if self.sides is None:
            return marks
        others = np.zeros(self.grid.nodes, dtype=bool)
        others[: len(marks)] = ~marks
        return ~self.sides.largest(others)[: len(marks)]

    # -- motions and forces ------------------------------------------------------------------------

    def follow(self, f: fem.Function) -> None:
        """Light nodes take the values that their ties give them."""
        self._apply(self.P.mult, f)

    def follow_free(self, f: fem.Function) -> None:
        """The same of an increment, zero where motion is known."""
        self._apply(self.free.mult, f)

    def pass_on(self, f: fem.Function) -> None:
        """Forces on light nodes go to those they are tied to."""
        self._apply(self.P.multTranspose, f)

    def pass_on_at_sides(self, f: fem.Function) -> None:
        """Forces on copies of a node of tied sides go to the first of them, and stay on light
        nodes."""
        if self._of_sides is not None:
            self._apply(self._of_sides.multTranspose, f)

    def pass_on_free(self, f: fem.Function) -> None:
        """The same, and none is left where motion is known."""
        self._apply(self.free.multTranspose, f)

    def follow_with_momentum(self, v: fem.Function, mass: np.ndarray) -> None:
        """Velocities of light nodes follow, and what that takes of the momentum of lumped ``mass``
        (nodes,), kg, goes to those they are tied to.  Linear velocities stay as they are."""
        lost = v.x.array.copy()
        self.follow(v)
        lost -= v.x.array
        change = fem.Function(v.function_space)
        change.x.array[:] = np.repeat(mass, self.grid.dim) * lost
        self.divide(change, mass)
        v.x.array[:] += change.x.array

    def divide(self, force: fem.Function, mass: np.ndarray) -> None:
        """Forces (N) become accelerations of lumped ``mass`` (nodes,), kg; light nodes hand both to
        those they are tied to, and follow these.  Nodes to which they hand more mass than those
        have, less than none, get nothing."""
        own = np.repeat(mass, self.grid.dim)
        shared = fem.Function(force.function_space)
        shared.x.array[:] = own
        self.pass_on(force)
        self.pass_on(shared)
        if self.sides is not None:
            own = own.reshape(-1, self.grid.dim)
            self.sides.add_up(own)
            own = own.ravel()
        there = shared.x.array > MOST * own
        np.divide(force.x.array, shared.x.array, out=force.x.array, where=there)
        force.x.array[~there] = 0.0
        self.follow(force)

    def accelerate(self, force: fem.Function, mass: np.ndarray) -> None:
        """Forces (N) become accelerations of all motions left, PᵀM̄P a = Pᵀf, M̄ of lumped ``mass``
        (nodes,), kg."""
        diagonal, f = self.P.createVecRight(), self.P.createVecLeft()
        owned = len(diagonal.array)
        diagonal.array[:] = np.repeat(mass, self.grid.dim)[:owned]
        M = self.P.duplicate(copy=True)
        M.zeroEntries()
        M.setDiagonal(diagonal)
        A = M.PtAP(self.P)
        A.getDiagonal(f)
        f.array[f.array <= 0.0] = 1.0
        A.setDiagonal(f)
        self.pass_on(force)
        f.array[:] = force.x.array[:owned]
        ksp = PETSc.KSP().create(self.grid.comm)
        ksp.setType("cg")
        ksp.getPC().setType("jacobi")
        ksp.setTolerances(rtol=1e-14, max_it=1000)
        ksp.setOperators(A)
        ksp.solve(f, diagonal)
        force.x.array[:owned] = diagonal.array
        dolfinx_versions.share(force)
        self.follow(force)

    def hand_over(self, values: np.ndarray, givers: np.ndarray, takers: np.ndarray) -> np.ndarray:
        """Nodal values (nodes,) after light nodes among ``givers`` (nodes,) gave theirs to
        ``takers`` on a line with them.  Ghosts have their owners' values.  Collective."""
        light, _, cells = np.split(self._shown, np.cumsum([self.grid.nodes] * 2))
        node, beside, weight = self._beside(light & givers, takers, cells)
        count = summed(self.grid, np.bincount(node, minlength=self.grid.nodes).astype(float))
        share = values[node] / np.maximum(count[node], 1)
        values = values.copy()
        values[count > 0.0] = 0.0
        values[self.grid.space.dofmap.index_map.size_local :] = 0.0
        np.add.at(values, beside, weight * share[:, None])
        return summed(self.grid, values)

    def _apply(self, product: Callable, f: fem.Function) -> None:
        owned = len(self._x.array)
        self._x.array[:] = f.x.array[:owned]
        product(self._x, self._y)
        f.x.array[:owned] = self._y.array
        dolfinx_versions.share(f)


def summed(grid: Grid, values: np.ndarray) -> np.ndarray:
    """Nodal values (nodes,) added up over all ranks.  Collective."""
    if grid.comm.size == 1:
        return values
    f = fem.Function(grid.space)
    nodal = f.x.array.reshape(-1, grid.dim)
    nodal[:, 0] = values
    dolfinx_versions.gather(f)
    return nodal[:, 0].copy()


def _add(P: PETSc.Mat, rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> None:
    """Add values (m, k) in rows (m,) and columns (m, k)."""
    starts = columns.shape[1] * np.arange(len(rows) + 1, dtype=PETSc.IntType)
    P.setValuesIJV(
        starts,
        np.ascontiguousarray(columns.ravel()),
        np.ascontiguousarray(values.ravel()),
        PETSc.InsertMode.ADD_VALUES,
        rows,
    )


class Fills:
    """What cells give to their nodes, as a part of what full ones give.

    ``field`` is that of the points' mass, ``full`` (kg/m³) its value where a cell is full; or of
    their volume, and 1.
    """

    def __init__(self, grid: Grid, field: fem.Function, full: float):
        nodes = round(dolfinx_versions.cell_dofs(field.function_space).shape[1] ** (1 / grid.dim))
        self.grid, self._field = grid, field
        self._dofs = grid.tensor_order(field.function_space, nodes - 1)
        g = HATS if nodes == 2 else QUADRATICS
        line = (
            2.0 * g @ (1.0 / (np.arange(nodes)[:, None] + np.arange(2) + 1.0)) @ HATS.T
        )  # 2 ∫ g N over a cell's side
        self._weights = line / full
        for _ in range(grid.dim - 1):
            self._weights = np.kron(self._weights, line)
        self.best, self.there = np.zeros(grid.nodes), np.zeros(grid.cells, dtype=bool)

    def weigh(self, cells: np.ndarray, pointed: np.ndarray) -> None:
        """``best`` (nodes,): the most that any of ``cells`` (n,) gives to a node, of those that
        hold a point, ``pointed`` (cells,); ``there`` (cells,): which of them hold anything; and
        ``largest``, at most 1: the most that one of all ranks does, as points given by hand may
        fill no cell."""
        nodes = self.grid.lattice.nodes
        self.best[nodes[cells]] = 0.0
        largest = _weigh(
            cells,
            self._field.x.array,
            self._dofs,
            self._weights,
            pointed,
            nodes,
            self.best,
            self.there,
        )
        self.largest = min(1.0, of_all(self.grid.comm, largest, MPI.MAX))


@jit
def _weigh(cells, values, dofs, weights, pointed, nodes, best, there):
    largest = 0.0
    for c in cells:
        there[c], mean = False, 0.0
        for k in range(nodes.shape[1]):
            given = 0.0
            for j in range(dofs.shape[1]):
                given += values[dofs[c, j]] * weights[j, k]
            there[c] |= given > TRACE
            mean += given / nodes.shape[1]
            if pointed[c]:
                best[nodes[c, k]] = max(best[nodes[c, k]], given)
        largest = max(largest, mean)
    return largest


class Holding:
    """Ties what is light in the cells where something acts: in all that hold material, if
    ``everywhere``; and so much that bodies ``at_rest`` come to rest and stay there.

    ``full`` (cells,), bool: cells without points that are full of material, if there are any.
    """

    def __init__(
        self,
        fills: Fills,
        ties: Ties,
        everywhere: bool,
        at_rest: bool,
        full: np.ndarray | None = None,
    ):
        self.ties, self._fills, self._everywhere = ties, fills, everywhere
        self._heavy, self._full = HEAVY if at_rest else HEAVY_ENOUGH, full
        self._loaded: np.ndarray | None = None
        self._near = self._all = np.arange(ties.grid.cells)

    def refresh(self, pointed: np.ndarray, loaded: np.ndarray) -> None:
        """``pointed`` (cells,): which hold a point; ``loaded`` (cells,): 2 where a part of a
        surface lies, with material or without, and 1 beside facets that bear a load."""
        grid, fills = self.ties.grid, self._fills
        nodes = grid.lattice.nodes
        pointed = grid.share_cells(pointed)
        loaded = grid.most_anywhere(loaded)  # a face may reach into cells of another rank
        if not self._everywhere and not np.array_equal(loaded, self._loaded):
            self._loaded, self._near = (
                loaded.copy(),
                np.flatnonzero(self.ties.lattice.spread(loaded)),
            )
        fills.weigh(self._near, pointed)
        self._fill_up()
        acted = loaded + fills.there > 1 if not self._everywhere else (loaded > 1) | fills.there
        light = np.zeros(grid.nodes, dtype=bool)
        light[nodes[acted]] = True
        heavy = self._heavy * fills.largest
        sides, best = self.ties.sides, fills.best
        if sides is not None:
            light, best = sides.largest(light), sides.largest(best)
        light &= best < heavy
        if of_all(grid.comm, int(light.any()), MPI.MAX) or self.ties.P is not None:
            if not self._everywhere:
                fills.weigh(self._all, pointed)
                self._fill_up()
                best = fills.best if sides is None else sides.largest(fills.best)
            light, heavy = self._share(light), self._share(best >= heavy)
            self.ties.tie(light, heavy, acted | fills.there)

    def _fill_up(self) -> None:
        """Nodes of cells that are full without points are held by these."""
        if self._full is not None:
            self._fills.there |= self._full
            self._fills.best[self.ties.grid.lattice.nodes[self._full]] = 1.0

    def _share(self, marks: np.ndarray) -> np.ndarray:
        """Marks of nodes (nodes,) with those of ghosts taken from their owners."""
        grid = self.ties.grid
        if grid.comm.size == 1:
            return marks
        f = fem.Function(grid.space)
        nodal = f.x.array.reshape(-1, grid.dim)
        nodal[:, 0] = marks
        dolfinx_versions.share(f)
        return nodal[:, 0] > 0.0
