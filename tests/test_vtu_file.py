"""VTU files hold their arrays bit for bit: VTK itself is the judge where it is there, and meshio
everywhere."""

import meshio
import numpy as np
import pytest
from test_output import fe, mpm
from vtu_readers import ByMeshio, ByVTK

from mpm_fenicsx.common import tensors
from mpm_fenicsx.output.vtk import Snapshots
from mpm_fenicsx.output.vtu_file import HEXAHEDRON, QUAD, VERTEX, write

CORNERS = {VERTEX: 1, QUAD: 4, HEXAHEDRON: 8}
READERS = pytest.mark.parametrize("read", (ByVTK, ByMeshio))


def same_bits(found, values):
    """Whether both are the same numbers, of the same type, to the last bit."""
    native = values.astype(values.dtype.newbyteorder("="), copy=False)
    found = np.asarray(found)
    assert found.dtype.newbyteorder("=") == native.dtype, (found.dtype, native.dtype)
    return found.shape == native.shape and found.astype(native.dtype).tobytes() == native.tobytes()


def wide(values, width):
    """Rows with zeros up to ``width``."""
    return np.pad(values, ((0, 0), (0, width - values.shape[1])))


@READERS
@pytest.mark.parametrize("cell_type", CORNERS)
def test_numbers_of_all_types_come_back_bit_for_bit(read, cell_type, tmp_path):
    rng = np.random.default_rng(2)
    n, m = 11, 5
    odd = np.array([np.nan, np.inf, -np.inf, -0.0, 5e-324, 0.1, 1e308, -1.0, 2.0, 1 / 3, np.pi])
    x = rng.normal(size=(n, 3))
    cells = rng.permuted(np.tile(np.arange(n), (m, 1)), axis=1)[:, : CORNERS[cell_type]]
    points = {
        "odd": odd,
        'σ & "q" <yy>': rng.normal(size=(n, 6)),
        "short": rng.normal(size=n).astype(np.float32),
        "apart": rng.normal(size=(3, 2 * n)).T[::2],
        "other order": odd.astype(">f8"),
        "number": rng.integers(-(2**62), 2**62, n),
        "body": np.arange(n, dtype=np.int32),
        "small": np.arange(n, dtype=np.uint8),
    }
    in_cells = {"stress": rng.normal(size=(m, 4)), "material": np.arange(m, dtype=np.int32)}
    write(tmp_path / "a.vtu", x, cells, cell_type, points, in_cells)
    found = read(tmp_path / "a.vtu")
    assert same_bits(found.x, x) and found.types == {cell_type}
    assert np.array_equal(found.cells, cells)
    assert list(found.point_data) == list(points) and list(found.cell_data) == list(in_cells)
    for name, values in points.items():
        assert same_bits(found.point_data[name], values), name
    for name, values in in_cells.items():
        assert same_bits(found.cell_data[name], values), name


@READERS
@pytest.mark.parametrize("dim", (2, 3))
def test_all_fields_of_the_points_come_back_bit_for_bit(read, dim, tmp_path):
    run = mpm(dim)
    run.record(Snapshots(tmp_path / "block"))
    run.until(2e-3)
    body, found = run.bodies[0], read(tmp_path / "block_points_000002.vtu")
    exact = {
        "half": wide(body.half, 3),
        "volume": body.volume,
        "stress": wide(body.stress, 6),
        "velocity": wide(body.velocity, 3),
        "seat": wide(body.seat, 3),
        "mean_stress": tensors.mean(body.stress),
        "von_mises": tensors.von_mises(body.stress),
        "density": body.mass / body.volume,
        "body": np.zeros(len(body), np.int32),
    }
    assert found.types == {VERTEX} and same_bits(found.x, wide(body.x, 3))
    assert set(found.point_data) == set(exact) and not found.cell_data
    for name, values in exact.items():
        assert same_bits(found.point_data[name], values), name


@READERS
@pytest.mark.parametrize("make", (mpm, fe))
@pytest.mark.parametrize("dim", (2, 3))
def test_all_fields_of_the_grid_come_back_bit_for_bit(read, make, dim, tmp_path):
    run = make(dim)
    run.record(Snapshots(tmp_path / "block"))
    run.until(2e-3)
    found = read(tmp_path / "block_grid_000002.vtu")
    nodal, cellwise = run.grid_fields()
    nodal = {name: wide(values, 3) for name, values in nodal.items()}
    cellwise = {name: wide(values, 6) for name, values in cellwise.items()}
    assert found.types == {{2: QUAD, 3: HEXAHEDRON}[dim]}
    x = run.grid.space.tabulate_dof_coordinates()
    assert same_bits(found.x, wide(x[:, :dim], 3)) and len(found.cells) == run.grid.cells
    assert set(found.point_data) == set(nodal) and set(found.cell_data) == set(cellwise)
    assert bool(cellwise) == (make is fe)
    for name, values in nodal.items():
        assert same_bits(found.point_data[name], values) and values.any(), name
    for name, values in cellwise.items():
        assert same_bits(found.cell_data[name], values) and values.any(), name


@READERS
def test_arrays_of_any_length_are_told_apart(read, tmp_path):
    """Whatever their places in the file: meshio mixes up arrays that are in order."""
    for n in range(1, 30):
        x = np.arange(3.0 * n).reshape(n, 3)
        fields = {name: np.full((n, k), k + 0.5) for k, name in enumerate("abcdef", 1)}
        write(tmp_path / "a.vtu", x, np.arange(n)[:, None], VERTEX, fields, {})
        found = read(tmp_path / "a.vtu")
        for k, (name, values) in enumerate(fields.items()):
            assert same_bits(found.point_data[name].reshape(n, k + 1), values), (n, name)


def test_what_is_no_real_number_is_refused(tmp_path):
    x, cells = np.zeros((2, 3)), np.arange(2)[:, None]
    for values in (np.zeros(2, complex), np.zeros(2, np.longdouble), np.array(["a", "b"])):
        with pytest.raises(ValueError, match=f"speed must be real numbers.*{values.dtype}"):
            write(tmp_path / "a.vtu", x, cells, VERTEX, {"speed": values}, {})
    assert not list(tmp_path.iterdir())


def test_flags_and_half_precision_are_written_as_the_nearest_type_of_vtk(tmp_path):
    x, cells = np.zeros((2, 3)), np.arange(2)[:, None]
    fields = {"flag": np.array([True, False]), "half": np.array([0.1, 2.0], np.float16)}
    write(tmp_path / "a.vtu", x, cells, VERTEX, fields, {})
    found = meshio.read(tmp_path / "a.vtu").point_data
    assert same_bits(found["flag"], np.array([1, 0], np.int8))
    assert same_bits(found["half"], fields["half"].astype(np.float32))
