"""Two ranks compute what one computes; three do where validation is asked for."""

import json
import os
import pathlib
import shutil
import subprocess
import sys

import numpy as np
import pytest
import ranks

SHARING_CORES = {
    "MPIR_CVAR_ENABLE_HEAVY_YIELD": "1",  # MPICH: who waits sleeps for a moment
    "OMPI_MCA_mpi_yield_when_idle": "1",  # Open MPI: who waits lets others go first,
    "OMPI_MCA_hwloc_base_binding_policy": "none",  # and runs beside one another share all cores
}
"""Settings for more ranks than cores, and for runs beside one another."""


def mpiexec() -> str | None:
    """The mpiexec of this Python's MPI: beside it, or on PATH."""
    beside = pathlib.Path(sys.executable).parent / "mpiexec"
    return str(beside) if beside.exists() else shutil.which("mpiexec")


def environment() -> dict[str, str]:
    """This one, without what MPI told this process about itself; Open MPI may run as root and share
    cores."""
    kept = {
        k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMIX_", "PMI_", "PRTE_"))
    }
    root = pathlib.Path(__file__).parent.parent
    path = os.pathsep.join([str(root), *filter(None, [os.environ.get("PYTHONPATH")])])
    return {
        **kept,
        "PYTHONPATH": path,
        "OMP_NUM_THREADS": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        **SHARING_CORES,
    }


def on_ranks(count: int, *arguments: str | os.PathLike, cwd: str | None = None) -> str:
    """What Python with ``arguments`` prints on so many ranks; all of it must end well."""
    program = mpiexec()
    if program is None:
        pytest.skip("no mpiexec beside Python or on PATH")
    command = [program, "-n", str(count), sys.executable, "-m", "mpi4py", *map(str, arguments)]
    done = subprocess.run(
        command, env=environment(), cwd=cwd, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout


@pytest.fixture(scope="module")
def serial() -> dict:
    return ranks.everything()


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(2, marks=pytest.mark.ranks),
        pytest.param(3, marks=pytest.mark.validation),
    ],
)
def several(request, tmp_path_factory) -> dict:
    out = tmp_path_factory.mktemp("ranks") / "out.json"
    on_ranks(request.param, ranks.__file__, out)
    return json.loads(out.read_text())


def difference(several: dict, serial: dict) -> float:
    """Largest difference over the largest value; the keys must be the same."""
    assert sorted(several) == sorted(serial)
    keys = sorted(serial)
    a, b = (np.array([rows[k] for k in keys]) for rows in (several, serial))
    return np.abs(a - b).max() / np.abs(b).max()


@pytest.mark.parametrize("mapping", ["MPM", "GIMP", "DM-GC"])
@pytest.mark.parametrize("dim", [2, 3])
def test_points_that_do_not_move_give_the_same_numbers(several, serial, dim, mapping):
    case = f"still {dim}D {mapping}"
    for quantity, expected in serial[case].items():
        tolerance = (
            1e-8 if quantity == "increment" else 1e-12
        )  # the solver stops at 1e-11 of the residual
        assert difference(several[case][quantity], expected) < tolerance, quantity


@pytest.mark.parametrize("mapping", ["MPM", "GIMP", "DM-GC", "B-bar", "GhostPenalty"])
@pytest.mark.parametrize("dim", [2, 3])
def test_a_few_steps_lead_to_the_same_points(several, serial, dim, mapping):
    case = f"moving {dim}D {mapping}"
    assert difference(several[case]["points"], serial[case]["points"]) < 1e-9


@pytest.mark.parametrize("dim", [2, 3])
def test_a_cut_body_comes_to_the_same_rest(several, serial, dim):
    case = f"settled {dim}D"
    assert difference(several[case]["points"], serial[case]["points"]) < 1e-9
    assert several[case]["refused"] == serial[case]["refused"] == {"": [1.0]}


@pytest.mark.parametrize(
    "case",
    [
        "twin 2D",
        "twin 3D",
        "static twin 2D",
        "static twin 3D",
        "static twin 2D B-bar",
        "static twin 3D B-bar",
    ],
)
def test_the_finite_element_twin_is_the_same(several, serial, case):
    assert difference(several[case]["displacement"], serial[case]["displacement"]) < 1e-10


@pytest.mark.parametrize(
    "case",
    [
        f"{what} {dim}D{more}"
        for dim in (2, 3)
        for what, more in (("two bodies", " DM-GCL"), ("surfaces by hand", ""), ("jitter", ""))
    ],
)
def test_sums_over_points_and_surfaces_do_not_depend_on_who_holds_them(several, serial, case):
    tolerance = 1e-15 if "jitter" in case else 1e-9
    for quantity, expected in serial[case].items():
        assert difference(several[case][quantity], expected) < tolerance, quantity


@pytest.mark.parametrize(
    "case",
    [
        "Hencky, empty",
        "Hencky at points, empty",
        "Hencky in statics, empty",
        "von Mises, empty",
        "von Mises at points, empty",
        "one cell",
        "two cells",
        "two cells in statics",
        "one cell in 3D",
        "twin, one cell",
        "twin, one cell, Hencky",
        "twin, one cell, von Mises",
        "layers 2D",
        "layers 3D",
    ],
)
def test_a_rank_may_have_no_points_and_no_cells_and_layers_are_the_same(several, serial, case):
    for quantity, expected in serial[case].items():
        assert difference(several[case][quantity], expected) < 1e-9, quantity


@pytest.mark.parametrize("what", ["blocks", "factor"])
def test_options_for_blocks_and_factors_reach_them(several, serial, what):
    assert several["options"][what][""] == serial["options"][what][""] == [1.0]


@pytest.mark.parametrize(
    "what", ["outside", "lost", "inverted", "surface outside", "size", "empty"]
)
def test_what_goes_wrong_on_one_rank_stops_all(several, what):
    assert several["refusals"][what][""] == [1.0]
