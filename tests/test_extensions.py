"""What a user adds of his own: each of the worked extensions in demos/extensions is one file, and
right."""

import sys
from dataclasses import dataclass
from pathlib import Path

import dense
import inside
import numpy as np
import pytest
from test_hencky import responses

import mpm_fenicsx as mpm
from mpm_fenicsx.common import tensors
from mpm_fenicsx.materials.material import hooke, stiffness
from mpm_fenicsx.response.finite_strain import product

sys.path.insert(0, str(Path(__file__).parents[1] / "demos" / "extensions"))
from drucker_prager import DruckerPrager
from rayleigh_damping import RayleighDamping, energy_left
from winkler_boundary import WinklerBoundary, settled

SOIL = mpm.LinearElastic(young=20e6, poisson=0.3, density=1800.0)
LAW = DruckerPrager(SOIL, friction=1.2, dilation=0.3, cohesion=10e3)


# -- a boundary ------------------------------------------------------------------------------------


def test_a_block_settles_on_winklers_bed():
    computed, exact = settled()
    assert computed == pytest.approx(exact, rel=1e-8)


@pytest.mark.parametrize("dim", [2, 3])
def test_on_facets_too_with_energy_in_balance_and_across_a_restart(dim, tmp_path):
    """Elements under a sudden load on springs: work is kinetic, strain and stored energy."""
    from mpm_fenicsx import Checkpoint

    def scene():
        grid = dense.uneven(dim)
        side = "top" if dim == 2 else "front"
        foot = "bottom" if dim == 2 else "back"
        load = (0.0,) * (dim - 1) + (-1e3,)
        terms = [
            mpm.Traction(grid.facets(side), load),
            WinklerBoundary(grid.facets(foot), 1e6, 2e5),
        ]
        run = mpm.FiniteElements(grid, SOIL, mpm.Newmark(1e-3), terms)
        return run, run.record(mpm.Energy())

    run, energy = scene()
    run.record(Checkpoint(tmp_path / "half", every=10))
    for _ in range(19):
        run.step()
    assert energy["stored"][-1] > 0.01 * energy["work"][-1]
    assert np.abs(energy.lost).max() < 1e-10 * energy["work"].max()
    again, _ = scene()
    again.record(Checkpoint(tmp_path / "other"))
    again.restart(tmp_path / "half")
    for _ in range(9):
        again.step()
    np.testing.assert_array_equal(again.displacement.x.array, run.displacement.x.array)


# -- damping ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("mapping", [None, mpm.DM_GC, mpm.GIMP], ids=lambda m: str(m or "FE"))
def test_a_standing_wave_loses_what_rayleigh_says(mapping):
    computed, exact = energy_left(mapping)
    assert computed == pytest.approx(exact, rel=5e-3)


@pytest.mark.parametrize("mapping", [None, mpm.MPM, mpm.DM_GC], ids=lambda m: str(m or "FE"))
def test_damping_of_each_material_is_that_of_all(mapping):
    """Two layers, one term for both or one each; what is damped is in the balance."""
    stiff = mpm.LinearElastic(young=50e6, poisson=0.2, density=2000.0)
    found = []
    for terms in (
        [RayleighDamping(5.0, 1e-4)],
        [RayleighDamping(5.0, 1e-4, SOIL), RayleighDamping(5.0, 1e-4, stiff)],
    ):
        grid = mpm.Grid.box((0.0, 0.0), (1.0, 2.0), (2, 4))
        layers = [
            mpm.MaterialPoints.fill(grid, SOIL, 4, lambda x: x[1] > 1.0),
            mpm.MaterialPoints.fill(grid, stiff, 4, lambda x: x[1] < 1.0),
        ]
        terms = [
            *terms,
            mpm.Fixed(grid.facets("bottom")),
            mpm.Traction(grid.facets("top"), (0.0, -1e3)),
        ]
        if mapping is None:
            run = mpm.FiniteElements(grid, layers, mpm.Newmark(1e-3), terms)
        else:
            run = mpm.Simulation(grid, layers, mpm.Newmark(1e-3), terms, mapping)
        energy = run.record(mpm.Energy())
        for _ in range(20):
            run.step()
        assert "damped" in energy.names and energy["damped"][-1] > 0.0
        found.append((run, energy))
    (one, energy), (each, energies) = found
    np.testing.assert_allclose(energies.values, energy.values, rtol=1e-9, atol=1e-12)
    if mapping is None:
        assert np.abs(energy.lost).max() < 1e-9 * energy["work"].max()
        np.testing.assert_allclose(
            each.displacement.x.array, one.displacement.x.array, rtol=1e-9, atol=1e-16
        )


