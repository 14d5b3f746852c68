"""Kratos' implicit material point method, stepped from outside: a scene on stdin, then orders,
answers as JSON lines.

Runs in a Python that has KratosMultiphysics and KratosMPMApplication and knows nothing of this
package.

The scene, a line of JSON: ``lines`` of the grid (2 lists, m), ``x`` and ``half`` (n, 2) of the
material points, ``young``, ``poisson``, ``density``, ``fixed`` {side: components}, ``load_at`` (k,
2) and ``load_area`` (k,) of the surface points, ``pressure`` (steps,) downwards at the end of each
step, ``dt``, ``law``, ``linear_solver``, ``newton``, ``rows`` of the points whose vertical stress
is asked for.  An order: a number of steps.  An answer: seconds, Newton iterations, ``stress``
(steps, rows), Pa.
"""

from __future__ import annotations

import json
import os
import sys
import time

import KratosMultiphysics as Kratos
import KratosMultiphysics.MPMApplication as Mpm
from KratosMultiphysics.MPMApplication.mpm_implicit_dynamic_solver import CreateSolver


def settings(scene: dict) -> Kratos.Parameters:
    """Newmark with β = ¼, γ = ½, consistent mass; one solve a step, or Newton to Kratos' default
    tolerance."""
    nothing = {"input_type": "use_input_model_part"}
    return Kratos.Parameters(
        json.dumps(
            {
                "model_part_name": "MPM_Material",
                "domain_size": 2,
                "echo_level": 0,
                "scheme_type": "newmark",
                "newmark_beta": 0.25,
                "analysis_type": "non_linear" if scene["newton"] else "linear",
                "time_stepping": {"time_step": scene["dt"]},
                "grid_model_import_settings": nothing,
                "model_import_settings": nothing,
                "convergence_criterion": "residual_criterion",
                "residual_relative_tolerance": 1e-4,
                "residual_absolute_tolerance": 1e-9,
                "max_iteration": 20,
                "consistent_mass_matrix": True,
                "linear_solver_settings": scene["linear_solver"],
            }
        )
    )


def quads(part, first: int, xs, ys, name: str, properties) -> None:
    """Nodes and quadrilaterals between grid lines."""
    for j, y in enumerate(ys):
        for i, x in enumerate(xs):
            part.CreateNewNode(first + i + j * len(xs), x, y, 0.0)
    cell = 1
    for j in range(len(ys) - 1):
        for i in range(len(xs) - 1):
            a = first + i + j * len(xs)
            part.CreateNewElement(name, cell, [a, a + 1, a + 1 + len(xs), a + len(xs)], properties)
            cell += 1


def bodies(part, first: int, first_cell: int, x, half, name: str, properties) -> None:
    """A quadrilateral around each material point, which is its centre."""
    sub = part.CreateSubModelPart("body")
    for p, (c, l) in enumerate(zip(x, half, strict=True)):
        ids = [first + 4 * p + k for k in range(4)]
        for i, (sx, sy) in zip(ids, ((-1, -1), (1, -1), (1, 1), (-1, 1)), strict=True):
            sub.CreateNewNode(i, c[0] + sx * l[0], c[1] + sy * l[1], 0.0)
        sub.CreateNewElement(name, first_cell + p, ids, properties)


