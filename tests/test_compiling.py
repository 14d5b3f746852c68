"""A process that is killed while it compiles leaves a source that FFCx waits for in vain; loops
that are kept are those of their files as they are."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx import fem

import mpm_fenicsx
from mpm_fenicsx import Grid
from mpm_fenicsx.grid import dolfinx_versions, form_compiler


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache that FFCx waits for one second."""
    monkeypatch.setitem(dolfinx_versions._JIT, "cache_dir", str(tmp_path))
    monkeypatch.setitem(dolfinx_versions._JIT, "timeout", 1)
    return tmp_path


def area(scale):
    grid = Grid.rectilinear([np.array([0.0, 2.0]), np.array([0.0, 1.0])])
    form = fem.Constant(grid.mesh, scale) * grid.dx(metadata={"quadrature_degree": 2})
    return lambda: dolfinx_versions.assemble_scalar(dolfinx_versions.compile_form(form))


def half_made(cache, age):
    """Make all that is compiled in the cache what it is while another process compiles it, since
    ``age`` seconds."""
    sources = [file for file in cache.iterdir() if file.name.endswith(".c")]
    for file in cache.iterdir():
        if file not in sources:
            file.unlink()
    for source in sources:
        os.utime(source, (time.time() - age,) * 2)
    return sources


def test_what_a_killed_process_left_is_compiled_anew(cache):
    integral = area(3.0)
    assert integral() == pytest.approx(6.0, rel=1e-14)
    assert len(half_made(cache, 2 * form_compiler.ABANDONED)) == 1
    assert integral() == pytest.approx(6.0, rel=1e-14)


def test_what_another_process_compiles_is_waited_for(cache):
    integral = area(3.0)
    integral()
    (source,) = half_made(cache, 0.0)
    taken = []

    def give_up():
        time.sleep(2.5)
        taken.append(source.stat().st_mtime)
        os.utime(source, (1.0, 1.0))

    other = threading.Thread(target=give_up)
    other.start()
    assert integral() == pytest.approx(6.0, rel=1e-14)
    other.join()
    assert source.stat().st_mtime > taken[0] > 1.0


def test_an_error_of_the_compiler_is_told(cache, monkeypatch):
    monkeypatch.setitem(dolfinx_versions._JIT, "cffi_extra_compile_args", ["--no-such-option"])
    with pytest.raises(Exception, match=r"gcc|CompileError|VerificationError|failed"):
        area(3.0)()


def test_without_a_compiler_it_says_what_to_install(cache, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(RuntimeError, match=r"no-such-compiler.*CC.*apt install gcc"):
        area(3.0)()


def test_any_other_error_is_not_tried_again():
    calls = []

    def make():
        calls.append(1)
        raise RuntimeError("JIT compilation failed on rank 0.")

    with pytest.raises(RuntimeError, match="rank 0"):
        form_compiler.build(MPI.COMM_WORLD, make)
    assert calls == [1]


PIECE = "from mpm_fenicsx.common.compiled import jit\n\n@jit\ndef piece(x):\n    return x + {}\n"
LOOP = """
from mpm_fenicsx.common.compiled import jit
from piece import piece

@jit
def loop(x):
    return 2.0 * piece(x)

print(loop(1.0))
"""


@pytest.mark.validation
def test_a_loop_is_compiled_anew_when_a_piece_of_it_in_another_file_has_changed(tmp_path):
    """Numba looks at the loop's own file alone."""
    (tmp_path / "loop.py").write_text(LOOP)
    places = os.pathsep.join([str(tmp_path), str(Path(mpm_fenicsx.__file__).parents[1])])
    found = []
    for number, more in enumerate((1.0, 10.0, 10.0)):
        (tmp_path / "piece.py").write_text(PIECE.format(more))
        os.utime(tmp_path / "piece.py", (1e9 + min(number, 1),) * 2)
        done = subprocess.run(
            [sys.executable, "-B", str(tmp_path / "loop.py")],
            env={**os.environ, "PYTHONPATH": places},
            capture_output=True,
            text=True,
            check=True,
        )
        found.append(float(done.stdout))
    assert found == [4.0, 22.0, 22.0]
