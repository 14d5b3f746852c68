"""A million material points in 3D: what a run of a few steps takes.

The footing of ``mpm_fenicsx.scenes.footing_3d`` between viscous boundaries, in so many cells that
the block holds about ``--points``, with a step of Courant number ½.  Printed are the seconds to
build it and for a step (the slowest rank; the first step, which compiles, on its own), iterations
of the linear solver, the memory of all ranks at its peak, the size of five snapshots, and how many
points with a finite stress each has when read back::

    mpiexec -n 2 python -m mpi4py studies/million.py --points 1000000
"""

from __future__ import annotations

import argparse
import json
import resource
import shutil
import tempfile
import time
from pathlib import Path

from mpi4py import MPI

import meshio
import numpy as np

from mpm_fenicsx import Snapshots
from mpm_fenicsx.scenes.footing_3d import Footing, soil

SNAPSHOTS = 5


def scene_of(points: int) -> Footing:
    """The footing in cells that hold about so many points, eight each; its edge on a grid line."""
    across = max(2, round((points / 8) ** (1 / 3)))
    cell = 4.0 / across
    half = max(1, round(across / 4)) * cell
    return Footing("viscous", half=(half, half), cell=cell, step=0.5 * cell / soil.p_speed)


def measure(points: int, steps: int, folder: Path) -> dict:
    """Build and run; what it took, the same on every rank."""
    comm, scene, clock = MPI.COMM_WORLD, scene_of(points), time.perf_counter
    path = folder / "million"
    began = clock()
    run = scene.material_points()
    built = comm.allreduce(clock() - began, op=MPI.MAX)
    began = clock()
    run.step()
    first = comm.allreduce(clock() - began, op=MPI.MAX)
    seconds, iterations = [], []
    for _ in range(steps):
        comm.Barrier()
        began = clock()
        run.step()
        seconds.append(comm.allreduce(clock() - began, op=MPI.MAX))
        iterations.append(run.iterations)
    before_snapshots = _peaks(comm)
    began = clock()
    run.record(Snapshots(path, every=1))  # writes one now
    for _ in range(SNAPSHOTS - 1):
        run.step()
    written = comm.allreduce(clock() - began, op=MPI.MAX)
    comm.Barrier()
    after = _peaks(comm)
    sizes, read = comm.bcast(_read(folder) if comm.rank == 0 else None)
    return {
        "ranks": comm.size,
        "points": comm.allreduce(sum(len(body) for body in run.bodies)),
        "points_of_ranks": comm.allgather(sum(len(body) for body in run.bodies)),
        "cells": run.grid.mesh.topology.index_map(3).size_global,
        "build_s": built,
        "first_step_s": first,
        "step_s": sorted(seconds)[len(seconds) // 2],
        "iterations": iterations,
        "peak_mib_of_ranks": before_snapshots,
        "peak_mib": sum(before_snapshots),
        "peak_mib_with_snapshots": sum(after),
        "snapshots": SNAPSHOTS,
        "snapshots_and_steps_s": written,
        "snapshot_bytes": sizes,
        "points_read": read,
    }


def _read(folder: Path) -> tuple[dict[str, int], list[int]]:
    """Bytes of files by their kind; points that each snapshot has, read back from its pieces,
    every one with a finite stress."""
    files = [file for file in sorted(folder.rglob("*")) if file.is_file()]
    sizes, points = {}, {}
    for file in files:
        sizes[file.suffix] = sizes.get(file.suffix, 0) + file.stat().st_size
    for file in (file for file in files if file.suffix == ".vtu" and "_points_" in file.name):
        count, stress = file.stem.split("_")[2], meshio.read(file).point_data["stress"]
        points[count] = points.get(count, 0) + int(np.isfinite(stress).all(axis=1).sum())
    return sizes, list(points.values())


def _peaks(comm: MPI.Comm) -> list[float]:
    """Largest resident memory of each rank so far (MiB)."""
    return comm.allgather(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def main(arguments=None) -> dict:
    """Run, print, and write what was measured where ``--results`` says."""
    parser = argparse.ArgumentParser(description="What a run of many points in 3D takes")
    parser.add_argument("--points", type=int, default=4096, help="about (default: 4096)")
    parser.add_argument("--steps", type=int, default=5, help="after the first (default: 5)")
    parser.add_argument("--results", type=Path, help="file for the figures, JSON")
    chosen = parser.parse_args(arguments)
    comm = MPI.COMM_WORLD
    folder = Path(comm.bcast(tempfile.mkdtemp(prefix="million_") if comm.rank == 0 else None))
    try:
        found = measure(chosen.points, chosen.steps, folder)
    finally:
        if comm.rank == 0:
            shutil.rmtree(folder)
    if comm.rank == 0:
        for name, value in found.items():
            print(f"{name:24} {value:.4g}" if isinstance(value, float) else f"{name:24} {value}")
        if chosen.results:
            chosen.results.write_text(json.dumps(found, indent=1) + "\n")
    return found


if __name__ == "__main__":
    main()