def test_damping_of_a_material_that_is_not_there_is_refused():
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (2, 2))
    body, other = mpm.MaterialPoints.fill(grid, SOIL, 4), mpm.LinearElastic(1e6, 0.3, 1e3)
    for make in (
        lambda term: mpm.Simulation(grid, body, mpm.Newmark(1e-3), [term]),
        lambda term: mpm.FiniteElements(grid, SOIL, mpm.Newmark(1e-3), [term]),
    ):
        with pytest.raises(ValueError, match=r"no (body|cell) is of the material LinearElastic"):
            make(RayleighDamping(1.0, 0.0, other))
    with pytest.raises(ValueError, match="RayleighDamping needs velocities: step with Newmark"):
        mpm.Simulation(grid, body, mpm.QuasiStatic(1), [RayleighDamping(1.0, 0.0)])


# -- a law -----------------------------------------------------------------------------------------


def states(dim, n=40):
    """Increments of strain that leave points elastic, let them flow, or take them to the apex."""
    rng = np.random.default_rng(3)
    count = tensors.components(dim)
    strain = np.geomspace(1e-5, 3e-3, n)[:, None] * rng.normal(size=(n, count))
    stress = np.zeros((n, count))
    stress[:, :3] = rng.uniform(-10e3, 2e3, n)[:, None]
    return strain, stress, np.zeros((n, 1))


@pytest.mark.parametrize("dim", [2, 3])
def test_the_tangent_is_the_derivative_and_stress_stays_within_the_cone(dim):
    strain, stress, history = states(dim)
    new, work, D = LAW.tangent(strain, stress, history)
    q, p = tensors.von_mises(new), tensors.mean(new)
    assert (q + LAW.friction * p).max() < LAW.cohesion * (1 + 1e-9)
    flows = work[:, 0] > 0.0
    assert 5 < flows.sum() < 35 and (q[flows] < 1.0).any() and (work >= 0.0).all()
    exact = np.empty_like(D)
    for j in range(strain.shape[1]):
        move = 1e-9 * np.eye(strain.shape[1])[j]
        up, down = (LAW.tangent(strain + s * move, stress, history)[0] for s in (1, -1))
        exact[:, :, j] = (up - down) / 2e-9
    wrong = np.abs(D - exact).max(axis=(1, 2)) / LAW.lame[0]
    assert np.median(wrong) < 1e-6 and wrong.max() < 1e-4


@pytest.mark.parametrize("mapping", [None, mpm.MPM, mpm.DM_GC], ids=lambda m: str(m or "FE"))
@pytest.mark.parametrize(
    "stepping", [mpm.QuasiStatic(4), mpm.Newmark(2e-3)], ids=["static", "dynamic"]
)
def test_simple_shear_ends_at_the_cone_and_the_solver_is_one_for_such_matrices(mapping, stepping):
    """Flow without change of volume under a given pressure: τ = (k - μ p)/√3 wherever it is
    sheared."""
    law = DruckerPrager(SOIL, friction=0.6, dilation=0.0, cohesion=10e3)
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (1, 1))
    far = 0.01
    terms = [mpm.Fixed(grid.facets(side), "y") for side in ("left", "right", "bottom", "top")]
    if not stepping.dynamic:
        terms += [
            mpm.Fixed(grid.facets("bottom"), "x"),
            mpm.Fixed(grid.facets("top"), "x", lambda t: far * t),
        ]
    if mapping is None:
        run = mpm.FiniteElements(grid, law, stepping, terms)
    else:
        run = mpm.Simulation(grid, mpm.MaterialPoints.fill(grid, law, 4), stepping, terms, mapping)
    solver = inside.linear_solver(run)
    kind = solver.getType(), solver.getPC().getType()
    factored = not stepping.dynamic or mapping is None
    assert kind == (("preonly", "lu") if factored else ("gmres", "ilu"))
    for _ in range(4):
        run.step()
    if not stepping.dynamic:
        stress = run.stress(np.arange(1)) if mapping is None else run.bodies[0].stress
        np.testing.assert_allclose(stress[:, 3], 10e3 / np.sqrt(3), rtol=1e-6)


