"""Files for ParaView: what is read back is what the run holds, whatever happens to the run."""

import shutil
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

from mpi4py import MPI

import meshio
import numpy as np
import pytest
from dolfinx import mesh as dmesh
from test_ranks import on_ranks
from vtu_readers import VERTEX, ByMeshio, ByVTK, pieces

from mpm_fenicsx import (
    FiniteElements,
    Fixed,
    Gravity,
    Grid,
    LinearElastic,
    MaterialPoints,
    Newmark,
    Newton,
    QuasiStatic,
    RunError,
    Simulation,
    Solver,
    Traction,
    VonMises,
)
from mpm_fenicsx.common import tensors
from mpm_fenicsx.output import vtk
from mpm_fenicsx.output.vtk import Snapshots
from mpm_fenicsx.output.vtu_file import write
from mpm_fenicsx.points.location import numbers_of

SOIL = LinearElastic(20e6, 0.25, 1500.0)
CELL = {2: "quad", 3: "hexahedron"}
DOWN = {2: (0.0, -10.0), 3: (0.0, -10.0, 0.0)}


def box(dim):
    return Grid.box((0.0,) * dim, (1.0, 2.0, 1.0)[:dim], (2, 4, 2)[:dim])


def mpm(dim=2, stepping=None, grid=None):
    """A block of strewn points at rest in the lower half of a box, about to fall."""
    grid = grid or box(dim)
    points = MaterialPoints.fill(
        grid, SOIL, 2**dim, inside=lambda x: x[1] < 1.0, jitter=0.3, seed=3
    )
    rng = np.random.default_rng(8)
    points.stress = rng.normal(size=points.stress.shape) * 100.0
    return Simulation(
        grid,
        points,
        stepping or Newmark(1e-3),
        [Fixed(grid.facets("bottom"), "y"), Gravity(DOWN[dim])],
    )


def fe(dim=2, stepping=None, grid=None):
    """A box under its weight and a push on top."""
    grid = grid or box(dim)
    push = Traction(grid.facets("top"), lambda t: DOWN[dim])
    return FiniteElements(
        grid,
        SOIL,
        stepping or Newmark(1e-3),
        [Fixed(grid.facets("bottom"), "y"), Gravity(DOWN[dim]), push],
    )


def collection(path):
    """Times and files that a collection names; every one of the files exists and is read."""
    root = ET.parse(path).getroot()
    assert root.tag == "VTKFile" and root.get("type") == "Collection"
    sets = root.findall("Collection/DataSet")
    files = [path.parent / entry.get("file") for entry in sets]
    for file in files:
        ByMeshio(file)
    return [float(entry.get("timestep")) for entry in sets], [file.name for file in files]


def series(path, kind):
    return collection(path.with_name(f"{path.name}_{kind}.pvd"))


def volume(mesh, dim):
    """Signed volumes of quads or hexahedra of parallel sides, as VTK numbers their corners."""
    corner = mesh.points[mesh.cells_dict[CELL[dim]]][..., :dim]
    return np.linalg.det(corner[:, [1, 3, 4][:dim]] - corner[:, :1])


@pytest.mark.parametrize("dim", (2, 3))
def test_points_are_read_back_bit_for_bit(dim, tmp_path):
    run = mpm(dim)
    run.record(Snapshots(tmp_path / "block"))
    run.until(2e-3)
    body, read = run.bodies[0], meshio.read(tmp_path / "block_points_000002.vtu")
    data = read.point_data
    assert np.array_equal(read.points[:, :dim], body.x) and not read.points[:, dim:].any()
    assert np.array_equal(read.cells_dict["vertex"].ravel(), np.arange(len(body)))
    count = tensors.components(dim)
    assert data["stress"].shape == (len(body), 6) and data["velocity"].shape == (len(body), 3)
    assert (
        np.array_equal(data["stress"][:, :count], body.stress)
        and not data["stress"][:, count:].any()
    )
    assert (
        np.array_equal(data["velocity"][:, :dim], body.velocity) and np.abs(body.velocity).max() > 0
    )
    assert np.array_equal(data["half"][:, :dim], body.half)
    assert np.array_equal(data["mean_stress"], tensors.mean(body.stress))
    assert np.array_equal(data["von_mises"], tensors.von_mises(body.stress))
    assert np.array_equal(data["volume"], body.volume)
    assert np.array_equal(data["density"], body.mass / body.volume)
    assert not data["body"].any()


