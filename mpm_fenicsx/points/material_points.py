"""Material points, and the surface points that lie on a body's edge and move with it."""

from __future__ import annotations

import warnings
import weakref
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field

import numpy as np

from ..common import tensors
from ..common.checks import array, asked, chosen, finite, in_short, numbers, one_of, whole
from ..common.compiled import digits
from ..common.random_numbers import uniform
from ..common.ranks import together
from ..grid.cells import SIDES
from ..materials.law_checks import check_law
from .cuts import inside_of_domains
from .geostatic_stress import stress_at
from .staircase import levels_of_a_slope
from .surface_points import SurfacePoints


@dataclass
class MaterialPoints:
    """Material points of one body.

    ``x`` (n, dim), m; ``half`` (n, dim), m: half the support domain; ``volume`` (n,), m³; ``mass``
    (n,), kg; ``stress`` (n, components), Pa (see ``tensors``).  ``velocity`` and ``acceleration``
    (n, dim) exist in dynamic scenes only.  On several ranks each may be given all points, or its
    own; a run takes points to the rank of their cell, where each counts once, and ``number`` (n,)
    says which they are: from their places when the first run begins, the same on any number of
    ranks.  Make them with ``fill``; raises ``ValueError`` for
    arrays that do not fit or are not finite.
    """

    material: object
    x: np.ndarray
    half: np.ndarray
    volume: np.ndarray
    stress: np.ndarray | None = None
    velocity: np.ndarray | None = None
    acceleration: np.ndarray | None = None
    history: np.ndarray | None = None  # (n, k): what the material remembers, if it does
    # (n,) each, by name: parameters of the material that differ from point to point, and "size", m,
    # of the point's first cell, where the material asks for it
    parameters: dict[str, np.ndarray] = field(default_factory=dict)
    exposed: np.ndarray | None = None  # (n, dim, 2): faces of the support domain on the body's edge
    # (n, dim), m: centres of the faces' domains, where jitter moved x away from them
    seat: np.ndarray | None = None
    mass: np.ndarray = field(init=False)
    # (n, dim), m: how far points have jumped as they came in over tied sides; only where some are
    jumped: np.ndarray | None = field(default=None, init=False)
    # (n,): which point it is, whatever rank it is on; only where a run has several ranks
    number: np.ndarray | None = field(default=None, init=False)
    _run_left: np.ndarray | None = field(default=None, init=False, repr=False)
    # the grid that ``fill`` has filled
    _grid: weakref.ref | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self.x = array("x", self.x)
        if self.x.ndim != 2 or self.dim not in (2, 3):
            raise ValueError(f"x must be (n, 2) or (n, 3), got {self.x.shape}")
        n, dim = self.x.shape
        check_law(self.material, dim)
        if self.stress is None:
            self.stress = np.zeros((n, tensors.components(dim)))
        self._check_parameters()
        if self.history is None and self.material.history:
            stress = array("stress", self.stress)
            self.history = self.material.initial_history(stress, self.parameters)
        shapes = {
            "x": (n, dim),
            "half": (n, dim),
            "volume": (n,),
            "stress": (n, tensors.components(dim)),
            "velocity": (n, dim),
            "acceleration": (n, dim),
            "history": (n, len(self.material.history)),
        }
        for name, shape in shapes.items():
            if getattr(self, name) is not None or name in ("half", "volume"):
                value = array(name, getattr(self, name))
                if value.shape != shape:
                    raise ValueError(
                        f"{name} must have the shape {shape} to fit x, got {value.shape}"
                    )
                if not np.isfinite(value).all():
                    raise ValueError(f"{name} must be finite, got {value[~np.isfinite(value)][0]}")
                setattr(self, name, value)
        if (self.volume <= 0).any() or (self.half <= 0).any():
            raise ValueError("volume and half must be positive")
        self.mass = self.material.density * self.volume

    def _check_parameters(self) -> None:
        """Raise ``ValueError`` naming a parameter that the material lacks, or that does not fit."""
        known = (*self.material.parameters, *(["size"] if self.material.length else []))
        for name, value in self.parameters.items():
            if name not in known:
                raise ValueError(
                    f"parameters: {type(self.material).__name__} takes "
                    f"{', '.join(known) or 'none'} point by point, got {name!r}"
                )
            column = array(name, value)
            if column.shape != (len(self.x),) or not np.isfinite(column).all():
                raise ValueError(
                    f"{name} of parameters must be {len(self.x)} finite numbers, one a point, got "
                    f"{in_short(value)}"
                )
            self.parameters[name] = column

    def __getstate__(self) -> dict:
        """A copy is of no grid."""
        return {name: value for name, value in vars(self).items() if name != "_grid"}

    def __len__(self) -> int:
        return len(self.x)

    @property
    def dim(self) -> int:
        """Space dimension."""
        return self.x.shape[1]

    @property
    def left_by_run(self) -> bool:
        """Whether the acceleration is what a run has left, and not one that is given."""
        return self.acceleration is not None and self._run_left is self.acceleration

    def leave(self) -> None:
        """A run says that the acceleration is its own."""
        self._run_left = self.acceleration

    @property
    def remembered(self) -> np.ndarray:
        """``history``, or (n, 0) where the material remembers nothing."""
        return np.zeros((len(self), 0)) if self.history is None else self.history

    def bear(self, stress: np.ndarray, history: np.ndarray) -> None:
        """Take stress (n, components), Pa, and what the material remembers, if it does."""
        self.stress = stress
        if self.history is not None:
            self.history = history

    def enter_dynamics(self) -> None:
        """Give the points velocity and acceleration of their own, zero where they bring none."""
        bring = self.velocity, self.acceleration
        self.velocity, self.acceleration = (
            np.zeros_like(self.x) if value is None else np.array(value, float) for value in bring
        )

    def state(self) -> dict[str, np.ndarray]:
        """The arrays that the points carry, by name; not copied."""
        own = {
            name: value
            for name, value in vars(self).items()
            if isinstance(value, np.ndarray) and not name.startswith("_")
        }
        return {**own, **{f"parameters/{name}": value for name, value in self.parameters.items()}}

    def take(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Carry other rows: ``arrays`` by the names of ``state``."""
        left = self.left_by_run
        for name, value in arrays.items():
            parameter = name.removeprefix("parameters/")
            if parameter != name:
                self.parameters[parameter] = value
            else:
                setattr(self, name, value)
        if left:
            self.leave()

    @classmethod
    def fill(
        cls,
        grid,
        material,
        per_cell: int,
        inside: Callable[[np.ndarray], np.ndarray] | None = None,
        jitter: float = 0.0,
        seed: int = 0,
        parameters: Mapping[str, Callable[[np.ndarray], np.ndarray]] | None = None,
        cut: bool = False,
        stress: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> MaterialPoints:
        """Fill the cells of a grid with ``per_cell`` = k^dim evenly placed points each.

        ``inside`` maps x (dim, n), m, to bool (n,) and keeps the points of the body; ``jitter`` <
        0.5 moves points at random by up to that fraction of their spacing: each by what ``seed``
        and its place in the grid say, whatever the other points and the number of ranks.  Support
        domains move with the points, and then overlap: a uniform stress in 2D is off by 6 to 10 %
        (rms, DM-GC, ``jitter`` 0.3) with 4 points a cell, 2 to 4 % with 16 and 0.9 % with 64, and
        no finer grid makes that less.
        ``parameters``: those of the material that differ from place to place, by name: functions of
        x (dim, n), m, to (n,), asked where points lie at the start.
        ``cut``: support domains end where the body does, so that a point stands for what is inside
        and lies at its centre.  Without it points are whole, those with their centres inside, and
        slopes and curves become staircases, along which stress is wrong.  The edge of a body that
        is cut is none of its ``surface``: take ``SurfacePoints.line`` and its like.
        ``stress``: a function of x (dim, n), m, to rows (n, components), Pa, at the start, such as
        ``GeostaticStress``; none is zero.
        Raises ``ValueError`` for a body without points, a ``per_cell`` that is no k^dim, a ``seed``
        < 0, an ``inside`` that does not say True or False of each place, or ``cut`` points with
        jitter.
        """
        if not hasattr(grid, "owned_cells"):
            raise ValueError(
                f"grid must be a Grid, such as Grid.box((0, 0), (2, 1), (20, 10)), got {grid!r}"
            )
        dim = grid.dim
        check_law(material, dim)
        whole("per_cell", per_cell)
        whole("seed", seed, least=0)
        k = round(per_cell ** (1 / dim))
        if k**dim != per_cell:
            raise ValueError(
                f"per_cell must be a {'square' if dim == 2 else 'cube'} of a whole number, got "
                f"{per_cell}"
            )
        seed = whole("seed", seed, least=0)
        if not 0.0 <= finite("jitter", jitter) < 0.5:
            raise ValueError(f"jitter must lie in [0, 0.5), got {jitter}")
        if cut not in (True, False):
            raise ValueError(f"cut must be True or False, got {cut!r}")
        if cut and jitter:
            raise ValueError(f"jitter must be 0 where the body's edge cuts points, got {jitter}")
        lattice, place = grid.lattice, digits(k, dim)
        spacing = (lattice.upper - lattice.lower) / k
        x = lattice.lower[:, None] + (place + 0.5) * spacing[:, None]
        body = np.ones(x.shape[:2], dtype=bool)  # of ghost cells too, which tell what is exposed
        if inside is not None:
            with together(grid.comm, Exception):
                body = chosen("inside", inside, x.reshape(body.size, dim).T).reshape(body.shape)
        exposed = np.zeros((*body.shape, dim, 2), dtype=bool)
        for d in range(dim):
            for end in range(2):
                beside = place.copy()
                beside[:, d] = (place[:, d] + 2 * end - 1) % k
                leaves = place[:, d] == end * (k - 1)
                cell = np.where(
                    leaves, lattice.neighbour[:, d, end, None], np.arange(grid.cells)[:, None]
                )
                exposed[:, :, d, end] = (cell < 0) | ~body[cell, beside @ k ** np.arange(dim)]
        keep = body & (np.arange(grid.cells) < grid.owned_cells)[:, None]
        half = np.broadcast_to(spacing[:, None] / 2, x.shape)
        part, centre = np.ones(keep.shape), x
        if cut and inside is not None:
            with together(grid.comm, Exception):
                part, centre = inside_of_domains(
                    x, half, k, lambda x: chosen("inside", inside, x), grid.owned_cells
                )
            keep = part > 0.0
        volume = (2 * half[keep]).prod(axis=1)
        size = (volume * per_cell) ** (1 / dim)
        if grid.comm.allreduce(int((keep & (part < 1.0)).any())):
            half, exposed, volume = half - np.abs(centre - x), None, volume * part[keep]
        x, half = centre[keep], half[keep]
        exposed = None if exposed is None else exposed[keep]
        if not grid.comm.allreduce(len(x)):
            raise ValueError("inside leaves a body without material points")
        seat = None
        if jitter:
            seat = x
            number = (per_cell * grid.cell_numbers[:, None] + np.arange(per_cell))[keep]
            x = x + jitter * (2.0 * uniform(seed, number, dim) - 1.0) * 2 * half
        with together(grid.comm, Exception):
            given = {name: _column(name, value, x) for name, value in (parameters or {}).items()}
            borne = None if stress is None else stress_at(stress, x.T)
        if material.length:
            given["size"] = size
        more = {"parameters": given, "exposed": exposed, "seat": seat}
        with together(grid.comm):
            body = cls(material, x, half, volume, borne, **more)
        body._grid = weakref.ref(grid)
        return body

    def __repr__(self) -> str:
        return f"MaterialPoints({len(self)} of {self.material!r})"

    def stretches(
        self, gradient: np.ndarray, stretch: np.ndarray, J: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Ratios of volumes (n,) and of the support domains' extents (n, dim) for displacement
        gradients (n, dim, dim).

        Volumes follow ``gradient``, or are those of J (n,); support domains follow ``stretch`` (n,
        dim), whose mean over neighbouring domains leaves neither gap nor overlap between them.
        Raises ``ValueError`` naming a point that turns inside out.
        """
        J = tensors.stretch(gradient) if J is None else J
        if not (J.min(initial=1.0) > 0.0 and stretch.min(initial=1.0) > 0.0):
            p = int(
                np.argmin(np.where(np.isfinite(J), np.minimum(J, stretch.min(axis=1)), -np.inf))
            )
            what = f"turns inside out: det F = {J[p]:.3g} in the step"
            if J[p] > 0.0:
                what = (
                    f"has a support domain that turns inside out: it stretches by {stretch[p]} in "
                    "the step"
                )
            raise ValueError(f"material point {p} at x={self.x[p]} {what}")
        return J, stretch

    def deform(self, u: np.ndarray, J: np.ndarray, stretch: np.ndarray) -> None:
        """Move by displacement increments u (n, dim), with the ratios that ``stretches`` gives."""
        self.x += u
        if self.seat is not None:
            self.seat += u
        self.volume *= J
        self.half *= stretch

    def surface(
        self, *sides: str, where: Callable[[np.ndarray], np.ndarray] | None = None
    ) -> SurfacePoints:
        """Surface points on the faces of support domains that form the body's edge, on one side or
        several.

        ``sides``: left, right, bottom, top, back or front, the way the outward normal points;
        ``where`` maps face centres (dim, n) to bool (n,) and keeps a part; with it all ranks come
        here.  Each face carries Gauss points, so that its integrals are exact for cubics.  One
        surface of several sides costs less than several surfaces.  A rank may hold none. Slopes and
        curves become staircases, of too much area: a ``UserWarning`` says so.
        Raises ``ValueError`` for a side that is not known, and on all ranks where ``where`` does
        not say True or False of each place on one.
        """
        if not sides:
            raise ValueError("sides must name one side or several, got none")
        if self.exposed is None:
            raise ValueError(
                "surface needs whole points made by fill; along the edge of a body that is cut "
                "take SurfacePoints.line and its like, else give SurfacePoints(x, normal, area)"
            )
        sides = [one_of("side", side, list(SIDES)[: 2 * self.dim]) for side in sides]
        grid = self._grid and self._grid()
        with nullcontext() if where is None or grid is None else together(grid.comm):
            faces = [self._faces(side, where) for side in sides]
        stairs = [
            levels_of_a_slope(x, half, SIDES[side][0])
            for side, (x, half) in zip(sides, faces, strict=True)
        ]
        if any(stairs):
            side = sides[int(np.argmax(stairs))]
            warnings.warn(
                f"surface: {side} is a staircase of {max(stairs)} levels, as of a slope or a "
                f"curve, whose faces have up to {1.41 if self.dim == 2 else 1.73} times the true "
                "area (a circle's 1.27 times): loads and dashpots on them are too large by that; "
                "take a flat part by where=..., or SurfacePoints.line, polygon, circle or "
                "level_set along the true edge, with fill(..., cut=True)",
                UserWarning,
                stacklevel=2,
            )
        parts = [self._gauss_points(side, *face) for side, face in zip(sides, faces, strict=True)]
        found = (np.concatenate(part) for part in zip(*parts, strict=True))
        return SurfacePoints(*found, per_face=2 ** (self.dim - 1))

    def _faces(
        self, side: str, where: Callable[[np.ndarray], np.ndarray] | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Centres of the faces on one side (n, dim), m, and half the support domains that they
        belong to."""
        d, end = SIDES[side]
        rows = np.flatnonzero(self.exposed[:, d, end])
        x, half = (self.x if self.seat is None else self.seat)[rows], self.half[rows]
        x[:, d] += (2 * end - 1) * half[:, d]
        if where is not None:
            keep = chosen("where", where, x.T)
            x, half = x[keep], half[keep]
        return x, half

    def _gauss_points(self, side: str, x: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, ...]:
        """Places, normals and areas of the surface points of faces on one side."""
        d, end = SIDES[side]
        normal = np.zeros(self.dim)
        normal[d] = 2 * end - 1
        area = (2 * np.delete(half, d, axis=1)).prod(axis=1)
        gauss = (2 * digits(2, self.dim - 1) - 1) / np.sqrt(3)
        gauss = np.insert(gauss, d, 0.0, axis=1)
        place = (x[:, None] + gauss * half[:, None]).reshape(-1, self.dim)
        return place, np.broadcast_to(normal, place.shape), np.repeat(area / len(gauss), len(gauss))


def _column(name: str, function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """Numbers (n,) of places x (n, dim) that a function of x (dim, n) gives."""
    if not callable(function):
        raise ValueError(
            f"parameters: {name} must be a function of x (dim, n), m, got {in_short(function)}; "
            "what is the same everywhere is the material's own"
        )
    given = asked(f"parameters: {name}", function, x.T)
    value = numbers(given)
    if value is None or value.shape != (len(x),):
        gave = in_short(given) if value is None else value.shape
        raise ValueError(
            f"parameters: {name} must map (dim, n) to (n,), gave {gave} for n={len(x)}"
        )
    return value
