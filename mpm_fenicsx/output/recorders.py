"""Recorders look at a run after each step and write down what they were asked for."""

from __future__ import annotations

from collections.abc import Mapping

from mpi4py import MPI

import numpy as np

from ..common.checks import array, one_of
from ..grid import dolfinx_versions
from ..grid.grid import Grid
from .recorder import Run

ON_THE_GRID = "grid_stress"
FIELDS = ("displacement", "velocity", "acceleration", "stress", ON_THE_GRID)

SAMPLES = ("numbers", "weights", "start")
"""What a probe keeps of the samples of all ranks, where these move."""


class Series:
    """Times (s) and one value a time."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._values: list[np.ndarray] = []

    @property
    def times(self) -> np.ndarray:
        """Recorded times (n,), s."""
        return np.array(self._times)

    @property
    def values(self) -> np.ndarray:
        """Recorded values (n, …)."""
        return np.array(self._values)

    def note(self, run: Run, value: np.ndarray) -> None:
        """Write down a copy of one value, a number or an array, at the run's time.

        Raises ``ValueError`` for a value of another shape than those before.
        """
        value = np.array(value)
        if self._values and value.shape != np.shape(self._values[-1]):
            raise ValueError(
                f"{type(self).__name__}: a value has shape {value.shape}, those before "
                f"{np.shape(self._values[-1])}"
            )
        self._times.append(run.time)
        self._values.append(value)

    def state(self) -> dict[str, np.ndarray]:
        """What a checkpoint keeps of a recorder that is attached."""
        return {"times": self.times, "values": self.values}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from what a checkpoint kept."""
        self._times, self._values = state["times"].tolist(), list(state["values"])


