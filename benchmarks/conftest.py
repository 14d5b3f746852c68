"""The 96 × 64 block of 24,576 points under a strip, a few steps after the load began."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import cost_scenes


def pytest_collection_modifyitems(items):
    """Everything here is a timing."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.benchmark)


@pytest.fixture(scope="session")
def block():
    """A run of any method, five steps old, one a method."""
    known = {}

    def run(method):
        if method not in known:
            known[method] = cost_scenes.scene(method, 2, 0.0625)
            for _ in range(5):
                known[method].step()
        return known[method]

    return run