class Run:
    """A scene in Kratos."""

    def __init__(self, scene: dict):
        self.scene, self.model, self.steps, self.time = scene, Kratos.Model(), 0, 0.0
        solver = self.solver = CreateSolver(self.model, settings(scene))
        solver.AddVariables()
        grid, body = solver.GetGridModelPart(), self.model["Initial_MPM_Material"]
        name, (xs, ys) = "MPMUpdatedLagrangian2D4N", scene["lines"]
        quads(grid, 1, xs, ys, name, grid.CreateNewProperties(0))
        soil = body.CreateNewProperties(1)
        for variable, value in (
            (Kratos.DENSITY, scene["density"]),
            (Kratos.YOUNG_MODULUS, scene["young"]),
            (Kratos.POISSON_RATIO, scene["poisson"]),
            (Kratos.THICKNESS, 1.0),
            (Mpm.MATERIAL_POINTS_PER_ELEMENT, 1),
        ):
            soil.SetValue(variable, value)
        soil.SetValue(Kratos.CONSTITUTIVE_LAW, getattr(Mpm, scene["law"])())
        nodes, cells = len(xs) * len(ys), (len(xs) - 1) * (len(ys) - 1)
        bodies(body, nodes + 1, cells + 1, scene["x"], scene["half"], name, soil)
        self._load(grid, nodes + 4 * len(scene["x"]) + 1)
        solver.ImportModelPart()
        solver.PrepareModelPart()
        solver.AddDofs()
        self._fix(grid)
        solver.Initialize()
        solver.Check()
        points = self.model["MPM_Material.body"].Elements
        self.watched = [p for row, p in enumerate(points) if row in set(scene["rows"])]
        self.loads = list(self.model["MPM_Material.load"].Conditions)

    def _load(self, grid, first: int) -> None:
        part = grid.CreateSubModelPart("load")
        for k, (x, y) in enumerate(self.scene["load_at"]):
            part.CreateNewNode(first + k, x, y, 0.0)
            condition = part.CreateNewCondition(
                "PointCondition2D1N", k + 1, [first + k], grid.GetProperties()[0]
            )
            condition.Set(Kratos.BOUNDARY, True)
            condition.SetValue(Mpm.MATERIAL_POINTS_PER_CONDITION, 1)
            condition.SetValue(Mpm.MPC_IS_NEUMANN, True)
            condition.SetValue(Mpm.POINT_LOAD, Kratos.Array3([0.0, 0.0, 0.0]))

    def _fix(self, grid) -> None:
        xs, ys = self.scene["lines"]
        at = {"left": (0, xs[0]), "right": (0, xs[-1]), "bottom": (1, ys[0])}
        for side, components in self.scene["fixed"].items():
            d, place = at[side]
            for node in grid.Nodes:
                if abs((node.X, node.Y)[d] - place) < 1e-9:
                    for c in components:
                        node.Fix({"x": Kratos.DISPLACEMENT_X, "y": Kratos.DISPLACEMENT_Y}[c])

    def step(self) -> int:
        """One step; Newton iterations."""
        solver, info = self.solver, self.solver.GetComputingModelPart().ProcessInfo
        self.time = solver.AdvanceInTime(self.time)
        pressure = self.scene["pressure"][self.steps]
        if self.loads and not any(self.scene["pressure"][self.steps :]):
            self._unload()
        for condition, area in zip(self.loads, self.scene["load_area"], strict=bool(self.loads)):
            condition.SetValuesOnIntegrationPoints(
                Mpm.POINT_LOAD, [Kratos.Array3([0.0, -pressure * area, 0.0])], info
            )
        # 10.4.4's own order, search after the equations are numbered, ends in a segmentation fault
        # as soon as a point enters a cell that was empty
        solver._SearchElement()
        solver.InitializeSolutionStep()
        solver._GetSolutionStrategy().Predict()
        if not solver.SolveSolutionStep() and self.scene["newton"]:
            raise RuntimeError(f"Newton did not converge in step {self.steps + 1}")
        solver.FinalizeSolutionStep()
        self.steps += 1
        return info[Kratos.NL_ITERATION_NUMBER]

    def _unload(self) -> None:
        """Take the surface points away: one that rises into an empty cell, even without a load,
        ends Kratos."""
        for condition in self.loads:
            condition.Set(Kratos.TO_ERASE, True)
        self.solver.GetComputingModelPart().RemoveConditionsFromAllLevels(Kratos.TO_ERASE)
        self.loads = []

    def stress(self) -> list[float]:
        """Vertical stress (Pa) of the points that are watched."""
        info = self.solver.GetComputingModelPart().ProcessInfo
        return [
            p.CalculateOnIntegrationPoints(Mpm.MP_CAUCHY_STRESS_VECTOR, info)[0][1]
            for p in self.watched
        ]


def main() -> None:
    """Answer orders until there are no more, on the file descriptor that is given: stdout is
    Kratos' own."""
    answers = os.fdopen(int(sys.argv[1]), "w")
    Kratos.Logger.GetDefaultOutput().SetSeverity(Kratos.Logger.Severity.WARNING)
    Kratos.ParallelUtilities.SetNumThreads(1)

    def answer(**found):
        print(json.dumps(found), file=answers, flush=True)

    run = Run(json.loads(sys.stdin.readline()))
    answer(
        version=Kratos.KratosGlobals.Kernel.Version(),
        points=len(run.model["MPM_Material.body"].Elements),
    )
    for order in sys.stdin:
        seconds, iterations, stress = 0.0, 0, []
        for _ in range(int(order)):
            start = time.perf_counter()
            iterations += run.step()
            seconds += time.perf_counter() - start
            stress.append(run.stress())
        answer(seconds=seconds, iterations=iterations, stress=stress)


if __name__ == "__main__":
    main()
