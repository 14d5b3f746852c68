"""A compiled UMAT gives the numbers of the law that is built in, and one that is not what it should
be is refused in a sentence."""

import pickle
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx.common import tensors
from mpm_fenicsx.common.errors import SolverError
from mpm_fenicsx.common.ranks import together

COMPILER = shutil.which("cc")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler named cc")

EXAMPLE = Path(__file__).parents[1] / "demos" / "extensions" / "drucker_prager_umat.c"
SOIL = mpm.LinearElastic(young=20e6, poisson=0.3, density=1800.0)
C = 10e3
BUILT_IN = mpm.VonMises(SOIL, peak=C, residual=C, softening=0.0)
HEAD = """
#include <math.h>
#include <stddef.h>
void umat_(double *stress, double *statev, double *ddsdde, double *sse, double *spd, double *scd,
           double *rpl, double *ddsddt, double *drplde, double *drpldt, double *stran,
           double *dstran, double *time, double *dtime, double *temp, double *dtemp,
           double *predef, double *dpred, char *cmname, int *ndi, int *nshr, int *ntens,
           int *nstatv, double *props, int *nprops, double *coords, double *drot, double *pnewdt,
           double *celent, double *dfgrd0, double *dfgrd1, int *noel, int *npt, int *layer,
           int *kspt, int *kstep, int *kinc, size_t length)
{
    const int n = *ntens;
    const double l = 1e7, m = 8e6;
    double trace = dstran[0] + dstran[1] + dstran[2];
    for (int i = 0; i < n; i++) {
        stress[i] += i < 3 ? 2 * m * dstran[i] + l * trace : m * dstran[i];
        for (int j = 0; j < n; j++)
            ddsdde[i + n * j] = (i < 3 && j < 3 ? l : 0) + (i == j ? (i < 3 ? 2 * m : m) : 0);
    }
"""
LAME = (1e7, 8e6)


def compiled(folder, body, name="own.so", head=HEAD):
    """An elastic routine with these lines at its end, as a library."""
    source = folder / f"{name}.c"
    source.write_text(head + body + "}\n")
    command = [COMPILER, "-O1", "-shared", "-fPIC", "-o", folder / name, source, "-lm"]
    subprocess.run(command, check=True)
    return folder / name


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    folder = tmp_path_factory.mktemp("umat")
    command = [COMPILER, "-O2", "-shared", "-fPIC", "-o", folder / "dp.so", EXAMPLE, "-lm"]
    subprocess.run(command, check=True)
    return folder / "dp.so"


@pytest.fixture(scope="module")
def law(example):
    """Von Mises's soil as a UMAT."""
    return mpm.Umat(example, [20e6, 0.3, 0.0, 0.0, np.sqrt(3.0) * C], 1, elastic=SOIL)


def plain(library, states=0, **more):
    return mpm.Umat(library, [], states, density=1800.0, lame=LAME, **more)


def states(dim, n=500):
    rng, count = np.random.default_rng(1), tensors.components(dim)
    strain = np.geomspace(1e-6, 1e-2, n)[:, None] * rng.normal(size=(n, count))
    return strain, rng.uniform(-2e3, 2e3, size=(n, count))


# -- the numbers of the law that is built in -------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_single_points_are_those_of_von_mises(law, dim):
    strain, stress = states(dim)
    given, known = law.initial_history(stress), BUILT_IN.initial_history(stress)
    for way in (1.0, -0.5):  # out, and part of the way back
        mine = law.tangent(way * strain, stress, given)
        theirs = BUILT_IN.tangent(way * strain, stress, known)
        for a, b in zip(mine, theirs, strict=True):
            np.testing.assert_allclose(a[..., : b.shape[-1]], b, atol=1e-12 * np.abs(b).max())
        again, _ = law.respond(way * strain, stress, given)
        np.testing.assert_array_equal(again, mine[0])
        stress, given, known = mine[0], mine[1], theirs[1]
    work = BUILT_IN.plastic_work(known)
    assert work.max() > 0.0
    np.testing.assert_allclose(law.plastic_work(given), work, atol=1e-12 * work.max())