@pytest.mark.parametrize("dim", (2, 3))
def test_grid_keeps_its_place_and_carries_the_end_of_the_step(dim, tmp_path):
    run = mpm(dim)
    run.record(Snapshots(tmp_path / "block"))
    run.step()
    read = meshio.read(tmp_path / "block_grid_000001.vtu")
    assert np.array_equal(read.points[:, :dim], run.grid.space.tabulate_dof_coordinates()[:, :dim])
    np.testing.assert_allclose(volume(read, dim), 0.5**dim, rtol=1e-12)
    assert len(read.cells_dict[CELL[dim]]) == 4 * 2 ** (dim - 1)
    increment, velocity = run.nodal("increment"), run.end_of_step()[0]
    assert np.array_equal(read.point_data["displacement_increment"][:, :dim], increment)
    assert np.array_equal(read.point_data["velocity"][:, :dim], velocity)
    assert np.abs(velocity).max() > 0


def test_what_a_scene_has_not_is_not_written(tmp_path):
    run = mpm(stepping=QuasiStatic(2))
    run.record(Snapshots(tmp_path / "block"))
    assert "velocity" not in meshio.read(tmp_path / "block_points_000000.vtu").point_data
    assert set(meshio.read(tmp_path / "block_grid_000000.vtu").point_data) == {
        "displacement_increment"
    }
    fe().record(Snapshots(tmp_path / "twin"))
    assert sorted(p.name for p in tmp_path.glob("twin*")) == [
        "twin_grid.pvd",
        "twin_grid_000000.vtu",
    ]


def test_every_step_that_counts_has_its_time(tmp_path):
    run = mpm(stepping=Newmark(0.1 / 3))
    run.record(Snapshots(str(tmp_path / "new" / "folder" / "a & b"), every=3))
    run.until(7 * 0.1 / 3)
    for kind in ("points", "grid"):
        times, names = series(tmp_path / "new" / "folder" / "a & b", kind)
        assert times == [n * (0.1 / 3) for n in (0, 3, 6)]
        assert names == [f"a & b_{kind}_{n:06d}.vtu" for n in (0, 3, 6)]
    assert len(list((tmp_path / "new" / "folder").iterdir())) == 8


def test_attached_late_it_starts_there(tmp_path):
    run = mpm()
    run.step()
    run.record(Snapshots(tmp_path / "late", every=2))
    run.until(4e-3)
    assert series(tmp_path / "late", "points") == (
        [1e-3, 2e-3, 4e-3],
        [f"late_points_00000{n}.vtu" for n in (1, 2, 4)],
    )


