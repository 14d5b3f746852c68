"""An installation that lacks what pip does not bring, and one where nothing can be written."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import mpm_fenicsx

PACKAGE = Path(mpm_fenicsx.__file__).parent


def python(program, **environment):
    """Run a program in another process that finds this package by its path alone."""
    no = "OMPI_", "PMIX_", "PMI_", "PRTE_", "NUMBA", "XDG"
    kept = {name: value for name, value in os.environ.items() if not name.startswith(no)}
    given = {**kept, "PYTHONPATH": str(PACKAGE.parent), **environment}
    return subprocess.run(
        [sys.executable, "-c", program],
        env=given,
        cwd=given["PYTHONPATH"],
        capture_output=True,
        text=True,
        timeout=300,
    )


@pytest.mark.parametrize("missing", ["mpi4py", "dolfinx", "petsc4py"])
def test_what_is_missing_is_said_with_how_to_install_it(missing):
    done = python(f"import sys; sys.modules[{missing!r}] = None\nimport mpm_fenicsx")
    assert done.returncode == 1
    last = done.stderr[done.stderr.rindex("ImportError") :]
    assert missing in last.splitlines()[0]
    for words in (
        'pip install "mpm_fenicsx[wheel]"',
        "conda install -c conda-forge fenics-dolfinx",
        "apt install",
    ):
        assert words in last


def test_a_run_takes_neither_matplotlib_nor_rich():
    done = python("""
import sys
sys.modules |= dict.fromkeys(("matplotlib", "rich"))  # an import of either fails
from mpm_fenicsx.scenes import column
run = column.material_points("viscous", load=300e3)
watch = column.Watch(run, "viscous", load=300e3)
run.until(2 * column.dt)
print(run.steps)
""")
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout.split()[-1] == "2"


@pytest.mark.parametrize("demo", ["column", "foundation"])
@pytest.mark.parametrize("missing", ["matplotlib", "rich"])
def test_a_demo_says_what_it_takes(demo, missing):
    file = PACKAGE.parent / "demos" / f"{demo}.py"
    done = python(
        f"import sys, runpy; sys.modules[{missing!r}] = None; runpy.run_path({str(file)!r})"
    )
    assert done.returncode == 1
    last = done.stderr[done.stderr.rindex("ImportError") :]
    assert missing in last and "pip install 'mpm_fenicsx[demo]'" in last


def test_a_user_without_a_home_can_start(tmp_path):
    """One whom the system does not know, as in a container, and HOME is not set."""
    cache = tmp_path / "cache"
    done = python(
        f"""
import os, pwd
def unknown(uid):
    raise KeyError(uid)
pwd.getpwuid = unknown
del os.environ["HOME"]
os.chdir({str(tmp_path)!r})
import mpm_fenicsx
print(os.environ["HOME"], os.environ["XDG_CACHE_HOME"])
""",
        XDG_CACHE_HOME=str(cache),
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert done.stdout.split() == ["/", str(cache)]
    assert [path.name for path in tmp_path.iterdir()] == ["cache"]


PROGRAM = """
import sys, warnings
warnings.simplefilter("ignore")
import numpy as np
from mpm_fenicsx import Grid, LinearElastic
from mpm_fenicsx.grid import cells
cell = np.zeros(1, np.int32)
bounds = np.zeros((1, 2)), np.ones((1, 2))
cells.walk(np.array([[0.5, 0.5]]), cell, *bounds, np.full((1, 2, 2), -1, np.int32))
assert cell[0] == 0
print("it walks", cells.walk.stats.cache_path)
"""


@pytest.mark.parametrize("caches", ["temporary", "nowhere"])
def test_a_place_where_nothing_can_be_written_is_no_hindrance(tmp_path, caches):
    """A file stands where __pycache__ would be, and the home is no folder: root cannot be kept out
    otherwise."""
    shutil.copytree(PACKAGE, tmp_path / "mpm_fenicsx", ignore=shutil.ignore_patterns("__pycache__"))
    for folder in {source.parent for source in (tmp_path / "mpm_fenicsx").rglob("*.py")}:
        (folder / "__pycache__").write_text("")
    room = tmp_path / "room"
    room.mkdir()
    program = PROGRAM
    if caches == "nowhere":  # not even for temporary files, as far as numba can see
        program = (
            "from numba.core import caching\ncaching.CacheImpl._locator_classes = []\n" + PROGRAM
        )
    done = python(
        program,
        PYTHONPATH=str(tmp_path),
        HOME="/proc/none",
        TMPDIR=str(room),
        PYTHONDONTWRITEBYTECODE="1",
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert "it walks " + (str(room) if caches == "temporary" else "None") in done.stdout


@pytest.mark.parametrize("target", ["demo", "foundation"])
def test_what_a_user_runs_first_leaves_the_results_that_pages_show(target):
    """``make demo`` wrote its own times over results/column.json, and ``make test`` then found that
    a page showed others."""
    home = PACKAGE.parent
    if not (home / "Makefile").exists():
        pytest.skip("the package is installed, without its Makefile")
    recipe = (home / "Makefile").read_text().split(f"\n{target}: ")[1].splitlines()[1]
    folder = recipe.split("--results ")[1].split()[0]
    ignored = (home / ".gitignore").read_text().splitlines()
    assert f"{Path(folder).parts[0]}/" in ignored