@pytest.mark.parametrize("dim", [2, 3])
def test_the_cone_of_the_example_has_its_tangent(example, dim):
    cone = mpm.Umat(example, [20e6, 0.3, 0.8, 0.2, 10e3], ["shear"], elastic=SOIL)
    strain, stress = states(dim, 60)
    stress[:] = 0.0
    history = cone.initial_history(stress)
    new, after, tangent = cone.tangent(strain, stress, history)
    flows = after[:, 0] > 0.0
    q, p = tensors.von_mises(new), tensors.mean(new)
    np.testing.assert_allclose((q + 0.8 * p)[flows], 10e3, rtol=1e-9)
    assert 10 < flows.sum() < 50 and (q[flows] < 1.0).any()  # at the apex, too
    exact = np.empty_like(tangent)
    for j in range(strain.shape[1]):
        move = 1e-9 * np.eye(strain.shape[1])[j]
        up, down = (cone.respond(strain + s * move, stress, history)[0] for s in (1, -1))
        exact[:, :, j] = (up - down) / 2e-9
    wrong = np.abs(tangent - exact).max(axis=(1, 2)) / LAME[0]
    assert np.median(wrong) < 1e-6 and wrong.max() < 1e-4


@pytest.mark.skipif(
    not hasattr(mpm, "DruckerPrager"), reason="the package has no Drucker-Prager of its own yet"
)
@pytest.mark.parametrize("dim", [2, 3])
def test_the_cone_is_that_of_the_law_built_in(example, dim):
    """√J₂ + η p = k there, q + α p = √3 k here; in compression η = 6 sin φ/(√3 (3 - sin φ))."""
    c, φ, ψ = 10e3, 30.0, 10.0
    η, flow = (2 * np.sin(a) / (3 - np.sin(a)) * np.sqrt(3) for a in np.radians([φ, ψ]))
    k = 3 * c * η / np.sqrt(3) / np.tan(np.radians(φ))
    cone = mpm.Umat(example, [20e6, 0.3, np.sqrt(3) * η, np.sqrt(3) * flow, k], 1, elastic=SOIL)
    known = mpm.DruckerPrager(SOIL, cohesion=c, friction_angle=φ, dilation_angle=ψ)
    strain, _ = states(dim)
    stress = np.zeros_like(strain)
    mine = cone.tangent(strain, stress, cone.initial_history(stress))
    theirs = known.tangent(strain, stress, known.initial_history(stress))
    for a, b in zip(mine[::2], theirs[::2], strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12 * np.abs(b).max())
    work = known.plastic_work(theirs[1])
    np.testing.assert_allclose(cone.plastic_work(mine[1]), work, atol=1e-12 * work.max())


@pytest.mark.parametrize("mapping", [None, mpm.DM_GC, mpm.GIMP], ids=lambda m: str(m or "FE"))
@pytest.mark.parametrize(
    "stepping", [mpm.QuasiStatic(3), mpm.Newmark(2e-3)], ids=["static", "dynamic"]
)
def test_runs_are_those_of_von_mises(law, mapping, stepping):
    def ran(material):
        grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (2, 2))
        terms = [
            mpm.Fixed(grid.facets("left", "right"), "x"),
            mpm.Fixed(grid.facets("bottom")),
            mpm.Traction(
                grid.facets("top"), lambda t, x: (1.0 + t) * np.array([0.0, -35e3]) * x[:, :1]
            ),
        ]
        direct = {"ksp_type": "preonly", "pc_type": "lu"}
        solver = mpm.Solver(petsc=direct, newton=mpm.Newton(tolerance=1e-11))
        if mapping is None:
            run = mpm.FiniteElements(grid, material, stepping, terms, solver=solver)
        else:
            body = mpm.MaterialPoints.fill(grid, material, 4)
            run = mpm.Simulation(grid, body, stepping, terms, mapping, solver)
        energy = run.record(mpm.Energy())
        for _ in range(3):
            run.step()
        stress = run.gauss_stress() if mapping is None else run.bodies[0].stress
        return stress, energy["plastic"], run.nodal("increment").copy()

    mine, theirs = ran(replace(law, symmetric=True)), ran(BUILT_IN)
    assert theirs[1][-1] > 0.0
    for a, b in zip(mine, theirs, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-11 * np.abs(b).max())