def test_bodies_are_numbered_and_history_is_named(tmp_path):
    grid = box(2)
    lower, upper = (
        MaterialPoints.fill(grid, SOIL, 4, inside=inside)
        for inside in (lambda x: x[1] < 1.0, lambda x: x[1] > 1.5)
    )
    n, m = len(lower), len(upper)
    lower.plastic = np.arange(n, dtype=float)
    lower.yielded = np.arange(n) % 2 == 0
    lower.history = np.empty((n, 0))
    run = Simulation(
        grid,
        [lower, upper],
        QuasiStatic(1),
        [Fixed(grid.facets("bottom"), "y"), Fixed(grid.facets("left"), "x")],
    )
    run.record(Snapshots(tmp_path / "two"))
    data = meshio.read(tmp_path / "two_points_000000.vtu").point_data
    assert np.array_equal(data["body"], np.repeat([0, 1], [n, m]))
    assert (
        np.array_equal(data["plastic"][:n], lower.plastic) and np.isnan(data["plastic"][n:]).all()
    )
    assert np.array_equal(data["yielded"][:n], lower.yielded)
    assert "history" not in data

    class Softening(LinearElastic):
        history = ("plastic_strain", "damage")

    lower.material, lower.history = Softening(20e6, 0.25, 1500.0), np.arange(2.0 * n).reshape(n, 2)
    run.record(Snapshots(tmp_path / "named"))
    data = meshio.read(tmp_path / "named_points_000000.vtu").point_data
    assert np.array_equal(data["plastic_strain"][:n], lower.history[:, 0])
    assert np.array_equal(data["damage"][:n], lower.history[:, 1])
    assert "history" not in data


@pytest.mark.parametrize("dim", (2, 3))
def test_finite_elements_show_total_displacement_velocity_and_stress(dim, tmp_path):
    run = fe(dim)
    run.record(Snapshots(tmp_path / "twin"))
    run.until(3e-3)
    read = meshio.read(tmp_path / "twin_grid_000003.vtu")
    for name in ("displacement", "velocity"):
        assert np.array_equal(read.point_data[name][:, :dim], run.nodal(name))
    assert np.array_equal(
        read.cell_data["stress"][0][:, : tensors.components(dim)],
        run.stress(np.arange(run.grid.owned_cells)),
    )
    assert np.abs(read.cell_data["stress"][0]).max() > 0


@pytest.mark.parametrize("dim", (2, 3))
def test_stress_of_a_linear_displacement_is_exact_on_slanted_cells(dim, tmp_path):
    """On mirrored cells that are no rectangles: u = G x has stress λ tr ε 1 + 2μ ε everywhere
    (round-off)."""
    make, kind = {
        2: (dmesh.create_rectangle, dmesh.CellType.quadrilateral),
        3: (dmesh.create_box, dmesh.CellType.hexahedron),
    }[dim]
    mesh = make(MPI.COMM_WORLD, [np.zeros(dim), np.ones(dim)], [3, 4, 2][:dim], kind)
    x, y = mesh.geometry.x[:, 0].copy(), mesh.geometry.x[:, 1].copy()
    mesh.geometry.x[:, 0] = -x - 0.2 * y * x - 0.1 * y
    mesh.geometry.x[:, 1] = y + 0.15 * x * y
    grid = Grid(mesh)
    run = FiniteElements(grid, SOIL, QuasiStatic(1), [Fixed(grid.facets("bottom"))])
    gradient = np.random.default_rng(4).uniform(-1e-3, 1e-3, (dim, dim))
    place = grid.space.tabulate_dof_coordinates()[:, :dim]
    run.nodal("displacement")[:] = place @ gradient.T
    run.record(Snapshots(tmp_path / "slanted"))
    read = meshio.read(tmp_path / "slanted_grid_000000.vtu")
    λ, μ = SOIL.lame
    σ = np.zeros((3, 3))
    σ[:dim, :dim] = μ * (gradient + gradient.T)
    σ += λ * np.trace(gradient) * np.eye(3)
    exact = σ[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
    np.testing.assert_allclose(
        read.cell_data["stress"][0], np.tile(exact, (12 * (dim - 1), 1)), atol=1e-13 * 20e6
    )
    assert (volume(read, dim) > 0).all()


def test_a_run_that_fails_leaves_a_series_that_opens(tmp_path):
    run = mpm()
    run.record(Snapshots(tmp_path / "block"))
    run.until(2e-3)
    run.bodies[0].x[0] = 99.0
    with pytest.raises(RunError, match="step 3"):
        run.step()
    for kind in ("points", "grid"):
        assert series(tmp_path / "block", kind)[0] == [0.0, 1e-3, 2e-3]


def test_the_series_opens_after_every_step(tmp_path):
    run = mpm()
    run.record(Snapshots(tmp_path / "block"))
    for n in range(1, 5):
        run.step()
        for kind in ("points", "grid"):
            assert len(series(tmp_path / "block", kind)[0]) == n + 1


def test_a_reader_in_the_middle_of_a_collection_is_not_disturbed(tmp_path):
    """Files are replaced as a whole: who has one open goes on reading the old one."""
    run = mpm()
    run.record(Snapshots(tmp_path / "block"))
    before = (tmp_path / "block_points.pvd").read_text()
    with open(tmp_path / "block_points.pvd") as reader:
        run.step()
        assert reader.read() == before != (tmp_path / "block_points.pvd").read_text()


def unchanged_by(failing_step, folder):
    before = {p: p.read_bytes() for p in folder.iterdir()}
    failing_step()
    assert {p: p.read_bytes() for p in folder.iterdir()} == before


def test_a_write_error_names_path_and_step_and_spoils_nothing(tmp_path, monkeypatch):
    run = mpm()
    run.record(Snapshots(tmp_path / "block"))
    run.step()

    def half(path, *_, **__):
        Path(path).write_bytes(b"<VTKFile")
        raise OSError(28, "No space left on device")

    def step():
        with pytest.raises(OSError, match=r"step 2, t = 0.002: .*No space left") as failure:
            run.step()
        assert failure.value.errno == 28 and failure.value.filename == str(tmp_path / "block")

    with monkeypatch.context() as patch:
        patch.setattr(vtk, "write", half)
        unchanged_by(step, tmp_path)
    run.step()
    assert series(tmp_path / "block", "points")[0] == [0.0, 1e-3, 3e-3]


def test_a_file_that_hits_the_limit_of_the_system_spoils_nothing(tmp_path):
    resource = pytest.importorskip("resource")
    run = mpm()
    run.record(Snapshots(tmp_path / "block"))
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)

    def step():
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limit[1]))
        try:
            with pytest.raises(OSError, match="step 1"):
                run.step()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limit)

    unchanged_by(step, tmp_path)