@pytest.mark.parametrize("dim", [2, 3])
def test_on_henckys_soil_the_law_is_of_finite_strain_and_its_tangent_whole(dim):
    """The derivative of nominal stress by the deformation, against differences."""
    soil = mpm.Hencky(young=20e6, poisson=0.3, density=1800.0)
    law = DruckerPrager(soil, friction=1.2, dilation=0.3, cohesion=10e3)
    assert law.kinematics.finite
    n, rng = 20, np.random.default_rng(4)
    body = mpm.MaterialPoints(law, np.zeros((n, dim)), np.full((n, dim), 0.5), np.ones(n))
    f = np.eye(dim) + np.geomspace(1e-4, 3e-2, n)[:, None, None] * rng.normal(size=(n, dim, dim))
    _, A = responses(body, f)
    assert A.shape == (n, dim**4)
    way = rng.normal(size=f.shape)
    up, down = (responses(body, f + s * 1e-8 * way)[0] for s in (1, -1))
    exact, found = (up - down) / 2e-8, product(A, way.reshape(len(way), -1)).reshape(f.shape)
    wrong = np.abs(found - exact).max(axis=(1, 2)) / soil.lame[0]
    assert np.median(wrong) < 1e-6 and wrong.max() < 1e-4
    whole = A.reshape(n, dim**2, dim**2)
    assert np.abs(whole - whole.transpose(0, 2, 1)).max() > 1e-2 * np.abs(whole).max()


# -- what is refused -------------------------------------------------------------------------------


class Own:
    """A term that returns whatever it is told."""

    def __init__(self, make):
        self.make = make

    def bind(self, scene):
        return self.make(scene.motion, scene.dx)


def asked(make):
    grid = dense.uneven(2)
    terms = [mpm.Fixed(grid.facets("bottom")), Own(make)]
    return mpm.FiniteElements(grid, SOIL, mpm.QuasiStatic(1), terms)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda m, dx: 3, "bind of Own must return a Contribution, got 3"),
        (lambda m, dx: mpm.Contribution(3.0), "work of Own must be a form, got 3.0"),
        (lambda m, dx: mpm.Contribution(m.u[0] * dx), "linear in the test function w .* has 0"),
        (
            lambda m, dx: mpm.Contribution(m.u[0] ** 3 * m.w[0] * dx),
            "work of Own is not linear in the increment u",
        ),
        (lambda m, dx: mpm.Contribution(energy={}), "^terms: energy of Own must be a function"),
        (lambda m, dx: mpm.Contribution(energy=lambda u: {}), "energy of Own .* without arguments"),
        (lambda m, dx: mpm.Contribution(before=print), "before of Own must be a list of functions"),
        (
            lambda m, dx: mpm.Contribution(before=[lambda: None]),
            r"^terms: before of Own must be functions .* called as before\(start, end\), got <func",
        ),
        (
            lambda m, dx: mpm.Contribution(after=[lambda run: None]),
            r"^terms: after of Own must be functions .* called as after\(\), got <function",
        ),
        (
            lambda m, dx: mpm.Contribution(memory=[np.zeros(2)]),
            r"^terms: memory of Own must be arrays by name, .*got \[array\(",
        ),
        (
            lambda m, dx: mpm.Contribution(memory={"x": 1.0}),
            "memory of Own must be arrays .*'x': 1.0",
        ),
    ],
)
def test_a_contribution_that_is_none_is_refused_when_the_run_is_built(make, words):
    with pytest.raises(ValueError, match=words):
        asked(make)


def test_a_term_that_hides_that_it_is_not_symmetric_is_refused():
    def askew(symmetric):
        return lambda m, dx: mpm.Contribution(
            1e8 * m.u[1] * m.w[0] * dx, symmetric=symmetric, holds=True
        )

    with pytest.raises(mpm.RunError, match=r"the matrix is askew by .* says symmetric=False"):
        asked(askew(True)).step()
    asked(askew(False)).step()


def test_energy_of_a_term_has_a_name_of_its_own():
    run = asked(lambda m, dx: mpm.Contribution(energy=lambda: {"strain": m.u[0] * m.u[0] * dx}))
    with pytest.raises(ValueError, match="a term names strain, which is of the body itself"):
        run.record(mpm.Energy())


