"""The grid is divided anew among the ranks when their work has become too uneven."""

from __future__ import annotations

import gc
import warnings
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from ..common.checks import an_object, finite, whole
from ..common.ranks import anywhere

AGAIN = 1.1
"""Of the imbalance that the last division has left: so much worse it must become for the next."""


@dataclass(frozen=True)
class Repartition:
    """When the ranks' work counts as uneven, and what it is made of.

    A material point counts 1, a cell with material in it, or beside one, ``cell``; imbalance is
    what the fullest rank has over the mean.  It is looked at every ``every`` steps; where it is
    above ``above``, and 1.1 times worse than the last division has left it, the grid is divided
    anew.  That costs as much as making the run (``studies/scaling.py`` says when it pays).
    ``cell`` = 2.5 is what a finite element step costs a cell over what the points add to it each,
    in 2D (results/cost_of_a_step.json).

    Raises ``ValueError`` for ``above`` <= 1, ``every`` < 1 or ``cell`` < 0.
    """

    above: float = 1.2
    every: int = 20
    cell: float = 2.5

    def __post_init__(self) -> None:
        if not finite("above", self.above) > 1.0:
            raise ValueError(f"above must be more than 1, which is balance, got {self.above}")
        whole("every", self.every)
        if not finite("cell", self.cell) >= 0.0:
            raise ValueError(f"cell must be at least 0 points' worth, got {self.cell}")


class Repartitioner:
    """Follows the imbalance of a run; ``memory`` (2,): what the last division has left, and how
    many there were."""

    def __init__(self, repartition: Repartition):
        an_object("repartition", repartition, Repartition, "Repartition()")
        self.when, self.memory = repartition, np.array([1.0, 0.0])

    def check(self, scene) -> None:
        """Raise ``ValueError`` for what cannot go to other ranks with the grid."""
        held = next((p for p in scene.patches if p.on_the_mesh), None)
        if held is not None:
            raise ValueError(
                f"repartition: the load on {held} is a field on the grid's mesh, and is lost when "
                "the grid is divided anew: give a function of time and place"
            )
        own = [str(p) for p in scene.patches if p.of_its_own]
        if anywhere(scene.grid.comm, own[0] if own else None):
            raise ValueError(
                "repartition: a load on surface points is given row by row, on each rank for its "
                "own, which are others when the grid is divided anew: give all rows on every rank, "
                "or a function of time and place"
            )

    def look(self, run) -> None:
        """Divide the run's grid anew if that is due.  Collective."""
        comm = run.grid.comm
        if comm.size == 1 or run.steps % self.when.every:
            return
        weight = work(run, self.when.cell)
        if imbalance(comm, weight) > max(self.when.above, AGAIN * self.memory[0]):
            run.divide(weight)
            left = imbalance(run.grid.comm, work(run, self.when.cell))
            self.memory[:] = left, self.memory[1] + 1


def work(run, cell: float) -> np.ndarray:
    """What each of this rank's own cells (cells,) costs in a step, in points.  Collective."""
    grid = run.grid
    points = np.zeros(grid.cells)
    for of_body in run.cells:
        points += np.bincount(of_body, minlength=grid.cells)
    held = grid.lattice.spread(grid.share_cells((points > 0.0).astype(np.int8)).astype(bool))
    plain = run.scene.plain_cells()
    if plain is not None:
        held |= plain
    return (points + cell * held)[: grid.owned_cells]


def imbalance(comm: MPI.Comm, weight: np.ndarray) -> float:
    """What the fullest rank has over the mean of all.  Collective."""
    mine = float(weight.sum())
    whole_work = comm.allreduce(mine)
    return comm.allreduce(mine, op=MPI.MAX) * comm.size / whole_work if whole_work else 1.0


def divide(run, weight: np.ndarray) -> None:
    """Divide the run's grid anew, by the weight of each of this rank's own cells, and go on as if
    nothing had happened.  Collective."""
    now = run.part()
    now = now._replace(state={name: value.copy() for name, value in now.state.items()})
    run.forget_fields()
    counts = run.solves, run.iterations, run.rescues
    run.grid.repartition(weight)
    points = run.points_of([now])
    for cloud, arrays in points.items():
        run.move_points(cloud, arrays)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # they have been said
        run.build()
    gc.collect()  # what PETSc and MPI free together, on all ranks now
    run.put([now], points)
    run.equilibrium.solves, run.equilibrium.iterations, run.equilibrium.rescues = counts
    for recorder in run.recorders:
        if hasattr(recorder, "moved"):
            recorder.moved(run)