def test_a_law_goes_to_other_threads_and_processes(law):
    """Its routine is found again by path and name; each call has arguments of its own."""
    again = pickle.loads(pickle.dumps(law))
    assert again == law and hash(again) == hash(law)
    strain, stress = states(3, 5000)
    history = law.initial_history(stress)
    ways = np.linspace(-1.0, 1.0, 16)
    alone = [law.tangent(way * strain, stress, history)[0] for way in ways]
    with ThreadPoolExecutor(2) as pool:
        together = pool.map(lambda way: again.tangent(way * strain, stress, history)[0], ways)
        for a, b in zip(alone, together, strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.skipif(shutil.which("gfortran") is None, reason="there is no gfortran")
@pytest.mark.parametrize("dim", [2, 3])
def test_the_fortran_of_the_page_is_elastic_soil(tmp_path, dim):
    page = (Path(__file__).parents[1] / "docs" / "how_to" / "own_umat.md").read_text()
    source = page.split('write_text("""\\\n')[1].split('"""')[0]
    (tmp_path / "elastic.f").write_text(source)
    command = [
        "gfortran",
        "-shared",
        "-fPIC",
        "-o",
        tmp_path / "elastic.so",
        tmp_path / "elastic.f",
    ]
    subprocess.run(command, check=True)
    soil = mpm.Umat(tmp_path / "elastic.so", [20e6, 0.3], 0, elastic=SOIL)
    soil.check(dim)
    strain, stress = states(dim, 20)
    new, history, D = soil.tangent(strain, stress, soil.initial_history(stress))
    np.testing.assert_allclose(new, SOIL.update(strain, stress), rtol=1e-12, atol=1e-8)
    np.testing.assert_allclose(D[3], mpm.stiffness(SOIL.lame, dim), rtol=1e-12)
    assert np.abs(soil.plastic_work(history)).max() < 1e-12 * np.abs(new * strain).max()


# -- what is passed --------------------------------------------------------------------------------


def test_components_state_and_properties_arrive_where_they_belong(tmp_path):
    """In 3D Abaqus's shear strains are xy, xz, yz."""
    body = """
    for (int i = 0; i < n; i++) statev[i] += (i + 1) * dstran[i];
    statev[6] = props[1];
    statev[7] = *celent;
    statev[8] += 100 * *kinc + 10 * *kstep + time[0];
    statev[9] = cmname[0] + length;
    """
    names = [f"s{n}" for n in range(10)]
    soil = mpm.Umat(
        compiled(tmp_path, body),
        {"first": 1.0, "second": 2.0},
        dict.fromkeys(names, 0.0) | {"s0": 5.0},
        density=1800.0,
        lame=LAME,
        length=1.0,
    )
    assert soil.history == (*names, "plastic_work") and soil.parameters[:3] == (
        "first",
        "second",
        "s0",
    )
    zero, given = np.zeros((2, 6)), {"size": np.array([0.1, 0.2]), "second": np.array([3.0, 4.0])}
    history = soil.initial_history(zero, given | {"s1": np.array([7.0, 8.0])})
    np.testing.assert_array_equal(history[:, :3], [[5, 7, 0], [5, 8, 0]])
    np.testing.assert_array_equal(history[:, 8], 110.0)  # KINC = 1 at time 0
    strain = np.array([[1, 2, 3, 4, 5, 6]] * 2) * 1e-3
    stress, after, D = soil.tangent(strain, zero, history, given)
    np.testing.assert_allclose(after[0, :6], [5.001, 7.004, 0.009, 0.016, 0.03, 0.03], rtol=1e-12)
    np.testing.assert_array_equal(after[:, 6:10], [[3, 0.1, 321, 159], [4, 0.2, 321, 159]])
    np.testing.assert_allclose(stress, mpm.hooke(LAME, strain, zero), rtol=1e-14)
    np.testing.assert_allclose(D[0], mpm.stiffness(LAME, 3))
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (2, 2))
    body = mpm.MaterialPoints.fill(grid, soil, 4, parameters={"s1": lambda x: x[0]})
    np.testing.assert_array_equal(body.history[:, 1], body.x[:, 0])
    assert (body.parameters["size"] == 0.5).all()