@pytest.mark.parametrize(
    ("energy", "words"),
    [
        (
            lambda m, dx: m.u[0] * m.u[0] * dx,
            r"^terms: energy of Own must return forms by name, .*",
        ),
        (lambda m, dx: {"stored": 3.0}, "^terms: energy 'stored' of Own must be a form, .*got 3.0"),
        (lambda m, dx: {"stored": 0}, "'stored' of Own must be a form, .*leave out what is zero"),
        (
            lambda m, dx: {"stored": m.u[0] * m.w[0] * dx},
            "^terms: energy 'stored' of Own .* test function w .*: put the increment u in its",
        ),
        (lambda m, dx: {"lost": m.u[0] ** 2 * dx}, "energy of Own is named 'lost': give it .*own"),
        (lambda m, dx: {"left": m.u[0] ** 2 * dx}, "energy of Own is named 'left': give it .*own"),
        (lambda m, dx: {3: m.u[0] ** 2 * dx}, "energy of Own is named 3: give it .* a text"),
    ],
)
def test_energy_of_a_term_that_is_none_is_refused_when_it_is_asked_for(energy, words):
    run = asked(lambda m, dx: mpm.Contribution(energy=lambda: energy(m, dx)))
    with pytest.raises(ValueError, match=words):
        run.record(mpm.Energy())
    assert not run.recorders


def test_hooks_may_take_more_than_they_are_given():
    """Partial functions, those with defaults, and those that do not say what they take."""
    calls = []

    def before(start, end, scale=2.0):
        calls.append((start, scale * end))

    hooks = {"before": [before, lambda *times: calls.append(times)], "after": [lambda n=1: None]}
    run = asked(lambda m, dx: mpm.Contribution(**hooks))
    run.step()
    assert calls == [(0.0, 2.0), (0.0, 1.0)]


@pytest.mark.parametrize("name", ["velocity", "acceleration", "dt"])
def test_what_motion_lacks_in_statics_is_said_with_the_term_that_asks(name):
    with pytest.raises(
        AttributeError, match=rf"^terms: bind of Own: motion\.{name} .*dynamics alone.*steps=1"
    ):
        asked(lambda m, dx: mpm.Contribution(getattr(m, name)))
    with pytest.raises(AttributeError, match="bind of Own: 'Motion' object has no attribute 'vel'"):
        asked(lambda m, dx: mpm.Contribution(m.vel))
    with pytest.raises(AttributeError, match=r"^'float' object has no attribute 'real_part'"):
        asked(lambda m, dx: (1.0).real_part)


class InPlace(DruckerPrager):
    def tangent(self, strain, stress, history, given=None):
        found = super().tangent(strain, stress, history, given)
        stress[:] = found[0]
        return found


class Apart(DruckerPrager):
    def respond(self, strain, stress, history, given=None):
        new, history = super().respond(strain, stress, history, given)
        return 1.1 * new, history


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (InPlace(SOIL, 1.2, 0.3, 10e3), "InPlace changes the stress that it is given"),
        (Apart(SOIL, 1.2, 0.3, 10e3), "respond and tangent of Apart give different stresses"),
    ],
)
def test_a_law_that_is_not_what_it_says_is_refused(law, words):
    with pytest.raises(ValueError, match=words):
        mpm.MaterialPoints.fill(dense.uneven(2), law, 4)


@dataclass(frozen=True)
class Stiffening(mpm.Law):
    """Elastic, twice as stiff as its reference says, which its ``moduli`` know."""

    density, lame, history = 1800.0, (1e6, 1e6), ("plastic_work",)

    def moduli(self, stress, history, given=None):
        return 2e6, 2e6

    def tangent(self, strain, stress, history, given=None):
        dim = 2 if strain.shape[1] == 4 else 3
        D = np.tile(stiffness((2e6, 2e6), dim), (len(strain), 1, 1))
        return hooke((2e6, 2e6), strain, stress), history, D

    def yields(self, strain, stress, history, at, of, given=None):
        return np.zeros(0, np.int32)


@pytest.mark.parametrize("mapping", [None, mpm.MPM, mpm.DM_GC], ids=lambda m: str(m or "FE"))
def test_moduli_of_the_state_are_the_reference_of_points_and_no_matter_to_elements(mapping):
    grid = mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (2, 2))
    terms = [
        mpm.Fixed(grid.facets("left", "right"), "x"),
        mpm.Fixed(grid.facets("bottom"), "y"),
        mpm.Traction(grid.facets("top"), lambda t: (0.0, -3.0 * t)),
    ]
    if mapping is None:
        run = mpm.FiniteElements(grid, Stiffening(), mpm.QuasiStatic(2), terms)
    else:
        body = mpm.MaterialPoints.fill(grid, Stiffening(), 4)
        run = mpm.Simulation(grid, body, mpm.QuasiStatic(2), terms, mapping)
    run.until(1.0)
    run.settle()
    stress = run.stress(np.arange(4)) if mapping is None else run.bodies[0].stress
    np.testing.assert_allclose(stress[:, 1], -3.0, rtol=1e-5)
