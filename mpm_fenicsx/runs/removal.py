"""Material points that leave the grid: they stop the run, or are taken out and accounted for."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from enum import Enum
from typing import NamedTuple

from mpi4py import MPI

import numpy as np

from ..common.checks import an_object
from ..common.errors import RunError
from ..common.ranks import anywhere
from ..points.material_points import MaterialPoints

BESIDE = 2.0
"""Half support domains from a point to the surface points on its faces, and a little more."""


class OnExit(Enum):
    """What becomes of material points that leave the grid.

    ``STOP``: the run ends with a ``RunError`` that names the point, its place and the time.
    ``REMOVE``: they are taken out; ``run.removed`` says how many, their mass and their energy,
    which the recorder ``Energy`` has as "removed".
    """

    STOP = "stop"
    REMOVE = "remove"


REMOVE = OnExit.REMOVE


class Removed(NamedTuple):
    """What has been taken out so far: ``points``, ``mass`` (kg) and ``energy`` (J), kinetic, strain
    and plastic."""

    points: int
    mass: float
    energy: float


class Removal:
    """Takes points out of a run; ``memory`` (3,): their number, mass (kg) and energy (J) of all
    ranks."""

    def __init__(self) -> None:
        self.memory = np.zeros(3)

    @property
    def removed(self) -> Removed:
        """What has been taken out so far."""
        points, mass, energy = self.memory.tolist()
        return Removed(round(points), mass, energy)

    def take_out(self, run, cells: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Leave out the points of the run's bodies whose ``cells`` (n,), one array a body, are
        below zero; returns those of the others.  Collective.

        Raises ``RunError``, on all ranks, for points that lie at no place, at a surface whose faces
        would stay behind, or after which a body has none.
        """
        comm = run.grid.comm
        lost = [np.flatnonzero(cell < 0) for cell in cells]
        if not comm.allreduce(sum(map(len, lost))):
            return list(cells)
        self._refuse(run, lost)
        found, sums = list(cells), np.zeros(3)
        for n, rows in enumerate(lost):
            if len(rows):
                body = run.bodies[n]
                sums += _account(_rows_of(body, rows), run.stepping.dynamic)
                stays = np.delete(np.arange(len(body)), rows)
                body.take({name: value[stays] for name, value in body.state().items()})
                found[n] = cells[n][stays]
        comm.Allreduce(MPI.IN_PLACE, sums)
        self.memory += sums
        return found

    def _refuse(self, run, lost: Sequence[np.ndarray]) -> None:
        comm, message = run.grid.comm, None
        gone = np.concatenate([b.x[rows] for b, rows in zip(run.bodies, lost, strict=True)])
        half = np.concatenate([b.half[rows] for b, rows in zip(run.bodies, lost, strict=True)])
        every = comm.allgather((gone, half))
        gone, half = (np.concatenate(part) for part in zip(*every, strict=True))
        bad = np.flatnonzero(~np.isfinite(gone).all(axis=1))
        if len(bad):
            message = f"a material point lies at x={gone[bad[0]]}, which is no place"
        for patch in run.scene.patches:
            for x, h in zip(gone, half, strict=True):
                if message is None and patch.points is not None and len(patch.points.x):
                    near = (np.abs(patch.points.x - x) <= BESIDE * h).all(axis=1)
                    if near.any():
                        message = (
                            f"the material point at x={x} leaves the grid together with {patch}, "
                            "whose faces cannot be taken out: give the grid room there, or act on "
                            "facets of the grid"
                        )
        for n, (body, rows) in enumerate(zip(run.bodies, lost, strict=True)):
            if comm.allreduce(len(body) - len(rows)) == 0 and message is None:
                message = f"all material points of body {n} have left the grid"
        message = anywhere(comm, message)
        if message:
            raise RunError(message)


def _rows_of(body: MaterialPoints, rows: np.ndarray) -> MaterialPoints:
    """Some of a body's points."""
    found = copy(body)
    found.parameters = dict(body.parameters)
    found.take({name: value[rows] for name, value in body.state().items()})
    return found


def _account(body: MaterialPoints, dynamic: bool) -> np.ndarray:
    """Number, mass (kg) and energy (J) of points."""
    kinematics = body.material.kinematics
    energy = kinematics.energy(body)
    if not body.material.linear:
        energy += kinematics.plastic_work(body)
    if dynamic and body.velocity is not None:
        energy += 0.5 * float(body.mass @ (body.velocity**2).sum(axis=1))
    return np.array([len(body), body.mass.sum(), energy])


def removal_of(on_exit) -> Removal | None:
    """What takes points out, or None where they stop the run.

    Raises ``ValueError`` for what is no ``OnExit``.
    """
    an_object("on_exit", on_exit, OnExit, "OnExit.STOP or OnExit.REMOVE")
    return Removal() if on_exit is REMOVE else None