@pytest.mark.parametrize("every", (0, -1, 1.5, "often", float("nan")))
def test_every_below_one_is_refused(every, tmp_path):
    with pytest.raises(ValueError, match=r"every .*" + str(every)):
        Snapshots(tmp_path / "block", every=every)


@pytest.mark.parametrize("path", ("", ".", "..", "results/"))
def test_a_path_without_a_name_is_refused(path):
    with pytest.raises(ValueError, match="path .*" + path):
        Snapshots(path)


def test_a_path_that_cannot_be_written_is_refused_at_once(tmp_path):
    (tmp_path / "file").write_text("")
    run = mpm()
    for path in (tmp_path / "file" / "block", tmp_path / ("x" * 300)):
        with pytest.raises(OSError, match=path.name):
            run.record(Snapshots(path))
    assert not run.recorders and sorted(p.name for p in tmp_path.iterdir()) == ["file"]


def test_snapshots_serve_one_run(tmp_path):
    shots = mpm().record(Snapshots(tmp_path / "block"))
    with pytest.raises(ValueError, match="block"):
        mpm().record(shots)


def rising(dim):
    """Two bodies that leave the lower half, all cells of the first rank, with what users give
    them; and the points' numbers."""
    grid = box(dim)
    bodies = [
        MaterialPoints.fill(grid, law, 2**dim, lambda x, a=a: (x[1] < 1.0) & (abs(x[0] - a) < 0.25))
        for law, a in ((SOIL, 0.25), (VonMises(SOIL, 2e3, 1e3, 1e4), 0.75))
    ]
    for body in bodies:
        body.velocity = np.zeros_like(body.x)
        body.velocity[:, 1] = 150.0 + 2.0 * body.x[:, 0] - 3.0 * body.x[:, 1]
        body.right = body.x[:, 0] > 0.4
    bodies[0].start = bodies[0].x.copy()
    numbers = [numbers_of(grid, body.x, grid.find(body.x)) for body in bodies]
    solver = Solver(newton=Newton(tolerance=1e-12), petsc={"ksp_rtol": 1e-13})
    return Simulation(grid, bodies, Newmark(1e-3), [Gravity(DOWN[dim])], solver=solver), numbers


