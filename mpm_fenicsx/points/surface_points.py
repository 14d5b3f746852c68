"""Surface points: where loads and boundaries act that move with a body."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..common import tensors
from ..common.checks import array
from . import surface_shapes

SLANTED = 1e-9
"""A normal whose largest component is less than one by that is along no axis."""


@dataclass
class SurfacePoints:
    """Points without thickness on a surface: ``x`` (n, dim), m; outward unit ``normal`` (n, dim);
    ``area`` (n,), m² (m per metre in plane strain).  ``per_face``: so many in a row are the Gauss
    points of one face, whose loads are then integrated piece by piece where grid lines cross it; 1
    where each stands for itself.

    A run moves them: the arrays are then those at the time reached.  On several ranks each may be
    given all rows, or its own.  A run leaves with each rank, here too, those that lie in its cells,
    also when they move, and ``number`` (n,) says which of the rows given they are, those of all
    ranks one after the other where each was given its own; what a load gives row by row may go on
    being given for all of those.

    ``cuts_cells``: it is an edge of any slope, which leaves cells partly filled; a run then holds
    the light nodes of all cut cells (see ``Mapping.hold_cut_cells``), those of free edges too.  So
    do surfaces made by ``line``, ``polygon``, ``circle`` and ``level_set``, for bodies that
    ``MaterialPoints.fill(..., cut=True)`` ends there.

    Raises ``ValueError`` for arrays that do not fit, a normal that is not a unit vector, or an area
    <= 0.
    """

    x: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    displacement: np.ndarray | None = None  # since the start; only where a spring asks for it
    per_face: int = 1
    number: np.ndarray | None = field(
        default=None, init=False
    )  # None while all that was given is here
    given: int = field(default=0, init=False)
    rest_area: np.ndarray | None = field(
        default=None, repr=False
    )  # (n,): at the start; only for dead loads
    cuts_cells: bool = False

    def __post_init__(self) -> None:
        self.x, self.normal, self.area = (
            array(n, getattr(self, n)) for n in ("x", "normal", "area")
        )
        if (
            self.x.ndim != 2
            or self.normal.shape != self.x.shape
            or self.area.shape != self.x.shape[:1]
        ):
            raise ValueError(
                f"surface points need x (n, dim), normal (n, dim), area (n,), got {self.x.shape}, "
                f"{self.normal.shape}, {self.area.shape}"
            )
        length = np.linalg.norm(self.normal, axis=1)
        if not np.abs(length - 1.0).max(initial=0.0) <= 1e-9:
            raise ValueError(
                "normal must be a unit vector, got one of length "
                f"{length[np.argmax(abs(length - 1))]}"
            )
        if not (self.area > 0.0).all():
            raise ValueError(f"area must be positive, got {self.area.min()}")
        if self.per_face not in (1, 2 ** (self.x.shape[1] - 1)) or len(self) % self.per_face:
            raise ValueError(
                f"per_face must be 1 or {2 ** (self.x.shape[1] - 1)}, with whole faces, got "
                f"{self.per_face} for {len(self)} points"
            )
        self.given = len(self)

    # -- along lines and curves --------------------------------------------------------------------

    @classmethod
    def line(cls, a: Sequence[float], b: Sequence[float], spacing: float) -> SurfacePoints:
        """Along the straight edge from a to b (x, y), m, in faces of one length, none longer than
        ``spacing`` (m); half a cell is fine enough.

        The outward normal points to the right of the way from a to b: the body lies to its left.
        Raises ``ValueError`` for a line of no length, or a spacing <= 0.
        """
        return cls._of(surface_shapes.line(a, b, spacing))

    @classmethod
    def polygon(
        cls, corners: Sequence[Sequence[float]], spacing: float, closed: bool = True
    ) -> SurfacePoints:
        """Along the sides between ``corners`` (n, 2), m, in faces of at most ``spacing`` (m), with
        one from the last to the first if ``closed``.

        The body lies to the left of the way: corners that go round it against the clock make
        normals that point out of the polygon, corners with the clock are those of a hole.  In 3D,
        corners (n, 3), it is the flat piece between them, which must be convex, and outward is the
        side from which they go round against the clock; of a parallelogram grid lines cut faces.
        Raises ``ValueError`` for sides that cross, touch or have no length, too few corners,
        corners in 3D that do not lie in a plane, or a spacing <= 0.
        """
        return cls._of(surface_shapes.polygon(corners, spacing, closed))

    @classmethod
    def circle(
        cls, centre: Sequence[float], radius: float, spacing: float, hole: bool = False
    ) -> SurfacePoints:
        """Along a circle in 2D, in arcs of at most ``spacing`` (m); ``centre`` (x, y) and
        ``radius``, m.

        Outward normals point away from the centre or, of a ``hole``, such as a tunnel, to it.
        Raises ``ValueError`` for a radius or a spacing <= 0.
        """
        return cls._of(surface_shapes.circle(centre, radius, spacing, hole))

    @classmethod
    def level_set(
        cls, grid, function: Callable[[np.ndarray], np.ndarray], per_cell: int | None = None
    ) -> SurfacePoints:
        """Where ``function`` of x (dim, n), m, to (n,) is zero on a grid, in 2D or 3D; it is
        negative inside the body, and the outward normal points to where it is positive.

        Each cell is divided in ``per_cell`` = k^dim boxes (16 in 2D and 8 in 3D, if None) and these
        in simplices, in which the surface is flat between the zeros on their edges: of second order
        in the boxes' size.  On several ranks each makes the faces in its own cells.
        Raises ``ValueError`` for a function without a zero on the grid or with a value that is
        none, or a ``per_cell`` that is no k^dim.  Collective.
        """
        return cls._of(surface_shapes.level_set(grid, function, per_cell))

    @property
    def slanted(self) -> bool:
        """Whether it was made for an edge of any slope, and some of it has one."""
        return self.cuts_cells and bool(
            (np.abs(self.normal).max(axis=1, initial=0.0) < 1.0 - SLANTED).any()
        )

    @classmethod
    def _of(cls, shape: surface_shapes.Shape) -> SurfacePoints:
        x, normal, area, per_face = shape
        return cls(x, normal, area, per_face=per_face, cuts_cells=True)

    def remember_area(self) -> None:
        """Take the areas as they are for those at the start, unless there are such already."""
        if self.rest_area is None:
            self.rest_area = self.area.copy()

    def __len__(self) -> int:
        return len(self.x)

    def keep(self, rows: np.ndarray) -> None:
        """Keep only ``rows`` (m,), increasing, of what is here."""
        n = len(self)
        if self.number is None:
            self.number = np.arange(n)
        self.x, self.normal, self.area = self.x[rows], self.normal[rows], self.area[rows]
        self.number = self.number[rows]
        if self.displacement is not None:
            self.displacement = self.displacement[rows]
        if self.rest_area is not None:
            self.rest_area = self.rest_area[rows]

    def number_together(self, comm) -> None:
        """Where each rank was given rows of its own, number those of all ranks, and where one has
        left none to others, its own.  Collective."""
        ranks = comm.allgather((self.number is None, self.given))
        mine, given = zip(*ranks, strict=True)
        if all(mine):
            self.number = sum(given[: comm.rank]) + np.arange(len(self))
            self.given = sum(given)
        elif self.number is None:
            self.number = np.arange(len(self))

    def rows(self) -> dict[str, np.ndarray]:
        """Arrays of one row a point, by name; not copied."""
        names = ("x", "normal", "area", "displacement", "number", "rest_area")
        found = {name: getattr(self, name) for name in names}
        return {name: value for name, value in found.items() if value is not None}

    def take(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Carry other rows: ``arrays`` by the names of ``rows``."""
        for name, value in arrays.items():
            setattr(self, name, value)

    def of_given(self, values: np.ndarray) -> np.ndarray:
        """The rows that are here of values given for all (given, …), or as they are where they are
        no such ones."""
        return values if self.number is None or len(values) != self.given else values[self.number]

    def follow(self, u: np.ndarray, gradient: np.ndarray) -> None:
        """Move by displacement increments u (n, dim) with gradients (n, dim, dim): n dA = J F⁻ᵀ N
        dA₀ (Nanson)."""
        self.x += u
        if self.displacement is not None:
            self.displacement += u
        turned = (tensors.cofactor(gradient) * self.normal[:, None, :]).sum(axis=2)
        stretch = np.sqrt((turned**2).sum(axis=1))
        self.area *= stretch
        self.normal = turned / stretch[:, None]
