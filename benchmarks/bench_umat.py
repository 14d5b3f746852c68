"""Nanoseconds a point that the call of a UMAT costs around the routine's own work."""

import shutil
import subprocess
import time

import numpy as np
import pytest

import mpm_fenicsx as mpm

N = 20_000
EMPTY = "void empty_() {}\n"


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler named cc")
@pytest.mark.parametrize("dim", [2, 3])
def test_an_empty_routine_costs_at_most_250_ns_a_point(tmp_path, dim):
    (tmp_path / "empty.c").write_text(EMPTY)
    library = tmp_path / "empty.so"
    subprocess.run(
        ["cc", "-O2", "-shared", "-fPIC", "-o", library, tmp_path / "empty.c"], check=True
    )
    elastic = mpm.LinearElastic(young=20e6, poisson=0.3, density=1800.0)
    law = mpm.Umat(library, [1.0] * 5, 2, elastic=elastic, symbol="empty_")
    known = mpm.VonMises(elastic, peak=1e3, residual=1e3, softening=0.0)
    strain = np.full((N, mpm.tensors.components(dim)), 1e-4)
    stress = np.zeros_like(strain)
    best = {}
    for one in (law, known):
        history = one.initial_history(stress)
        times = []
        for _ in range(30):
            start = time.perf_counter()
            one.tangent(strain, stress, history)
            times.append(time.perf_counter() - start)
        best[one] = min(times) / N * 1e9
    print(f"{dim}D: empty UMAT {best[law]:.0f} ns, von Mises {best[known]:.0f} ns a point")
    assert best[law] < 250.0