def test_energies_and_total_strain_are_kept_where_they_are_asked_for(tmp_path):
    body = """
    double work = 0;
    for (int i = 0; i < n; i++) work += stress[i] * dstran[i];
    *sse += work; *spd += 2 * work; *scd += 3 * work;
    statev[0] = stran[n - 1] + dstran[n - 1];
    """
    library = compiled(tmp_path, body)
    soil = plain(library, 1, energies=True, total_strain=True)
    assert soil.history[1:] == (
        *(f"strain_{name}" for name in ("xx", "yy", "zz", "xy", "yz", "xz")),
        *("stored_energy", "plastic_work"),
    )
    for count in (4, 6):
        strain, stress = np.full((1, count), 1e-3), np.zeros((1, count))
        history, done = soil.initial_history(stress), 0.0
        for n in (1, 2, 3):
            stress, history = soil.respond(strain, stress, history)
            done += float(stress[0] @ strain[0])
            assert history[0, 0] == pytest.approx(n * 1e-3)
        assert soil.energy(stress, history) == pytest.approx([done])
        assert soil.plastic_work(history) == pytest.approx([5 * done])
    with pytest.raises(ValueError, match=r"gives what is no number.*STRAN \(say total_strain=True"):
        plain(library, 1).check(2)


# -- what is refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "more", "words"),
    [
        ("statev[2] = 1;", {}, "changes what it must not, in or beyond STATEV.*NSTATV = 1"),
        ("statev[-1] = 1;", {}, "changes what it must not, in or beyond STRESS"),
        ("ddsdde[n * n] = 1;", {}, "in or beyond DDSDDE.*NTENS = 4"),
        ("time[0] = 3;", {}, "in or beyond TIME"),
        ("ntens[0] = 6;", {}, "in or beyond NTENS"),
        ("stress[0] += 0 * props[3];", {}, "no number.*may read beyond PROPS .*there are 0 and 1"),
        ("stress[0] += 0 * dfgrd1[0];", {}, "no number, .* told: COORDS, DFGRD0, DFGRD1"),
        ("stress[0] += 0 * *celent;", {}, r"CELENT \(give length\)"),
        (
            "ddsdde[n * n - 1] *= 2;",
            {},
            r"not the derivative of its stress in 48 of 48 .* row 4, c",
        ),
        ("ddsdde[n] *= 1.1;", {}, r"not the derivative .* in row 1, column 2"),
        ("*pnewdt = 0.25;", {}, r"smaller step, PNEWDT = 0.25, .*check_strain = 0.001"),
        ("stress[0] += 1;", {}, "stress must be one that umat_ of own.so can bear"),
    ],
)
def test_a_routine_that_is_not_what_it_should_be_is_refused(tmp_path, body, more, words):
    soil = plain(compiled(tmp_path, body), 1, **more)
    with pytest.raises(ValueError, match=words):
        mpm.MaterialPoints.fill(mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (2, 2)), soil, 4)


def test_a_tangent_may_be_taken_as_it_is_and_no_kink_is_taken_for_a_mistake(tmp_path, law):
    wrong = compiled(tmp_path, "ddsdde[n] *= 1.2;")
    plain(wrong, check_tangent=False).check(2)
    kink = compiled(tmp_path, "if (dstran[0] > 0) stress[0] *= 0.5, ddsdde[0] *= 0.5, ddsdde[n] *="
                    "0.5, ddsdde[2 * n] *= 0.5, ddsdde[3 * n] *= 0.5;", "kink.so")  # fmt: skip
    plain(kink).check(2)
    for dim in (2, 3):
        law.check(dim)


def test_libraries_that_cannot_be_called_are_refused(tmp_path, example):
    good = {"density": 1800.0, "lame": LAME}
    with pytest.raises(ValueError, match=r"library must be .* got '.*/none\.so': No such file"):
        mpm.Umat(tmp_path / "none.so", [], 0, **good)
    with pytest.raises(ValueError, match=r"cannot be loaded: .*not source or an object file"):
        mpm.Umat(EXAMPLE, [], 0, **good)
    with pytest.raises(ValueError, match=r"'umat' is not in .* which has umat_: give symbol"):
        mpm.Umat(example, [], 0, symbol="umat", **good)
    with pytest.raises(ValueError, match="nor is any name near it: gfortran makes of SUBROUTINE"):
        mpm.Umat(example, [], 0, symbol="qqqqqq", **good)
    lacking = HEAD.replace("void umat_", "extern void xit_(void);\nvoid umat_")
    with pytest.raises(ValueError, match="it calls xit_, which is not in it; compile a file that"):
        mpm.Umat(compiled(tmp_path, "xit_();", "lacking.so", lacking), [], 0, **good)
    old = compiled(tmp_path, "", "twice.so")
    plain(old)
    old.unlink()
    compiled(tmp_path, "stress[0] += 0;", "twice.so", HEAD.replace("1e7", "2e7"))
    with pytest.raises(ValueError, match="was built anew after this process had loaded it"):
        plain(old)


