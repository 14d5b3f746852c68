"""The comparison with a peer: it says when there is none, speaks its protocol, and gives it the
same scene."""

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import peers

from mpm_fenicsx import DM_GC, Probe

ECHO = """
import json, os, sys
answers = os.fdopen(int(sys.argv[1]), "w")
scene = json.loads(sys.stdin.readline())
print("words of its own")
print(json.dumps({"version": "1", "points": len(scene["x"])}), file=answers, flush=True)
for order in sys.stdin:
    if int(order) > 3:
        sys.exit("too many")
    n = int(order)
    answer = {"seconds": 0.5 * n, "iterations": 2 * n, "stress": [[-1.0, -3.0]] * n}
    print(json.dumps(answer), file=answers, flush=True)
"""


@pytest.fixture
def echo(tmp_path, monkeypatch):
    """A peer that answers what is known beforehand."""
    script = tmp_path / "echo.py"
    script.write_text(ECHO)
    monkeypatch.setattr(peers, "SCRIPT", script)
    return peers.Peer(sys.executable, {"x": [0, 1]}, np.array([0.25, 0.75]))


def test_a_peer_is_asked_and_answers(echo):
    assert echo.advance(3) + echo.advance(1) == 2.0
    assert (
        echo.pressure == pytest.approx(4 * [2.5]) and echo.iterations == 8 and echo.version == "1"
    )
    echo.close()
    assert echo.process.returncode == 0


def test_a_peer_that_stops_leaves_its_words(echo):
    with pytest.raises(RuntimeError, match=r"words of its own[\s\S]*too many"):
        echo.advance(4)
    echo.close()


def test_the_peer_is_told_the_same_scene():
    run = peers.column.material_points("fixed", 300e3, DM_GC, step=2.5e-3)
    probe, body = run.record(Probe("stress", (0.5, 10.0))), run.bodies[0]
    body.stress[:, 1] = 7.0 - 3.0 * body.x[:, 1]
    scene, weights = peers.told(run, {}, body.surface("top"), probe, np.zeros(3))
    assert np.array_equal(scene["x"], body.x) and np.array_equal(scene["half"], body.half)
    assert [len(line) for line in scene["lines"]] == [5, 85]
    assert np.diff(scene["lines"][1]) == pytest.approx(0.25)
    assert np.sum(scene["load_area"]) == pytest.approx(1.0)
    assert scene["rows"] == sorted(scene["rows"])
    assert weights @ body.stress[scene["rows"], 1] == pytest.approx(7.0 - 3.0 * 10.0)


def test_without_kratos_ours_run_alone(tmp_path, monkeypatch, capsys):
    column, block = peers.of_column, peers.of_block
    monkeypatch.setattr(peers, "of_column", lambda python, load: column(python, load, end=0.2))
    monkeypatch.setattr(peers, "of_block", lambda python: block(python, cell=0.5, steps=16))
    rows = peers.main(["--kratos-python", str(tmp_path / "none"), "--results", str(tmp_path)])
    assert peers.INSTALL in capsys.readouterr().out.splitlines()[0]
    assert json.loads((tmp_path / "peers.json").read_text()) == rows
    assert [row["method"] for row in rows] == 3 * ["DM-GC", "MPM", "FE"]
    for row in rows:
        assert row["seconds"] >= row["seconds_min"] > 0.0
    assert [row["over_dm_gc"] for row in rows[::3]] == [1.0, 1.0, 1.0]


@pytest.mark.skipif(
    "KRATOS_PYTHON" not in os.environ, reason="KRATOS_PYTHON names no Python with Kratos"
)
def test_kratos_runs_the_column():
    rows = {
        row["method"]: row for row in peers.of_column(os.environ["KRATOS_PYTHON"], 300.0, end=0.5)
    }
    for method in peers.PEERS:
        assert (
            rows[method]["error_pressure"] < 0.03
        )  # small strain: linear shape functions are as good as any
