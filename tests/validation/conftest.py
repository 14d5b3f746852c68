"""Rows of case × mapping, gathered while the cases run; they travel with the reports, from xdist's
workers too."""

import dolfinx
import numpy as np
import pytest
import table


@pytest.fixture
def record(request):
    """``record(case, mapping, error, note="")``: one row, to be written before its bound is
    asserted.

    ``case`` begins with its number; ``error`` is relative where nothing else is said, or None where
    there is none; ``note`` is the reason where the mapping fails the case as it is claimed to (and
    the test asserts that it does).
    """

    def write(case, mapping, error, note=""):
        finite = error is not None and np.isfinite(error)
        row = {
            "case": case,
            "mapping": str(mapping or "FE"),
            "error": float(error) if finite else None,
            "result": "fails as stated" if note else "pass",
            "note": note,
            "dolfinx": dolfinx.__version__,
        }
        request.node.user_properties.append(("row", row))

    return write


class Rows:
    """What the tests have recorded, merged into the file at last."""

    def __init__(self):
        self.found = []

    def pytest_runtest_logreport(self, report):
        if report.when == "call":
            rows = [row for name, row in report.user_properties if name == "row"]
            self.found += [{**row, "result": "FAILED"} if report.failed else row for row in rows]

    def pytest_terminal_summary(self, terminalreporter, exitstatus, config):
        if self.found:
            table.merge(self.found, keep=not config.getoption("--afresh") or exitstatus != 0)
            terminalreporter.write_line(table.markdown(table.ordered(self.found)))


def pytest_addoption(parser):
    parser.addoption(
        "--afresh",
        action="store_true",
        help="when all have passed, drop the rows of earlier sessions",
    )


def pytest_configure(config):
    if not hasattr(config, "workerinput"):  # xdist's workers have summaries of their own
        config.pluginmanager.register(Rows(), "validation rows")