def record(run, path):
    """Four steps, every second of which is written."""
    shots = run.record(Snapshots(path, grid_stress=True, every=2))
    run.until(4e-3)
    return shots


def record_all(folder):
    """What ranks do: runs of points and of finite elements, at the end of which the last rank
    cannot write; the points' numbers in the order of one rank."""
    folder, comm, numbers = Path(folder), MPI.COMM_WORLD, {}
    for dim in (2, 3):
        points, numbers[dim] = rising(dim)
        for name, run in (("mpm", points), ("fe", fe(dim))):
            shots = record(run, folder / f"{name}{dim}")
    states = comm.gather({name: value.tobytes() for name, value in shots.state().items()})
    assert states is None or all(state == states[0] for state in states)
    run, _ = rising(2)
    shots = run.record(Snapshots(folder / "fails"))
    if comm.rank == comm.size - 1:
        vtk.write = no_space
    try:
        run.step()
    except OSError as error:
        assert error.errno == 28 and "step 1" in str(error)
        assert error.filename == str(folder / "fails")
        print("refused", flush=True)
    finally:
        vtk.write = write
    run.step()
    if comm.rank == comm.size - 1:
        np.savez(folder / "state.npz", **shots.state())
    return numbers


def no_space(*_, **__):
    raise OSError(28, "No space left on device")


def regular(grid):
    """Points at places that do not depend on the number of ranks."""
    points = MaterialPoints.fill(grid, SOIL, 2**grid.dim, inside=lambda x: x[1] < 1.0)
    return Simulation(
        grid, points, Newmark(1e-3), [Fixed(grid.facets("bottom"), "y"), Gravity(DOWN[grid.dim])]
    )


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Folder of one rank, and the numbers that its points have on several."""
    folder = tmp_path_factory.mktemp("alone")
    return folder, record_all(folder)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Folder of two ranks, which must both see the error of the second."""
    folder = tmp_path_factory.mktemp("written")
    assert on_ranks(2, __file__, folder).count("refused") == 2
    return folder


def assert_close(found, expected, name):
    """To 1e-9 of the largest value; types, too."""
    assert found.dtype.newbyteorder("=") == expected.dtype.newbyteorder("="), name
    size = np.nanmax(np.abs(expected.astype(float)), initial=0.0)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * size, err_msg=name)


def same_points(read, dim, one, numbers, several):
    """The points of several ranks are those of one: bit for bit before the first step.  Returns how
    many each rank had at first and at the end."""
    numbers, owners = np.concatenate(numbers), []
    for step in (0, 2, 4):
        name = f"mpm{dim}_points_{step:06d}"
        expected, found = read(one / f"{name}.vtu"), read(several / f"{name}.pvtu")
        number = found.point_data.pop("number")
        assert number.dtype == np.int64 and found.types == {VERTEX}
        assert list(found.point_data) == list(expected.point_data)
        row = np.lexsort((number, found.point_data["body"]))
        row_of_one = np.lexsort((numbers, expected.point_data["body"]))
        assert np.array_equal(number[row], numbers[row_of_one])
        assert sorted(found.cells.ravel()) == list(range(len(number)))
        for key, value in {"x": expected.x, **expected.point_data}.items():
            other = {"x": found.x, **found.point_data}[key]
            assert_close(other[row], value[row_of_one], f"{name} {key}")
            if step == 0:
                assert np.array_equal(other[row], value[row_of_one], equal_nan=True), key
        parts = files(several, name)
        owners.append({piece.stem[-4:]: len(meshio.read(piece).points) for piece in parts})
    return owners[0], owners[-1]


