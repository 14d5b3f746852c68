"""What each rank of ``scaling`` does: it builds a scene, waits for orders without keeping its core
busy, takes steps, and counts what it sends."""

from __future__ import annotations

import json
import sys
import time
from collections import defaultdict
from collections.abc import Iterator

from mpi4py import MPI

import numpy as np
from cost_pieces import PIECES, Bill, peak, resident
from petsc4py import PETSc
from scaling_scenes import block, collapse

import mpm_fenicsx as mpm
from mpm_fenicsx.grid import dolfinx_versions
from mpm_fenicsx.runs.repartitioning import imbalance, work

PAUSE = 2e-3  # s between looks for an order
SMALL, LARGE = 8, 2**20  # bytes of a message whose time is latency, or bandwidth
REDUCTIONS = ("VecTDot", "VecDot", "VecNorm")  # of PETSc's solvers, each a sum over the ranks


def orders(comm: MPI.Comm) -> Iterator[dict]:
    """Orders, a line of JSON each, that the first rank reads; who waits sleeps.  Collective."""
    buffer = np.zeros(1000, np.uint8)
    while True:
        if comm.rank == 0:
            line = sys.stdin.readline().strip().encode()
            buffer[:] = 0
            buffer[: len(line)] = np.frombuffer(line, np.uint8)
        request = comm.Ibcast(buffer)
        while not request.Test():
            time.sleep(PAUSE)
        line = buffer[buffer > 0].tobytes()
        if not line:
            return
        yield json.loads(line)


class Counted(MPI.Intracomm):
    """A communicator that counts what all ranks do together, and the bytes it takes along."""

    def __new__(cls, comm: MPI.Intracomm):
        found = super().__new__(cls, comm)
        found.calls, found.bytes = 0, 0
        return found

    def _count(self, what) -> None:
        self.calls += 1
        array = what[1] if isinstance(what, list) else what
        self.bytes += array.nbytes if isinstance(array, np.ndarray) else 8


def _counting(name: str):
    def method(self, *arguments, **named):
        of_interest = next((a for a in arguments if a is not MPI.IN_PLACE), None)
        self._count(of_interest)
        return getattr(super(Counted, self), name)(*arguments, **named)

    return method


for _name in ("allreduce", "Allreduce", "allgather", "bcast", "Alltoall"):
    setattr(Counted, _name, _counting(_name))


class BillOfRanks(Bill):
    """Seconds of each piece, with ``migrate``: where points belong, and the way there."""

    def __init__(self, run):
        super().__init__(run)
        if run.migration is not None:
            for name in ("destinations", "send"):
                self._watch(run.migration, name, "migrate")