class Probe(Series):
    """A field at a place of the body; the place moves with the material.

    ``field``: displacement since attaching (m), velocity (m/s), acceleration (m/s²), stress (Pa,
    rows as in ``tensors``) or grid_stress; ``at`` (dim,), m, when attached.
    The value is a weighted mean of the samples nearest to ``at`` (in cells), exact for linear
    fields: material points or, in a finite element run, cell centres for stress and nodes for the
    rest.  ``grid_stress`` is the mean of the stress on the grid (``run.stress_field``) over one
    cell's size around the place; for it the stress of all points is mapped anew at every step.
    Once a sample has left the grid and was taken out (``on_exit=REMOVE``) the value is NaN.
    Raises ``ValueError`` for a field that is not known, or a place that is none or lies outside the
    body: by more than half a support domain from the outermost, or outside the mesh.
    """

    def __init__(self, field: str, at):
        super().__init__()
        self.field, self.at = one_of("field", field, FIELDS), array("at", at)

    @property
    def label(self) -> str:
        """Its name in a checkpoint."""
        return f"Probe of {self.field} at {self.at}"

    def attach(self, run: Run) -> None:
        """Choose samples and weights."""
        if self.at.shape != (run.grid.dim,) or not np.isfinite(self.at).all():
            raise ValueError(f"at must be {run.grid.dim} finite coordinates, got {self.at}")
        on_the_grid = self.field == ON_THE_GRID
        self._samples = "displacement" if on_the_grid else self.field
        places, self._read = run.sampler(self._samples)
        if not any(run.grid.comm.allgather(run.holds(self.at))):
            raise ValueError(
                f"at must lie inside the body, got {self.at}; "
                f"{_closest(places, self.at, run.grid.comm)}"
            )
        h = _cell_size(run.grid)
        self._rows, self._weights = _nearest(places / h, self.at / h, run.grid.comm)
        self._start = self._read(self._rows) if self.field == "displacement" else np.zeros(())
        self._of_all, self._gone = None, False
        numbers = run.numbers_of(self._samples, self._rows)
        if numbers is not None:
            like = self._start.shape[1:] or (1,)
            start = np.broadcast_to(self._start, (len(numbers), *like))
            mine = numbers, self._weights, start
            self._of_all = [
                np.concatenate(of_ranks)
                for of_ranks in zip(*run.grid.comm.allgather(mine), strict=True)
            ]
            self._arrangement = None  # sums go by rows at once, as after a restart
        self(run)

    def __call__(self, run: Run) -> None:
        """Write down the value now."""
        if self._of_all is not None and run.arrangement != self._arrangement:
            numbers, weights, start = self._of_all
            self._rows, which = run.rows_of(self._samples, numbers)
            self._weights, self._start = weights[which], start[which]
            self._arrangement = run.arrangement
            self._gone = run.grid.comm.allreduce(len(which)) < len(numbers)
            if self._gone and not run.removed.points:
                raise ValueError(
                    f"Probe of {self.field} at {self.at} read nodes of a far field that has "
                    "released them: record another after the release"
                )
        value = run.grid.comm.allreduce(self._weights @ (self._read(self._rows) - self._start))
        if self._gone:
            value = np.full_like(value, np.nan)
        self.note(run, self._on_the_grid(run, value) if self.field == ON_THE_GRID else value)

    def _on_the_grid(self, run: Run, moved: np.ndarray) -> np.ndarray:
        """Stress (components,), Pa, on the grid around where the place is now; NaN where that has
        left the material."""
        place = moved if run.bodies else self.at
        found = run.grid.comm.allgather(run.stress_field().around(place))
        return next((row for row in found if np.isfinite(row).all()), found[0])

    def state(self) -> dict[str, np.ndarray]:
        """The series, and the samples that were chosen when it began."""
        if self._of_all is not None:
            return {**super().state(), **dict(zip(SAMPLES, self._of_all, strict=True))}
        return {
            **super().state(),
            "rows": self._rows,
            "weights": self._weights,
            "start": self._start,
        }

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from what a checkpoint kept."""
        super().restore(state)
        if self._of_all is not None:
            self._of_all, self._arrangement = [state[name] for name in SAMPLES], None
            return
        self._rows, self._weights, self._start = (
            state[name] for name in ("rows", "weights", "start")
        )


class Energy(Series):
    """Where the energy is (J; J per metre in plane strain).

    ``energy["work"]`` done by tractions and gravity, ``"kinetic"``, ``"strain"``, ``"plastic"``
    work, ``"absorbed"`` by dashpots, ``"stored"`` in springs, ``"supports"``, of material points
    whose velocity fixed nodes have taken (``KnownVelocity``), and what other terms name: arrays
    (n,) since attaching.  What the scene does not have stays zero and costs nothing.
    ``names`` lists them.  ``lost`` is the rest of the balance: dissipation of the method, or its
    error, and what ``Fixed`` does where it moves the soil, which is not counted as work.
    """

    USUAL = ("work", "kinetic", "strain", "plastic", "absorbed", "stored")

    def __init__(self) -> None:
        super().__init__()
        self.names: tuple[str, ...] = self.USUAL

    def attach(self, run: Run) -> None:
        """Compile what the scene's terms do to the energy in a step."""
        forms = run.term_energies()
        taken = sorted(set(forms) & set(run.energy()))
        if taken:
            raise ValueError(
                f"energy: a term names {', '.join(taken)}, which is of the body itself: give what "
                "the term does another name"
            )
        self.names = tuple(dict.fromkeys((*self.USUAL, *forms, *run.energy())))
        self.moved(run)
        self.sums = np.zeros(len(self.names))
        self._start = self._look(run).copy()
        self.note(run, self._start)

    def __call__(self, run: Run) -> None:
        """Write down where the energy is now."""
        self.note(run, self._look(run).copy())

    def moved(self, run: Run) -> None:
        """Compile the forms for the grid as it is divided now."""
        self._forms = {
            self.names.index(name): dolfinx_versions.compile_form(form)
            for name, form in run.term_energies().items()
        }

    def collect(self, run: Run) -> None:
        """After a solve: add up in ``sums`` (names,) what terms have done."""
        for k, form in self._forms.items():
            self.sums[k] += run.grid.comm.allreduce(
                dolfinx_versions.assemble_scalar(form), op=MPI.SUM
            )

    def _look(self, run: Run) -> np.ndarray:
        for name, value in run.energy().items():
            self.sums[self.names.index(name)] = run.grid.comm.allreduce(value, op=MPI.SUM)
        return self.sums

    def state(self) -> dict[str, np.ndarray]:
        """The series, the sums that go on, and the energy at the start."""
        return {**super().state(), "sums": self.sums, "start": self._start}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from what a checkpoint kept."""
        super().restore(state)
        self.sums[:], self._start = state["sums"], state["start"]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[:, self.names.index(one_of("name", name, self.names))]

    @property
    def left(self) -> np.ndarray:
        """Energy in the body, kinetic and strain (n,), J."""
        return self["kinetic"] + self["strain"]

    @property
    def lost(self) -> np.ndarray:
        """Work, and energy at the start, that is found nowhere (n,), J."""
        spent = sum(self[name] - self._start[k] for k, name in enumerate(self.names) if k)
        return self["work"] - spent


def _cell_size(grid: Grid) -> np.ndarray:
    """Mean extents of the cells (dim,), m: the measure of what is near."""
    x = grid.mesh.geometry.x[dolfinx_versions.cell_vertices(grid.mesh)][
        : grid.owned_cells, :, : grid.dim
    ]
    return grid.comm.allreduce(np.ptp(x, axis=1).sum(axis=0)) / grid.comm.allreduce(
        grid.owned_cells
    )


def _by_distance(away: np.ndarray) -> np.ndarray:
    """Order of rows (n, dim), the shortest first; equals by their place, whatever the partition."""
    distance, place = np.linalg.norm(away, axis=1), np.round(away, 6)  # equal but for round-off
    return np.lexsort((*place.T, np.round(distance, 6)))


def _closest(places: np.ndarray, at: np.ndarray, comm: MPI.Comm) -> str:
    """The sample of all ranks that is nearest to a place, in words."""
    distance = np.linalg.norm(places - at, axis=1)
    row = int(np.argmin(distance)) if len(places) else -1
    mine = (float(distance[row]), tuple(places[row].tolist())) if len(places) else (np.inf, ())
    off, place = min(comm.allgather(mine))
    return f"the nearest place where it is known is {off:.4g} m away, at x={np.array(place)}"


def _nearest(places: np.ndarray, at: np.ndarray, comm: MPI.Comm) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the local samples that serve ``at``, and their weights: exact for linear fields over
    all ranks."""
    dim = len(at)
    count = 2 ** (dim + 1)
    rows = _by_distance(places - at)[:count]
    distance = np.linalg.norm(places[rows] - at, axis=1)
    found = np.concatenate(
        comm.allgather(
            np.column_stack((distance, np.full(len(rows), comm.rank), rows, places[rows]))
        )
    )
    found = found[_by_distance(found[:, 3:] - at)[:count]]
    # least-norm weights w with Σ w = 1 and Σ w x = at in the span of the samples, be it a point, a
    # line or a plane; the norm grows as the fourth power of distance
    spread = found[:, 3:] - found[:, 3:].mean(axis=0)
    _, extent, axes = np.linalg.svd(spread, full_matrices=False)
    offset = (found[:, 3:] - at) @ axes[extent > 1e-9 * max(1.0, extent[0])].T
    scale = max(found[:, 0].max(), np.finfo(float).tiny)
    trust = 1.0 / ((found[:, 0] / scale) ** 2 + 1e-9)
    A = np.column_stack((np.ones(len(found)), offset / scale)).T
    weights = trust * np.linalg.lstsq(A * trust, np.eye(len(A))[0], rcond=None)[0]
    mine = found[:, 1] == comm.rank
    return found[mine, 2].astype(int), weights[mine]