def test_parameters_out_of_range_are_refused_by_name(example):
    known = {"library": example, "properties": [20e6, 0.3, 0, 0, 1e4], "state_variables": 1}
    for more, words in (
        ({}, "elastic, or density and lame, must be given"),
        ({"elastic": mpm.Hencky(20e6, 0.3, 1800.0)}, "must be of small strain.*DFGRD1"),
        ({"elastic": 3.0}, "elastic must be a LinearElastic, got 3.0"),
        ({"elastic": SOIL, "density": 1.0}, "density must be left out where elastic is given"),
        ({"density": 1800.0, "lame": (1e6, -1.0)}, "lame must be two numbers"),
        ({"elastic": SOIL, "state_variables": -1}, "state_variables must be a whole number"),
        ({"elastic": SOIL, "state_variables": ["a", "a"]}, "must be .* different names, or"),
        ({"elastic": SOIL, "state_variables": ["plastic_work"]}, "names so|names of their own"),
        ({"elastic": SOIL, "properties": ["x"]}, "property_1 of properties must be a number"),
        ({"elastic": SOIL, "library": 3}, "library must be the path"),
        ({"elastic": SOIL, "symmetric": 2}, "symmetric must be True or False, got 2"),
    ):
        with pytest.raises(ValueError, match=words):
            mpm.Umat(**(known | more))


def test_on_several_ranks_a_step_that_cannot_be_solved_stays_one():
    """One that can be halved, where another error is of the scene."""

    class Two:
        size = 2

        def __init__(self, other=None):
            self.other = other

        def allgather(self, message):
            return [message, self.other]

    with pytest.raises(SolverError, match=r"^smaller$"), together(Two(), Exception):
        raise SolverError("smaller")
    with pytest.raises(SolverError, match=r"^there$"), together(Two((True, "there"))):
        pass
    with pytest.raises(ValueError, match=r"^TypeError: what$"), together(Two(), Exception):
        raise TypeError("what")


# -- in a run --------------------------------------------------------------------------------------


def block(material, steps, load=-1e4):
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (2, 2))
    terms = [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom")),
        mpm.Traction(grid.facets("top"), lambda t: (0.0, load * t)),
    ]
    body = mpm.MaterialPoints.fill(grid, material, 4)
    return mpm.Simulation(grid, body, mpm.QuasiStatic(steps), terms)


def test_a_routine_that_asks_for_a_smaller_step_gets_it(tmp_path):
    """Its largest strain is a third of what the load takes."""
    body = "if (fabs(dstran[1]) > 1.3e-4) *pnewdt = 0.5;"
    soil = plain(compiled(tmp_path, body), check_strain=1e-5)
    run, exact = block(soil, 1), block(plain(compiled(tmp_path, "", "elastic.so")), 4)
    run.step()
    exact.until(1.0)
    np.testing.assert_allclose(run.bodies[0].stress, exact.bodies[0].stress, rtol=1e-9)
    with pytest.raises(mpm.RunError, match=r"smaller step, PNEWDT = 0.5.* halved 3 times"):
        block(soil, 1, load=-1e5).step()
    with pytest.raises(SolverError):
        soil.respond(np.full((1, 4), 1e-3), np.zeros((1, 4)), np.zeros((1, 1)))


def test_a_run_goes_on_with_the_library_elsewhere_and_not_with_another(tmp_path, law):
    def soil(library):
        return mpm.Umat(library, [20e6, 0.3, 0.0, 0.0, np.sqrt(3) * 2e3], 1, elastic=SOIL)

    run = block(soil(law.library), 4)
    run.record(mpm.Checkpoint(tmp_path / "run", every=2))
    run.until(1.0)
    moved = tmp_path / "moved.so"
    shutil.copy(law.library, moved)
    again = block(soil(moved), 4)
    again.restart(tmp_path / "run")
    np.testing.assert_array_equal(again.bodies[0].history, run.bodies[0].history)
    assert again.bodies[0].history[:, 0].max() > 0.0
    other = tmp_path / "other.so"
    subprocess.run(
        [COMPILER, "-O0", "-g", "-shared", "-fPIC", "-o", other, EXAMPLE, "-lm"], check=True
    )
    with pytest.raises(ValueError, match="Umat"):
        block(soil(other), 4).restart(tmp_path / "run")
