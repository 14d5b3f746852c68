"""What the grid does in a step, and whole steps: material points and the finite element twins."""

import cost_scenes
import pytest

pytest.importorskip("pytest_benchmark")


@pytest.mark.parametrize("method", ("MPM", "DM-GC", "FE"))
def test_assemble_stiffness(benchmark, block, method):
    benchmark(block(method).equilibrium.assemble_tangent)


@pytest.mark.parametrize("method", ("DM-GC", "FE", "FE, Cholesky"))
def test_preconditioner_and_linear_solve(benchmark, block, method):
    equilibrium = block(method).equilibrium

    def prepare():
        equilibrium.motion.clear()
        equilibrium.assemble_tangent()
        equilibrium.refresh(None)

    benchmark.pedantic(equilibrium.correct, setup=prepare, rounds=20, warmup_rounds=2)


@pytest.mark.parametrize("method", cost_scenes.METHODS)
def test_step(benchmark, block, method):
    benchmark.pedantic(block(method).step, rounds=20, warmup_rounds=2)
