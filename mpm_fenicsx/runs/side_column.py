"""A column of finite elements that runs beside a run, a step ahead: what it does at each height."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ..terms.rayleigh_damping import RayleighDamping
from .finite_elements import FiniteElements


class Memory(Mapping):
    """The arrays by name that the next step of columns depends on: those that they have now."""

    def __init__(self, runs: Sequence[FiniteElements]):
        self._runs = list(runs)

    def __getitem__(self, name: str) -> np.ndarray:
        return self._all()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

    def _all(self) -> dict[str, np.ndarray]:
        return {
            f"column {k}/{name}": value
            for k, run in enumerate(self._runs)
            for name, value in run.state().items()
        }


def _damping(run: FiniteElements) -> np.ndarray:
    """α (1/s), β (s), βλ and βμ (Pa s), (materials, 4), of Rayleigh damping in each material."""
    found = []
    for law in run.materials.materials:
        acting = [
            term
            for term in run.terms
            if isinstance(term, RayleighDamping) and term.material in (None, law)
        ]
        α, β = sum(term.alpha for term in acting), sum(term.beta for term in acting)
        found.append((α, β, *(β * modulus for modulus in law.lame)))
    return np.array(found)


class SideColumn:
    """What a column does, by time and height, at the start and the end of the step.

    ``run``: that of the column; ``place`` (dim,), m, its middle.  It goes ahead to the end of a
    step before the run beside does, and back where that takes a step back.
    """

    def __init__(self, run: FiniteElements, place: np.ndarray):
        self.place = place
        self.run, grid = run, run.grid
        x = grid.space.tabulate_dof_coordinates()
        by_height = np.argsort(x[:, 1]).reshape(-1, 2 ** (grid.dim - 1))
        self._nodes = by_height[:, 0]
        self._rows = x[self._nodes, 1]
        self._cells = np.argsort(grid.centres[:, 1])
        self._damped = _damping(run)[run.materials.number[self._cells]]
        self._start = self._copied()
        self._at_rest = self._stress()
        self._from = self._to = 0.0
        self._known = [self._look()] * 2

    def _copied(self) -> dict[str, np.ndarray]:
        return {name: value.copy() for name, value in self.run.state().items()}

    def follow(self, start: float, end: float) -> None:
        """Take the column from the start to the end (s) of a step."""
        run = self.run
        if end > start:
            if start == self._from < self._to:  # again, perhaps by another length
                run.restore(self._start)
            elif run.yielding is not None:
                run.yielding.derive()
            self._start = self._copied()
            before = self._look()
            self._step(start, end)
            self._from, self._to, self._known = start, end, [before, self._look()]

    def _step(self, start: float, end: float) -> None:
        run, dt = self.run, end - start
        if abs(run.stepping.dt - dt) > 1e-9 * dt:
            run.change_step(run.stepping.part(dt / run.stepping.dt))
        run.begin_once()
        run.advance(start, end)

    def _look(self) -> dict[str, np.ndarray]:
        run = self.run
        names = ("displacement", "velocity", "acceleration")
        found = {name: run.nodal(name)[self._nodes].copy() for name in names}
        added = self._stress() - self._at_rest + self._viscous(found["velocity"])
        return {**found, "stress": added}

    def _stress(self) -> np.ndarray:
        """Stress rows (cells, components), Pa, the mean in each cell from below."""
        return self.run.stress(self._cells)

    def _viscous(self, velocity: np.ndarray) -> np.ndarray:
        """Stress rows (cells, components), Pa, of Rayleigh damping at velocities (rows, dim)."""
        dim, (_, _, βλ, βμ) = velocity.shape[1], self._damped.T
        rate = np.diff(velocity, axis=0) / np.diff(self._rows)[:, None]
        found = np.zeros((len(rate), 4 if dim == 2 else 6))
        found[:, :3] = (βλ * rate[:, 1])[:, None]
        found[:, 1] += 2.0 * βμ * rate[:, 1]
        found[:, 3 : 2 + dim] = βμ[:, None] * np.delete(rate, 1, axis=1)  # xy, yz
        return found

    def _of(self, name: str, t: float) -> np.ndarray:
        return self._known[int(abs(t - self._to) < abs(t - self._from))][name]

    def _nodal(self, name: str, t: float, x: np.ndarray) -> np.ndarray:
        values = self._of(name, t)
        return np.stack([np.interp(x[:, 1], self._rows, v) for v in values.T], axis=1)

    def displacement(self, t: float, x: np.ndarray) -> np.ndarray:
        """Displacement (n, dim), m."""
        return self._nodal("displacement", t, x)

    def velocity(self, t: float, x: np.ndarray) -> np.ndarray:
        """Velocity (n, dim), m/s."""
        return self._nodal("velocity", t, x)

    def acceleration(self, t: float, x: np.ndarray) -> np.ndarray:
        """Acceleration (n, dim), m/s²."""
        return self._nodal("acceleration", t, x)

    def stress(self, t: float, x: np.ndarray) -> np.ndarray:
        """Stress rows (n, components), Pa, that of the row of cells."""
        return self._of("stress", t)[self._row(x)]

    def damping(self, x: np.ndarray) -> np.ndarray:
        """α (1/s) and β (s) of Rayleigh damping (n, 2) at places (n, dim), m."""
        return self._damped[self._row(x), :2]

    def _row(self, x: np.ndarray) -> np.ndarray:
        row = np.searchsorted(self._rows, x[:, 1]) - 1
        return np.clip(row, 0, len(self._cells) - 1)


class Between:
    """What comes in between two columns, in proportion to the distance along x; that of the nearer
    beyond them."""

    def __init__(self, columns: Sequence[SideColumn]):
        self._columns = sorted(columns, key=lambda column: column.place[0])

    def displacement(self, t: float, x: np.ndarray) -> np.ndarray:
        """Displacement (n, dim), m."""
        return self._of("displacement", t, x)

    def velocity(self, t: float, x: np.ndarray) -> np.ndarray:
        """Velocity (n, dim), m/s."""
        return self._of("velocity", t, x)

    def acceleration(self, t: float, x: np.ndarray) -> np.ndarray:
        """Acceleration (n, dim), m/s²."""
        return self._of("acceleration", t, x)

    def stress(self, t: float, x: np.ndarray) -> np.ndarray:
        """Stress rows (n, components), Pa."""
        return self._of("stress", t, x)

    def damping(self, x: np.ndarray) -> np.ndarray:
        """α (1/s) and β (s) of Rayleigh damping (n, 2) at places (n, dim), m."""
        return self._mixed(x, [column.damping(x) for column in self._columns])

    def _of(self, name: str, t: float, x: np.ndarray) -> np.ndarray:
        return self._mixed(x, [getattr(column, name)(t, x) for column in self._columns])

    def _mixed(self, x: np.ndarray, values: Sequence[np.ndarray]) -> np.ndarray:
        a, b = self._columns[0].place[0], self._columns[-1].place[0]
        if a == b:
            return values[0]
        share = np.clip((x[:, 0] - a) / (b - a), 0.0, 1.0)[:, None]
        return (1.0 - share) * values[0] + share * values[-1]
