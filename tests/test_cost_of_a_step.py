"""Clocks around a step: what they count adds up, and they do not touch what they time."""

import json
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import cost_of_a_step
import cost_pieces
import cost_report
import cost_scenes
import report
from cost_pieces import PIECES, POINTS, Bill, total


class Clock:
    """A clock that only work moves on."""

    def __init__(self):
        self.now = 0.0

    def work(self, seconds, *calls):
        """A method that takes ``seconds`` besides what it calls."""

        def method(*_):
            self.now += seconds
            for call in calls:
                call()

        return method


def a_run(clock):
    """A run whose pieces take 1, 2, 4, … seconds; the recovery is called inside carry, the solver
    inside solve."""
    stencil = SimpleNamespace(gradient_at_points=clock.work(1))
    scene, e = SimpleNamespace(prepare=clock.work(2)), SimpleNamespace()
    run = SimpleNamespace(
        bodies=[1],
        stencils=[stencil],
        composites=[],
        correction=None,
        scene=scene,
        equilibrium=e,
    )
    e.assemble_tangent, e.correct = clock.work(4), clock.work(8)
    e.solve = clock.work(16, lambda: e.assemble_tangent(), lambda: e.correct())
    run.locate, run.project, run.predict = clock.work(32), clock.work(64), clock.work(128)
    run.solve = clock.work(256, lambda: e.solve())
    run.carry = clock.work(512, lambda: stencil.gradient_at_points())
    run.finish = clock.work(1024)
    verbs = ("locate", "project", "predict", "solve", "carry", "finish")
    run.step = clock.work(
        2048, lambda: scene.prepare(), *(lambda v=v: getattr(run, v)() for v in verbs)
    )
    return run


def test_each_piece_is_counted_without_the_pieces_inside_it(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(time, "perf_counter", lambda: clock.now)
    found = Bill(a_run(clock)).block(3)
    assert found == {
        "recover": 1,
        "load": 2,
        "assemble": 4,
        "solve": 8,
        "force": 16 + 256,
        "locate": 32,
        "project": 64,
        "predict": 128,
        "correct": 0,
        "carry": 512,
        "record": 1024,
        "other": 2048,
        "factor": 0,
    }
    assert total(found) == clock.now / 3


@pytest.mark.parametrize("method", cost_scenes.METHODS)
def test_a_real_bill_is_whole_and_changes_nothing(method):
    plain, watched = (cost_scenes.scene(method, 2, 0.5) for _ in range(2))
    accounts = Bill(watched)
    accounts.block(2)
    began = time.perf_counter()
    pieces = accounts.block(2)
    spent = time.perf_counter() - began
    for _ in range(4):
        plain.step()
    assert plain.steps == watched.steps == 4
    assert np.array_equal(plain.nodal("increment").ravel(), watched.nodal("increment").ravel())
    assert 2 * total(pieces) <= spent
    absent = {"assemble", "factor"} if method == "FE, frozen" else set()
    if not watched.bodies:
        absent |= {"locate", "project", "predict", "recover", "correct"}
    elif watched.correction is None:
        absent |= {"correct"}
    for piece in set(PIECES) - absent:
        assert pieces[piece] > 0.0, piece
    assert all(pieces[piece] == 0.0 for piece in absent - {"factor"})


def test_the_points_share_and_the_growth_of_time_and_memory():
    pieces = dict.fromkeys(PIECES, 1.0)
    assert cost_report.share({"pieces": pieces, "seconds": total(pieces)}) == pytest.approx(
        len(POINTS) / len(PIECES)
    )
    rows = [
        {"points": n, "seconds": 2e-6 * n**1.3, "bytes": 10**8 + 700 * n}
        for n in (1000, 4000, 16000)
    ]
    assert cost_report.exponent(rows) == pytest.approx(1.3)
    assert cost_report.exponent(rows, least=10_000) is None
    assert cost_report.growth(rows) == pytest.approx(700)


def test_the_middle_block_is_one_of_the_blocks():
    blocks = [{"a": float(n), "b": 10.0 - 3 * n} for n in range(4)]
    assert cost_pieces.middle(blocks) == blocks[2]  # totals 10, 8, 6, 4


def test_memory_is_counted_from_the_last_mark():
    cost_pieces.resident()
    np.ones(40_000_000)
    before = cost_pieces.resident()
    assert cost_pieces.peak() - before < 5e6
    np.ones(10_000_000)
    assert cost_pieces.peak() - before == pytest.approx(8e7, rel=0.1)


@pytest.mark.validation
def test_the_script_writes_rows_and_figure_and_goes_on_where_it_was(tmp_path, monkeypatch):
    monkeypatch.setattr(cost_of_a_step, "CELLS", {2: (0.5, 0.25), 3: (0.5,)})
    monkeypatch.setattr(cost_of_a_step, "METHODS", ("DM-GC", "FE", "FE, frozen"))
    monkeypatch.setattr(cost_of_a_step, "blocks_at", lambda points: 1)
    monkeypatch.setattr(cost_of_a_step, "TWINS", ("FE",))
    monkeypatch.setattr(cost_of_a_step, "MAPPINGS", ("DM-GC",))
    done = []
    monkeypatch.setattr(
        cost_of_a_step,
        "in_its_own_process",
        lambda case: done.append(case) or cost_of_a_step.measure(case),
    )
    monkeypatch.setattr(
        cost_of_a_step, "start", lambda *_: {"points": 1280, "first": None, "seconds": 1.0}
    )
    monkeypatch.setattr(cost_report, "targets", lambda rows: iter([("step / FE", 1.0, 2.0)]))
    rows = cost_of_a_step.main(["--quick", "--results", str(tmp_path)])
    assert [row["kind"] for row in rows] == ["start", "start", "empty", "ratio"] + 6 * ["bill"]
    assert (tmp_path / "cost_of_a_step.png").stat().st_size > 10_000
    kept = json.loads((tmp_path / "cost_of_a_step.json").read_text())
    assert kept == report.rounded(rows, 4, cost_of_a_step.KEYS) and not any(
        "failed" in row for row in kept
    )
    done.clear()
    cost_of_a_step.main(["--quick", "--results", str(tmp_path)])
    assert not done


def test_a_case_that_fails_says_so_and_is_tried_again():
    case = {"kind": "bill", "method": "DM-X", "dim": 2, "cell_m": 0.5}
    row = cost_of_a_step.in_its_own_process(case)
    assert "DM-X" in row["failed"]