class Served:
    """A run on this rank, and what can be asked of it.  Every method is collective."""

    def __init__(self, comm: MPI.Intracomm, scene: dict):
        self.comm, self.divisions, self.run = comm, [], None
        kind = scene.pop("scene")
        if kind == "block":
            block(scene["dim"], [4] * scene["dim"], jacobi=scene.get("jacobi", False)).step()
            self._empty = resident()
            began = time.perf_counter()
            self.run = block(**scene)
            self.build = time.perf_counter() - began
            if scene.get("sliding") and comm.size > 1:
                self.run.divide(work(self.run, mpm.Repartition().cell))
            self.bill = BillOfRanks(self.run)
        elif kind == "collapse":
            collapse(2.0, None).step()  # what is compiled is loaded
            self.run = collapse(
                scene["cell"], mpm.Repartition(every=5) if scene["balance"] else None
            )
            self._divide, self.run.divide = self.run.divide, self._divided

    def ready(self) -> bool:
        """Whether the scene is built: when this is answered it is."""
        return True

    def steps(self, count: int) -> dict:
        """Take steps: seconds and CPU seconds a step, and those of each piece, of the slowest rank;
        points and share of them that has gone to another rank."""
        body, before = self.run.bodies[0], self.divisions_cost()
        if hasattr(self, "bill"):
            self.bill.seconds.clear()
        numbers = None if body.number is None else body.number.copy()
        self.comm.Barrier()
        wall, cpu = time.perf_counter(), time.process_time()
        for _ in range(count):
            self.run.step()
        cpu = time.process_time() - cpu - (self.divisions_cost() - before)
        wall = time.perf_counter() - wall
        gone = 0 if numbers is None else np.setdiff1d(numbers, body.number).size
        found = {"wall": wall / count, "cpu": cpu / count, "gone": gone / count}
        if hasattr(self, "bill"):
            found |= {p: self.bill.seconds[p] / count for p in (*PIECES, "migrate")}
        of_ranks = self.comm.gather({**found, "points": len(body)})
        uneven = imbalance(self.comm, work(self.run, mpm.Repartition().cell))
        if self.comm.rank:
            return {}
        most = {name: max(one[name] for one in of_ranks) for name in found}
        points = [one["points"] for one in of_ranks]
        most["gone"] = sum(one["gone"] for one in of_ranks) / sum(points)
        pieces = {p: most.pop(p) for p in (*PIECES, "migrate") if p in most}
        return {
            **most,
            "pieces": pieces,
            "iterations": self.run.iterations,
            "solves": self.run.solves,
            "points": points,
            "cells": self.run.grid.mesh.topology.index_map(self.run.grid.dim).size_global,
            "imbalance": uneven,
            "time": self.run.time,
        }

    def divisions_cost(self) -> float:
        """CPU seconds of this rank for all divisions of the grid so far."""
        return sum(cpu for _, _, cpu in self.divisions)

    def _divided(self, weight: np.ndarray) -> None:
        wall, cpu = time.perf_counter(), time.process_time()
        self._divide(weight)
        self.divisions.append(
            (self.run.steps, time.perf_counter() - wall, time.process_time() - cpu)
        )

    def divided(self) -> list[dict]:
        """Step, seconds and CPU seconds, of the slowest rank, of each division of the grid."""
        of_ranks = self.comm.gather(self.divisions)
        return [
            {"step": one[0][0], "wall": max(d[1] for d in one), "cpu": max(d[2] for d in one)}
            for one in zip(*(of_ranks or []), strict=True)
        ]

    def divide(self) -> dict:
        """Seconds and CPU seconds of dividing the grid anew; clocks around pieces are lost."""
        self._divide = self.run.divide
        self._divided(work(self.run, mpm.Repartition().cell))
        return (self.divided() or [{}])[-1]

    def memory(self) -> dict:
        """Bytes of each rank above those of a tiny run, at their most, and seconds that the scene
        took to be built."""
        found = self.comm.gather((peak() - self._empty, self.build)) or [(0, 0.0)]
        return {"bytes": [one for one, _ in found], "build": max(one for _, one in found)}

    def volume(self, count: int) -> dict:
        """What a step of so many sends, of the rank that sends most: bytes of fields between ghosts
        and their owners, of the matrix, of the solver's vectors and of points; messages of PETSc;
        sums over all ranks, the solver's and the others; iterations of a step of one solve."""
        run, grid = self.run, self.run.grid
        sent = defaultdict(float)
        grid.comm = counted = Counted(grid.comm)
        plain = {name: getattr(dolfinx_versions, name) for name in PASSES}
        for name, passes in PASSES.items():

            def watched(f, call=plain[name], passes=passes):
                space = f.function_space.dofmap
                width = 8 * space.index_map_bs
                sent["fields"] += passes * width * space.index_map.num_ghosts
                sent["field_passes"] += passes
                call(f)

            setattr(dolfinx_versions, name, watched)
        if run.migration is not None:
            first, end = grid.mesh.topology.index_map(grid.dim).local_range
            send = run.migration.send

            def leaving(arrays, cells, far):
                gone = np.count_nonzero((cells < first) | (cells >= end))
                sent["points"] += gone * (
                    8 + sum(a.nbytes // max(len(a), 1) for a in arrays.values())
                )
                return send(arrays, cells, far)

            run.migration.send = leaving
        events = {
            name: PETSc.Log.Event(name) for name in ("KSPSolve", "MatAssemblyBegin", *REDUCTIONS)
        }
        before = {name: event.getPerfInfo() for name, event in events.items()}
        iterations = 0
        for _ in range(count):
            run.step()
            iterations += run.iterations
        after = {name: event.getPerfInfo() for name, event in events.items()}
        for name, call in plain.items():
            setattr(dolfinx_versions, name, call)

        def of(event: str, figure: str) -> float:
            return float(after[event][figure] - before[event][figure])

        # PETSc counts what is sent and what is received
        sent["solver"] = of("KSPSolve", "messageLength") / 2
        sent["solver_messages"] = of("KSPSolve", "numMessages") / 2
        sent["matrix"] = of("MatAssemblyBegin", "messageLength") / 2
        sent["solver_sums"] = sum(of(name, "count") for name in REDUCTIONS)
        sent["other_sums"], sent["sums_bytes"] = counted.calls, counted.bytes
        nodes = dolfinx_versions.cell_dofs(grid.space)
        shared = np.intersect1d(nodes[: grid.owned_cells], nodes[grid.owned_cells :])
        names = ("fields", "field_passes", "matrix", "solver", "solver_messages", "points")
        names += ("solver_sums", "other_sums", "sums_bytes")
        found = {name: sent[name] / count for name in names}
        found |= {"boundary_nodes": len(shared), "neighbours": len(grid.neighbours[0])}
        of_ranks = self.comm.gather(found)
        if self.comm.rank:
            return {}
        return {
            **{name: max(one[name] for one in of_ranks) for name in found},
            "iterations": iterations / count,
        }

    def network(self) -> dict:
        """Seconds of a small message one way, bytes a second of a large one, both between the first
        two ranks, and seconds of a sum over all ranks."""
        comm = self.comm

        def least(call, seconds: float = 1.0) -> float:
            found, end = [], comm.bcast(time.time() + seconds)
            while comm.bcast(time.time() < end) or not found:
                began = time.perf_counter()
                for _ in range(50):
                    call()
                found.append((time.perf_counter() - began) / 50)
            return float(np.median(found))

        def there_and_back(buffer: np.ndarray):
            if comm.rank == 0:
                comm.Send(buffer, 1)
                comm.Recv(buffer, 1)
            elif comm.rank == 1:
                comm.Recv(buffer, 0)
                comm.Send(buffer, 0)

        small, large = (np.zeros(n, np.uint8) for n in (SMALL, LARGE))
        one, total = np.zeros(1), np.zeros(1)
        latency = least(lambda: there_and_back(small)) / 2
        through = least(lambda: there_and_back(large)) / 2
        return {
            "latency_s": latency,
            "bytes_a_second": LARGE / through,
            "sum_s": least(lambda: comm.Allreduce(one, total)),
        }


PASSES = {"gather": 2, "gather_to_owner": 1, "share": 1}
"""How often functions of ``dolfinx_versions`` go over the ghosts of a field."""


def serve(scene: dict, answers: str) -> None:
    """Build a scene on all ranks and do what is ordered, until there are no more orders; a line
    with an answer begins with ``answers``."""
    comm = MPI.COMM_WORLD
    served = Served(comm, scene)
    for order in orders(comm):
        answer = getattr(served, order.pop("do"))(**order)
        if comm.rank == 0:
            print(answers + json.dumps(answer), flush=True)
