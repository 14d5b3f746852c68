"""Rows of case × mapping, gathered while the cases run."""

import dolfinx
import numpy as np
import pytest
import table

ROWS = pytest.StashKey[list]()
FAILED = pytest.StashKey[bool]()


@pytest.fixture
def record(request):
    """``record(case, mapping, error, note="")``: one row, to be written before its bound is asserted.

    ``case`` begins with its number; ``error`` is relative where nothing else is said, or None where there is none;
    ``note`` is the reason where the mapping fails the case as it is claimed to (and the test asserts that it does).
    """
    mine = []

    def write(case, mapping, error, note=""):
        finite = error is not None and np.isfinite(error)
        mine.append({"case": case, "mapping": str(mapping), "error": float(error) if finite else None,
                     "result": "fails as stated" if note else "pass", "note": note, "dolfinx": dolfinx.__version__})

    yield write
    if request.node.stash.get(FAILED, False):
        for row in mine:
            row["result"] = "FAILED"
    request.config.stash.setdefault(ROWS, []).extend(mine)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item):
    report = (yield).get_result()
    if report.when == "call":
        item.stash[FAILED] = report.failed


def pytest_terminal_summary(terminalreporter, config):
    if rows := config.stash.get(ROWS, []):
        table.merge(rows)
        terminalreporter.write_line(table.markdown(rows))