def same_cells(read, run, kind, one, several):
    """The cells of several ranks are those of one, once each, with what is on them."""
    for step in (0, 2, 4):
        name = f"{run}_{kind}_{step:06d}"
        expected, found = read(one / f"{name}.vtu"), read(several / f"{name}.pvtu")
        assert found.types == expected.types and len(found.cells) == len(expected.cells)
        (corners, order), (corners_of_one, order_of_one) = by_place(found), by_place(expected)
        np.testing.assert_allclose(found.x[corners], expected.x[corners_of_one], atol=1e-15)
        assert list(found.point_data) == list(expected.point_data)
        assert list(found.cell_data) == list(expected.cell_data)
        for key, value in expected.point_data.items():
            assert_close(found.point_data[key][corners], value[corners_of_one], f"{name} {key}")
        for key, value in expected.cell_data.items():
            assert_close(found.cell_data[key][order], value[order_of_one], f"{name} {key}")


def files(folder, name):
    """The pieces of a file, which are all that there is of it."""
    found = pieces(folder / f"{name}.pvtu")
    assert sorted(found) == sorted((folder / name[:-7]).glob(f"{name}_*"))
    return found


def by_place(mesh):
    """Corners (cells, 2^dim) of the cells in an order that their places say, and which they are."""
    order = np.lexsort(mesh.x[mesh.cells].mean(axis=1).round(9).T)
    cells = mesh.cells[order]
    ring = [np.lexsort(mesh.x[corners].round(9).T) for corners in cells]
    return np.take_along_axis(cells, np.array(ring), axis=1), order


@pytest.mark.parametrize("read", (ByVTK, ByMeshio))
@pytest.mark.parametrize("dim", (2, 3))
def test_pieces_of_ranks_are_the_file_of_one_rank_point_by_point(read, dim, alone, written):
    """A rank without points writes nothing: at first all are on the first."""
    one, numbers = alone
    first, last = same_points(read, dim, one, numbers[dim], written)
    assert list(first) == ["0000"] and list(last) == ["0000", "0001"]


@pytest.mark.parametrize("read", (ByVTK, ByMeshio))
@pytest.mark.parametrize("kind", ("grid", "stress"))
@pytest.mark.parametrize("run", ("mpm2", "mpm3", "fe2", "fe3"))
def test_pieces_of_ranks_are_the_grid_of_one_rank_cell_by_cell(read, run, kind, alone, written):
    same_cells(read, run, kind, alone[0], written)
    for step in (0, 2, 4) if kind == "grid" else ():
        assert len(files(written, f"{run}_grid_{step:06d}")) == 2


def test_a_rank_that_cannot_write_costs_all_a_frame_and_one_rank_goes_on_with_the_series(
    written, tmp_path
):
    """After a failure of the last rank at step 1; the state that the last rank keeps serves."""
    path = shutil.copytree(written, tmp_path / "copied") / "fails"
    listed = {"points": (0, 1, 2), "grid": (0, 2)}  # the last rank has no point to write at first

    def frames(kind, by_one=()):
        steps = sorted({*listed[kind], *by_one})
        names = [f"fails_{kind}_{s:06d}.{'vtu' if s in by_one else 'pvtu'}" for s in steps]
        return [1e-3 * step for step in steps], names

    for kind in listed:
        assert series(path, kind) == frames(kind)
    assert not list(path.parent.glob("fails_grid_000001*")) and not list(
        path.parent.rglob("*.part")
    )
    run, _ = rising(2)
    shots = run.record(Snapshots(path, every=3))
    with np.load(path.parent / "state.npz") as state:
        shots.restore(state)
    run.until(3e-3)
    for kind in listed:
        assert series(path, kind) == frames(kind, by_one=(0, 3))  # it has written the start anew


if __name__ == "__main__":
    record_all(sys.argv[1])
