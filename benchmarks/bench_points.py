"""What points do in a step, kernel by kernel."""

import numpy as np
import pytest

pytest.importorskip("pytest_benchmark")
RECOVERY = 3e-3  # s, at most; naive patches took 33e-3


@pytest.fixture(params=("MPM", "DM-GC"))
def run(request, block):
    """Linear weights and projection to all moments; local averages and eq. (7)."""
    return block(request.param)


def test_walk(benchmark, run):
    body, cell = run.bodies[0], run.cells[0]
    benchmark(run.grid.walk, body.x, cell)


def test_place_stencil(benchmark, run):
    body = run.bodies[0]
    benchmark(run.stencils[0].place, body.x, body.half, run.cells[0])


def test_locate(benchmark, run):
    benchmark(run.locate)


def test_project(benchmark, run):
    benchmark(run.project)


def test_deposit_mass_and_momentum(benchmark, run):
    body = run.bodies[0]
    values = np.hstack(
        (
            body.mass[:, None],
            body.mass[:, None] * body.velocity,
            body.mass[:, None] * body.acceleration,
        )
    )
    nodal = np.zeros((run.grid.nodes, values.shape[1]))
    benchmark(run.stencils[0].deposit, values, nodal)


def test_predict(benchmark, run):
    benchmark(run.predict)


def test_deposit_internal_force(benchmark, run):
    stress = np.ones((len(run.bodies[0]), 2, 2))
    benchmark(run.stencils[0].deposit_divergence, stress, np.zeros((run.grid.nodes, 2)))


def test_gradients(benchmark, run):
    benchmark(run.stencils[0].gradient_at_points, run.nodal("increment"))


def test_values(benchmark, run):
    benchmark(run.stencils[0].at_points, run.nodal("increment"))


def test_place_composite(benchmark, block):
    run = block("DM-GC")
    filled = np.zeros(run.grid.cells, np.int8)
    filled[run.cells[0]] = 1
    benchmark(run.composites[0].place, filled)


def test_composite_gradients(benchmark, block):
    run = block("DM-GC")
    benchmark(
        run.composites[0].gradient_at_points,
        run.bodies[0].x,
        run.cells[0],
        run.nodal("increment"),
    )
    assert benchmark.stats.stats.min <= RECOVERY
