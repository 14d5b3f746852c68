"""The study of several ranks: its runs answer orders and count what they send, its model gives back
the constants that it was made of, and it goes on where it was."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from test_ranks import mpiexec

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import report
import scaling
import scaling_model
import scaling_report
from scaling_model import CELLS, POINTS, Constants, seconds

from mpm_fenicsx.scenes.pressed_block import soil

NETWORK = {"latency_s": 1e-6, "bytes_a_second": 1e9, "sum_s": 3e-6, "level_s": 3e-6}
KNOWN = {
    dim: Constants(dim, 20, 2e-3, 4e-7, 9e-7, 2e-8, 1e3, 20.0, 30, 1.0, 12, 2.0, 4e-4, 1.25)
    for dim in (2, 3)
}
EDGE = {"boundary_nodes": 50, "neighbours": 1, "iterations": 20}


def run_of(of: Constants, points: int, ranks: int) -> dict:
    """What a run would answer whose time were that of the model."""
    parts = seconds(of, points, ranks, NETWORK, 1.0, 50, 1)
    cells = points / 2**of.dim
    pieces = dict.fromkeys((*POINTS, *CELLS, "solve"), 0.0)
    # a fixed second belongs to the pieces in proportion, as the model takes it
    grows = {
        "locate": of.point * points,
        "assemble": of.cell * cells,
        "solve": 20 * of.iteration * cells,
    }
    whole = sum(grows.values())
    pieces |= {name: s * (1.0 + of.fixed / whole) for name, s in grows.items()}
    sent = {"fields": 600.0, "matrix": 400.0, "solver": 400.0, "points": 0.0}
    volume = {name: 50 * size for name, size in sent.items()} | EDGE
    volume |= {"field_passes": 30, "solver_messages": 20, "other_sums": 12, "solver_sums": 40}
    return {
        "wall": sum(parts.values()),
        "cpu": sum(parts.values()),
        "gone": 0.0,
        "points": [points // ranks] * ranks,
        "iterations": 20,
        "imbalance": 1.0,
        "bytes": [10**8 + 2000 * points],
        "pieces": pieces,
        "division": {"wall": 1.0, "cpu": 1.0},
        "volume": volume,
    }


def answer(case: dict) -> dict:
    """The row of a case, as if it had been measured."""
    if case["kind"] == "network":
        return {**case, "points": 0, "runs": {"2": NETWORK}}
    if case["kind"] == "balance":
        series = [{"time": 0.1 * n, "imbalance": 1.0 + 0.1 * n} for n in range(1, 4)]
        return {
            **case,
            "points": 10,
            "steps": 3,
            "cpu": {"without": 0.2, "with": 0.1},
            "divisions": [{"step": 0, "wall": 1.0, "cpu": 1.0}],
            "division_steps": 10.0,
            "pays_after_steps": 10.0,
            "whole": 0.8,
            "series": {"without": series, "with": series},
        }
    of, points = KNOWN[case["dim"]], int(np.prod(case["counts"])) * 2 ** case["dim"]
    more = 2 if case["kind"] == "weak" else 1
    runs = {name: run_of(of, points, 1) for name in ("1", "1, Jacobi")}
    runs["2"] = run_of(of, more * points, 2)
    ratio = runs["1"]["wall"] / runs["2"]["wall"]
    ratios = {"2": [ratio, 0.9 * ratio, 1.1 * ratio]}
    return {
        **case,
        "points": points,
        "runs": runs,
        "best": "1",
        "ratios": ratios,
        "ratios_jacobi": ratios,
    }


@pytest.mark.parametrize("dim", [2, 3])
def test_the_model_finds_the_constants_that_steps_were_made_of(dim):
    rows = [answer(case) for case in scaling.cases(False, [1, 2])]
    found = vars(scaling_model.constants(rows, dim))
    for name, value in vars(KNOWN[dim]).items():
        assert found[name] == pytest.approx(value, rel=1e-6), name
    assert scaling_model.bytes_a_point(rows, dim) == pytest.approx(2000)


def test_work_is_shared_edges_shrink_more_slowly_and_sums_grow():
    """By 8 times as many ranks: to an eighth, in 3D to a quarter, and by three levels of a tree."""
    of, network = KNOWN[3], {**scaling_model.CLUSTER, "latency_s": 0.0}
    few, many = (seconds(of, 1e9, n, network) for n in (128, 1024))
    own = [parts["own work"] - of.fixed - of.several for parts in (few, many)]
    assert own[0] / own[1] == pytest.approx(8.0)
    assert few["edges"] / many["edges"] == pytest.approx(4.0)
    assert many["sums"] / few["sums"] == pytest.approx(10 / 7)
    assert scaling_model.nodes_on_the_edge(2, 400) == 4 * 20


@pytest.mark.validation
def test_the_script_writes_rows_and_figure_and_goes_on_where_it_was(tmp_path, monkeypatch):
    done = []
    monkeypatch.setattr(scaling, "measure", lambda case: done.append(case) or answer(case))
    rows = scaling.main(["--quick", "--results", str(tmp_path)])
    assert len(done) == 8 and [row["kind"] for row in rows][-2:] == ["balance", "model"]
    assert (tmp_path / "scaling.png").stat().st_size > 10_000
    assert json.loads((tmp_path / "scaling.json").read_text()) == report.rounded(rows, 4)
    scaling.main(["--quick", "--results", str(tmp_path)])
    assert len(done) == 8
    scaling.main(["--quick", "--again", "--results", str(tmp_path)])
    assert len(done) == 16
    assert all(table.row_count for table in scaling_report.tables(rows))


@pytest.mark.parametrize("text", ["1", "1,4", "0,2"])
def test_ranks_without_two_are_refused(text, capsys):
    with pytest.raises(SystemExit):
        scaling.main(["--ranks", text])
    assert f"with 2 among them: {text}" in capsys.readouterr().err


@pytest.fixture(scope="module")
def two():
    """A block of 8 by 4 cells, and a row of empty ones, sliding on two ranks."""
    if mpiexec() is None:
        pytest.skip("no mpiexec beside Python or on PATH")
    run = scaling.Ranks(2, sharing=True, scene="block", dim=2, counts=[8, 4], sliding=True)
    yield run
    run.close()
    assert run.process.returncode == 0


@pytest.mark.ranks
def test_ranks_take_steps_and_count_what_they_send(two):
    assert two.ask("ready")
    taken = two.ask("steps", count=2)
    assert sum(taken["points"]) == 8 * 4 * 4 and taken["solves"] == 2
    assert 0.0 < sum(taken["pieces"].values()) and taken["pieces"]["migrate"] > 0.0
    assert taken["time"] == pytest.approx(2 * 0.0625 / soil.p_speed)
    volume = two.ask("volume", count=10)
    # one cut across five cells: six nodes, and points that slide over it, two a cell
    assert volume["boundary_nodes"] == 6 and volume["neighbours"] == 1
    assert volume["points"] > 0.0 and volume["fields"] > 0.0
    # each product with the matrix, one an iteration, sends two numbers a node of the cut, whose
    # nodes may belong to either rank, or of the lines beside it
    nodes = volume["solver"] / (2 * 8 * volume["iterations"])
    assert 0.9 * 6 <= nodes <= 2 * 6
    assert volume["solver_sums"] >= 2 * volume["iterations"]
    assert volume["other_sums"] >= 1
    assert two.ask("memory")["build"] > 0.0
    assert two.ask("divide")["cpu"] > 0.0


@pytest.mark.ranks
def test_ranks_that_stop_leave_their_words():
    if mpiexec() is None:
        pytest.skip("no mpiexec beside Python or on PATH")
    run = scaling.Ranks(1, scene="block", dim=2, counts=[-1, 4])
    with pytest.raises(RuntimeError, match=r"the ranks stopped[\s\S]*Error"):
        run.ask("ready")
    run.close()
