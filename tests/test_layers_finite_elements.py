"""Several materials in finite elements: layers against exact answers, and against points."""

import re

from mpi4py import MPI

import dense
import inside
import numpy as np
import pytest

import mpm_fenicsx as mpm
from mpm_fenicsx.grid.cells import SIDES
from mpm_fenicsx.grid.partition import distribute
from mpm_fenicsx.response.cell_materials import CellMaterials

LOAD, G = 500.0, 9.81
STIFFLY = mpm.Solver(newton=mpm.Newton(tolerance=1e-12))
ENDS = {2: ("bottom", "top"), 3: ("back", "front")}
BOTH_WAYS = pytest.mark.parametrize("way", ["bodies", "regions"])
DIMS = pytest.mark.parametrize("dim", [2, 3])


def soils(number, contrast, law=mpm.LinearElastic):
    """Materials from the base up, of stiffnesses 1, contrast, 1, …; each with other ν and ρ."""
    return [
        law(20e6 * contrast ** (n % 2), 0.2 + 0.05 * n, 1500.0 + 100.0 * n) for n in range(number)
    ]


def pressed(law):
    """λ + 2μ (Pa)."""
    return law.lame[0] + 2 * law.lame[1]


class Layers:
    """A column of layers 0.4 m thick, of uneven cells; ``up`` the direction across the layers."""

    def __init__(self, laws, dim=2, up=None, cells=2, way="regions"):
        self.laws, self.dim, self.up = laws, dim, dim - 1 if up is None else up
        self.thick = np.full(len(laws), 0.4)
        self.edges = np.concatenate(([0.0], np.cumsum(self.thick)))
        share = np.linspace(0.0, 1.0, cells + 1)[1:] ** 1.3
        line = np.concatenate(([0.0], *(a + 0.4 * share for a in self.edges[:-1])))
        self.grid = mpm.Grid.rectilinear(
            [line if d == self.up else np.array([0.0, 0.3, 0.5]) for d in range(dim)]
        )
        ends = zip(self.edges[:-1], self.edges[1:], strict=True)
        where = [lambda x, a=a, b=b: (x[self.up] > a) & (x[self.up] < b) for a, b in ends]
        self.material = list(zip(laws, where, strict=True))
        if way == "bodies":
            self.material = [
                mpm.MaterialPoints.fill(self.grid, law, 2**dim, inside)
                for law, inside in self.material
            ]

    def surface(self, end):
        names = {place: name for name, place in SIDES.items()}
        return self.grid.facets(names[self.up, end])

    def rollers(self):
        """Smooth walls all around, and a base."""
        sides = {0: ("left", "right"), 1: ("bottom", "top"), 2: ("back", "front")}
        walls = [
            mpm.Fixed(self.grid.facets(*sides[d]), "xyz"[d])
            for d in range(self.dim)
            if d != self.up
        ]
        return [*walls, mpm.Fixed(self.surface(0), "xyz"[self.up])]

    def pushed(self, load):
        """A traction on top, ``load`` (Pa) or a function of t."""
        value = load if callable(load) else lambda t: load * t
        return mpm.Traction(self.surface(1), lambda t: -value(t) * np.eye(self.dim)[self.up])

    def run(self, stepping, terms, **keywords):
        return mpm.FiniteElements(self.grid, self.material, stepping, terms, **keywords)

    def heights(self):
        return self.grid.space.tabulate_dof_coordinates()[:, self.up]

    def profile(self, strains):
        """Nodal displacement (nodes,) of constant strains in the layers."""
        return np.interp(
            self.heights(), self.edges, np.concatenate(([0.0], np.cumsum(strains * self.thick)))
        )

    def across(self, run):
        """Stress across the layers (cells,) and the layer of each cell."""
        centre = 0.5 * (self.grid.lattice.lower + self.grid.lattice.upper)[:, self.up]
        return run.stress(np.arange(self.grid.cells))[:, self.up], np.searchsorted(
            self.edges, centre
        ) - 1

    def moved(self, run):
        return run.nodal("displacement")[:, self.up]


# -- elastic layers --------------------------------------------------------------------------------


@BOTH_WAYS
@pytest.mark.parametrize(("number", "contrast"), [(2, 1.0), (2, 3.0), (3, 100.0), (5, 1e4)])
@DIMS
def test_layers_under_a_load_bear_it_and_settle_exactly(dim, number, contrast, way):
    """σ = -p in each, u = Σ p h/(λ + 2μ): linear in each layer, which the elements have."""
    layers = Layers(soils(number, contrast), dim, way=way)
    run = layers.run(mpm.QuasiStatic(1), [*layers.rollers(), layers.pushed(LOAD)])
    run.step()
    np.testing.assert_allclose(layers.across(run)[0], -LOAD, rtol=1e-8)
    expected = layers.profile(np.array([-LOAD / pressed(law) for law in layers.laws]))
    np.testing.assert_allclose(layers.moved(run), expected, atol=1e-9 * np.abs(expected).max())
    assert run.balance()[1] < 1e-10


@pytest.mark.parametrize("b_bar", [False, True])
@pytest.mark.parametrize("contrast", [3.0, 1e4])
@DIMS
def test_columns_side_by_side_share_a_uniform_strain(dim, contrast, b_bar):
    """ε_z the same in all; along x one stress S = M ε_i + λ_i ε_z with Σ h_i ε_i = 0."""
    layers = Layers(soils(3, contrast), dim, up=0)
    ε, along = -1e-4, dim - 1
    base, top = (layers.grid.facets(name) for name in ENDS[dim])
    sides = [mpm.Fixed(layers.grid.facets("bottom", "top"), "y")] if dim == 3 else []
    run = layers.run(
        mpm.QuasiStatic(1),
        [
            mpm.Fixed(layers.grid.facets("left", "right"), "x"),
            *sides,
            mpm.Fixed(base, "xyz"[along]),
            mpm.Fixed(top, "xyz"[along], lambda t: ε * 0.5 * t),
        ],
        b_bar=b_bar,
    )
    run.step()
    M, λ = (
        np.array(v)
        for v in ([pressed(law) for law in layers.laws], [law.lame[0] for law in layers.laws])
    )
    S = ε * (λ / M).sum() / (1 / M).sum()
    strains = (S - λ * ε) / M
    u = run.nodal("displacement")
    np.testing.assert_allclose(u[:, 0], layers.profile(strains), atol=1e-9 * np.abs(strains).max())
    np.testing.assert_allclose(
        u[:, along], ε * layers.grid.space.tabulate_dof_coordinates()[:, along], atol=1e-13
    )
    stress, of = run.stress(np.arange(layers.grid.cells)), layers.across(run)[1]
    np.testing.assert_allclose(stress[:, 0], S, rtol=1e-8)
    np.testing.assert_allclose(stress[:, along], (M * ε + λ * strains)[of], rtol=1e-8)
    volume = layers.grid.lattice.volume
    assert run.energy()["strain"] == pytest.approx(0.5 * ε * volume @ stress[:, along], rel=1e-10)


@BOTH_WAYS
@DIMS
def test_the_weight_of_layers_is_that_of_each(dim, way):
    """M u'' = ρ g: nodal u exact in 1D, stress at cell centres, Σ ρ g h at the base."""
    layers = Layers(soils(3, 10.0), dim, way=way)
    gravity = (
        mpm.Gravity(lambda t, x: np.broadcast_to(-G * np.eye(dim)[-1], x.shape))
        if way == "regions"
        else mpm.Gravity(tuple(-G * np.eye(dim)[-1]))
    )
    run = layers.run(mpm.QuasiStatic(1), [*layers.rollers(), gravity])
    run.step()
    ρ, M = (
        np.array(v)
        for v in ([law.density for law in layers.laws], [pressed(law) for law in layers.laws])
    )
    below = np.concatenate(([0.0], np.cumsum(ρ * G * layers.thick)))  # weight up to each edge
    total = below[-1]

    def settled(z):
        n = (
            min(int(np.searchsorted(layers.edges, z - 1e-9, side="right")) - 1, len(ρ) - 1)
            if z > 0
            else 0
        )
        u = 0.0
        for i in range(n + 1):
            h = min(z - layers.edges[i], layers.thick[i])
            u -= ((total - below[i]) * h - ρ[i] * G * h**2 / 2) / M[i]
        return u

    expected = np.array([settled(z) for z in layers.heights()])
    np.testing.assert_allclose(layers.moved(run), expected, atol=1e-9 * np.abs(expected).max())
    centre = 0.5 * (layers.grid.lattice.lower + layers.grid.lattice.upper)[:, -1]
    np.testing.assert_allclose(
        layers.across(run)[0], np.interp(centre, layers.edges, below) - total, rtol=1e-8
    )
    area = 0.5 ** (dim - 1)
    assert run.balance()[0].reshape(-1, dim)[:, -1].sum() == pytest.approx(total * area, rel=1e-10)


def test_a_distorted_mesh_of_layers_bears_the_load_as_well():
    """Bilinear elements have what is linear in each layer, on a mesh that follows the interface."""
    x = np.array(
        [
            [0, 0],
            [0.4, 0],
            [1, 0],
            [0, 0.3],
            [0.6, 0.55],
            [1, 0.4],
            [0, 1],
            [0.35, 1],
            [1, 1],
            [0, 1.7],
            [0.55, 1.4],
            [1, 1.6],
            [0, 2],
            [0.5, 2],
            [1, 2],
        ]
    )
    cells = np.array(
        [
            [3 * j + i, 3 * j + i + 1, 3 * j + i + 3, 3 * j + i + 4]
            for j in range(4)
            for i in range(2)
        ]
    )
    grid = mpm.Grid(distribute(MPI.COMM_WORLD, x, cells))
    soft, stiff = soils(2, 50.0)
    run = mpm.FiniteElements(
        grid,
        [(soft, lambda x: x[1] < 1.0), (stiff, lambda x: x[1] > 1.0)],
        mpm.QuasiStatic(1),
        [
            mpm.Fixed(grid.facets("left", "right"), "x"),
            mpm.Fixed(grid.facets("bottom"), "y"),
            mpm.Traction(grid.facets("top"), (0.0, -LOAD)),
        ],
    )
    run.step()
    assert np.abs(run.stress(np.arange(8))[:, 1] + LOAD).max() < 1e-8 * LOAD
    y = grid.space.tabulate_dof_coordinates()[:, 1]
    expected = -LOAD * (
        np.minimum(y, 1.0) / pressed(soft) + np.maximum(y - 1.0, 0.0) / pressed(stiff)
    )
    np.testing.assert_allclose(
        run.nodal("displacement")[:, 1], expected, atol=1e-9 * LOAD / pressed(soft)
    )


def reflected(lower, cells):
    """Errors of the stress, of p, in the upper and the lower layer after a pulse has passed."""
    upper, T = mpm.LinearElastic(20e6, 0.25, 1500.0), 0.04
    length = 5.0
    h = length / cells
    grid = mpm.Grid.box((0, 0), (h, 2 * length), (1, 2 * cells))
    c1, c2 = upper.p_speed, lower.p_speed
    Z1, Z2 = 1500.0 * c1, lower.density * c2
    back = (Z2 - Z1) / (Z2 + Z1)

    def p(t):
        return LOAD * np.where((t > 0) & (t < T), np.sin(np.pi * t / T) ** 2, 0.0)

    layers = [(upper, lambda x: x[1] > length), (lower, lambda x: x[1] < length)]
    run = mpm.FiniteElements(
        grid,
        layers,
        mpm.Newmark(0.2 * h / c1),
        [
            mpm.Fixed(grid.facets("left", "right"), "x"),
            mpm.ViscousBoundary(grid.facets("bottom"), lower),
            mpm.Traction(grid.facets("top"), lambda t: (0.0, -p(t))),
        ],
    )
    probes = [run.record(mpm.Probe("stress", (h / 2, y))) for y in (length + 1.0, length - 1.0)]
    run.until(round(2 * length / c1 / run.stepping.dt) * run.stepping.dt)
    t = probes[0].times
    above = -p(t - 4.0 / c1) - back * p(t - 6.0 / c1)
    below = -(1 + back) * p(t - 5.0 / c1 - 1.0 / c2)
    return [
        np.sqrt(((probe.values[:, 1] - exact) ** 2).sum() / (p(t) ** 2).sum())
        for probe, exact in zip(probes, (above, below), strict=True)
    ]


@pytest.mark.parametrize(
    "lower",
    [mpm.LinearElastic(180e6, 0.25, 1500.0), mpm.LinearElastic(5e6, 0.3, 1200.0)],
    ids=["stiffer", "softer"],
)
def test_a_pulse_is_reflected_by_the_impedances(lower):
    """d'Alembert: of the stress (Z₂ - Z₁)/(Z₂ + Z₁) comes back, and 2 Z₂/(Z₂ + Z₁) goes on."""
    coarse, fine = (reflected(lower, cells) for cells in (20, 40))
    for before, after in zip(coarse, fine, strict=True):
        assert after < 0.02 and after < 0.4 * before


# -- layers that yield -----------------------------------------------------------------------------


def strength(law):
    """Axial stress (Pa) of yield in uniaxial strain: q = σ (1 - 2ν)/(1 - ν) = √3 c."""
    return np.sqrt(3) * law.peak * (1 - law.poisson) / (1 - 2 * law.poisson)


def perfect(elastic, cohesion, **more):
    return mpm.VonMises(elastic, peak=cohesion, residual=cohesion, softening=0.0, **more)


@pytest.mark.parametrize("b_bar", [False, True])
@DIMS
def test_a_layer_that_yields_between_others_flows_alone(dim, b_bar):
    """Perfectly plastic in uniaxial strain: dσ = K dε beyond, κ = (2μ ε - √3 c)/3μ."""
    a, b, c = soils(3, 4.0)
    laws = [a, perfect(b, 10e3, length=0.1), perfect(c, 30e3)]
    layers = Layers(laws, dim)
    limit = strength(laws[1]), strength(laws[2])
    assert limit[0] < 0.5 * limit[1]
    for load in (0.999 * limit[0], 1.5 * limit[0], 1.2 * limit[1]):
        run = layers.run(
            mpm.QuasiStatic(3),
            [*layers.rollers(), layers.pushed(load)],
            solver=STIFFLY,
            b_bar=b_bar,
        )
        run.until(1.0)
        stress, of = layers.across(run)
        np.testing.assert_allclose(stress, -load, rtol=1e-8)
        κ = run.gauss_history().reshape(len(of), -1)
        strains, work = [-load / pressed(a)], 0.0
        assert not κ[of == 0].any()
        for n, (law, most) in enumerate(zip(laws[1:], limit, strict=True), start=1):
            μ, K = law.lame[1], law.lame[0] + 2 * law.lame[1] / 3
            ε = load / pressed(law) if load < most else most / pressed(law) + (load - most) / K
            flow = max(0.0, (2 * μ * ε - np.sqrt(3) * law.peak) / (3 * μ))
            assert (flow > 0.0) == (load > most)
            np.testing.assert_allclose(κ[of == n], flow, atol=1e-11)
            strains.append(-ε)
            work += np.sqrt(3) * law.peak * flow * 0.4 * 0.5 ** (dim - 1)
        expected = layers.profile(np.array(strains))
        np.testing.assert_allclose(layers.moved(run), expected, atol=1e-8 * np.abs(expected).max())
        assert run.energy()["plastic"] == pytest.approx(work, rel=1e-8, abs=1e-9)


def test_a_law_that_softens_by_its_cell_looks_at_its_own_cells_alone():
    """In large cells it would snap back.  Beyond yield dq = -√3 h dκ and dσ = K dε + ⅔ dq."""
    law = mpm.VonMises(
        mpm.LinearElastic(20e6, 0.3, 1500.0), peak=10e3, residual=1e3, softening=6e6, length=0.1
    )
    grid = mpm.Grid.rectilinear([np.array([0.0, 0.1]), np.array([0.0, 1.0, 1.1, 1.2, 1.3])])
    below = mpm.LinearElastic(50e6, 0.2, 1800.0)
    with pytest.raises(ValueError, match="where a point snaps back"):
        law.modulus({"size": np.sqrt(0.1)})
    load = 1.05 * strength(law)
    run = mpm.FiniteElements(
        grid,
        [(below, lambda x: x[1] < 1.0), (law, lambda x: x[1] > 1.0)],
        mpm.QuasiStatic(4),
        [
            mpm.Fixed(grid.facets("left", "right"), "x"),
            mpm.Fixed(grid.facets("bottom")),
            mpm.Traction(grid.facets("top"), lambda t: (0.0, -load * t)),
        ],
        solver=STIFFLY,
    )
    run.until(1.0)
    μ, h = law.lame[1], law.softening
    K, soft = law.lame[0] + 2 * μ / 3, 2 * np.sqrt(3) * h * μ / (3 * μ - np.sqrt(3) * h)
    ε = strength(law) / pressed(law) + (load - strength(law)) / (K - 2 / 3 * soft)
    u = run.nodal("displacement")[:, 1].min()
    assert u == pytest.approx(-load / pressed(below) - 0.3 * ε, rel=1e-8)
    κ = (2 * μ * ε - np.sqrt(3) * law.peak) / (3 * μ - np.sqrt(3) * h)
    assert 0.0 < h * κ < law.peak - law.residual
    of = np.repeat(run.materials.number, 4)
    np.testing.assert_allclose(run.gauss_history()[of == 1], κ, rtol=1e-7)
    assert not run.gauss_history()[of == 0].any()


# -- finite strain ---------------------------------------------------------------------------------


def stretched(law, load):
    """Stretch λ of a Hencky layer between smooth walls: M ln λ / λ = -load."""
    λ = 1.0
    for _ in range(100):
        λ -= (pressed(law) * np.log(λ) + load * λ) / (pressed(law) / λ + load)
    return λ


@BOTH_WAYS
@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.validation)])
def test_hencky_layers_take_their_stretches_beside_one_of_small_strain(dim, way):
    laws = [*soils(2, 3.0, mpm.Hencky), mpm.LinearElastic(30e6, 0.3, 1500.0)]
    layers, load = Layers(laws, dim, way=way), 7e6
    run = layers.run(mpm.QuasiStatic(6), [*layers.rollers(), layers.pushed(load)], solver=STIFFLY)
    run.until(1.0)
    λ = np.array([stretched(law, load) for law in laws[:2]])
    assert λ[0] < 0.8
    strains = np.array([*(λ - 1.0), -load / pressed(laws[2])])
    np.testing.assert_allclose(layers.moved(run), layers.profile(strains), atol=1e-8)
    np.testing.assert_allclose(layers.across(run)[0], -load, rtol=1e-8)  # τ/J on the area at rest
    energy = [0.5 * pressed(law) * np.log(s) ** 2 for law, s in zip(laws, λ, strict=False)]
    energy.append(0.5 * load**2 / pressed(laws[2]))
    assert run.energy()["strain"] == pytest.approx(0.4 * 0.5 ** (dim - 1) * sum(energy), rel=1e-8)


def test_finite_plastic_layers_flow_as_each_alone():
    """Uniaxial stress paths are the same in a layer and in a column of it alone."""
    laws = [
        mpm.VonMises(mpm.Hencky(20e6, 0.2, 1500.0), 60e3, 60e3, 0.0),
        mpm.Hencky(40e6, 0.3, 1600.0),
        mpm.VonMises(mpm.Hencky(30e6, 0.25, 1500.0), 200e3, 100e3, 50e3),
    ]
    moved = []
    for chosen in (laws, *([law] for law in laws)):
        layers = Layers(chosen)
        run = layers.run(
            mpm.QuasiStatic(10), [*layers.rollers(), layers.pushed(1.5e6)], solver=STIFFLY
        )
        run.until(1.0)
        moved.append(layers.moved(run).min())
        if len(chosen) > 1:
            assert set(run.energy()) == {"strain", "plastic"}
    assert moved[0] == pytest.approx(sum(moved[1:]), rel=1e-9)


@pytest.mark.parametrize("law", [mpm.LinearElastic, mpm.Hencky])
def test_layers_with_forces_balanced_inside_the_step_come_to_rest_exactly(law):
    """Forces at the start of a step count once in every cell, of small or finite strain."""
    laws = [
        *soils(2, 4.0, law),
        mpm.LinearElastic(30e6, 0.3, 1500.0),
        perfect(law(20e6, 0.2, 1500.0), 1e7),
    ]
    laws = laws[:3] if law is mpm.Hencky else laws
    layers = Layers(laws)
    ρ = 0.5
    run = layers.run(
        mpm.GeneralizedAlpha(0.5, spectral_radius=ρ, start=ρ),
        [*layers.rollers(), layers.pushed(lambda t: 3e5 * min(t, 1.0))],
        solver=mpm.Solver(newton=mpm.Newton(tolerance=1e-13)),
    )
    run.until(40.0)
    expected = [
        stretched(one, 3e5) - 1.0 if isinstance(one, mpm.Hencky) else -3e5 / pressed(one)
        for one in laws
    ]
    np.testing.assert_allclose(layers.moved(run), layers.profile(np.array(expected)), atol=1e-7)
    np.testing.assert_allclose(layers.across(run)[0], -3e5, rtol=1e-6)


# -- the same as -----------------------------------------------------------------------------------


def test_equal_materials_are_one_and_cost_what_one_costs():
    soil = dense.SOIL
    layers = Layers([soil, mpm.LinearElastic(soil.young, soil.poisson, soil.density)], way="bodies")
    terms = [*layers.rollers(), layers.pushed(LOAD), mpm.Gravity((0.0, -G))]
    runs = [
        layers.run(mpm.QuasiStatic(1), terms),
        mpm.FiniteElements(layers.grid, soil, mpm.QuasiStatic(1), terms),
        mpm.FiniteElements(
            layers.grid, mpm.MaterialPoints.fill(layers.grid, soil, 4), mpm.QuasiStatic(1), terms
        ),
    ]
    for run in runs:
        run.step()
    for run in runs:
        assert run.material == soil and inside.bill(run).density == "Constant"
        assert np.array_equal(run.displacement.x.array, runs[1].displacement.x.array)
        assert run.identity() == runs[1].identity()


@pytest.mark.parametrize("elastic", [mpm.LinearElastic, mpm.Hencky])
def test_laws_that_differ_by_round_off_are_as_one(elastic):
    """Rows put together by material are those of all at once."""
    kind, other = (
        mpm.VonMises(elastic(20e6, 0.25, 1500.0), peak, 4e3, 50e3)
        for peak in (10e3, 10e3 * (1 + 4e-16))
    )
    assert other != kind
    grid, found = dense.uneven(2), []
    for material in (kind, [(kind, lambda x: x[0] < 0.3), (other, lambda x: x[0] > 0.3)]):
        run = mpm.FiniteElements(
            grid,
            material,
            mpm.Newmark(0.02),
            [
                mpm.Fixed(grid.facets("bottom")),
                mpm.Traction(grid.facets("top"), lambda t: (2e5 * t, -4e5 * t)),
            ],
            solver=STIFFLY,
        )
        energy = run.record(mpm.Energy())
        run.until(0.1)
        found.append(
            (run.displacement.x.array, run.gauss_stress(), run.gauss_history(), energy.values)
        )
    assert found[0][2].max() > 1e-4
    for one, several in zip(*found, strict=True):
        np.testing.assert_allclose(several, one, rtol=1e-7, atol=1e-9 * np.abs(one).max())


@pytest.mark.parametrize("mapping", [mpm.GIMP, mpm.DM_G], ids=str)
def test_points_and_elements_of_two_layers_agree(mapping):
    """A strip load on a soft layer over a stiff one: nothing but the class is changed."""
    soft, stiff = mpm.LinearElastic(20e6, 0.3, 1500.0), mpm.LinearElastic(80e6, 0.2, 1800.0)
    for n, near in ((8, 5e-3), (16, 1.5e-3)):
        grid = mpm.Grid.box(
            (0, 0), (1, 1), (n, n), {"strip": lambda x: (x[1] > 0.999) & (x[0] < 0.51)}
        )
        bodies = [
            mpm.MaterialPoints.fill(grid, soft, 4, lambda x: x[1] > 0.5),
            mpm.MaterialPoints.fill(grid, stiff, 4, lambda x: x[1] < 0.5),
        ]
        scene = (
            grid,
            bodies,
            mpm.QuasiStatic(1),
            [
                mpm.Fixed(grid.facets("left", "right"), "x"),
                mpm.Fixed(grid.facets("bottom")),
                mpm.Gravity((0.0, -G)),
                mpm.Traction(grid.facets("strip"), (0.0, -1e3)),
            ],
        )
        found = []
        for run in (mpm.FiniteElements(*scene), mpm.Simulation(*scene, mapping)):
            probes = [run.record(mpm.Probe("displacement", (0.25, y))) for y in (0.9, 0.3)]
            stress = run.record(mpm.Probe("stress", (0.25, 0.3)))
            run.step()
            found.append(
                (np.array([probe.values[-1, 1] for probe in probes]), stress.values[-1, 1])
            )
        np.testing.assert_allclose(found[1][0], found[0][0], rtol=near)
        assert found[1][1] == pytest.approx(found[0][1], rel=0.03)


# -- what recorders, checkpoints and start= know ---------------------------------------------------


def yielding_layers(way="regions", turned=False):
    laws = [mpm.LinearElastic(40e6, 0.2, 1800.0), mpm.VonMises(dense.SOIL, 4e3, 2e3, 50e3)]
    layers = Layers(laws[::-1] if turned else laws, way=way)
    return layers, [
        mpm.Fixed(layers.grid.facets("bottom")),
        mpm.Traction(layers.grid.facets("top"), lambda t: (5e3, -1e3 * t / 0.1)),
    ]


def test_a_checkpoint_knows_which_cells_are_of_what(tmp_path):
    layers, terms = yielding_layers()
    run = layers.run(mpm.Newmark(5e-3), terms)
    run.record(mpm.Checkpoint(tmp_path / "state.npz", every=10))
    run.until(0.05)
    same, terms = yielding_layers("bodies")
    again = same.run(mpm.Newmark(5e-3), terms)
    again.restart(tmp_path / "state.npz")
    run.until(0.08)
    again.until(0.08)
    assert run.gauss_history().max() > 0.0
    for name, value in run.state().items():
        assert np.array_equal(value, again.state()[name]), name
    other, terms = yielding_layers(turned=True)
    with pytest.raises(
        ValueError,
        match=r"material is LinearElastic\(.*\) in 4 cells, VonMises.* and here VonMises",
    ):
        other.run(mpm.Newmark(5e-3), terms).restart(tmp_path / "state.npz")


def test_layers_that_have_yielded_go_on_as_they_are():
    """Two halves are the whole, bit for bit: stress, history, elastic stress, motion."""
    layers, _ = yielding_layers("bodies")
    push = [
        mpm.Fixed(layers.grid.facets("bottom")),
        mpm.Traction(layers.grid.facets("top"), (8e3, -4e3)),
    ]
    whole = layers.run(mpm.Newmark(5e-3), push)
    whole.until(0.05)
    first = yielding_layers("bodies")[0]
    half = layers.run(mpm.Newmark(5e-3), push)
    half.until(0.025)
    for material in (half.material, layers.material, [*layers.material][::-1]):
        rest = mpm.FiniteElements(layers.grid, material, mpm.Newmark(5e-3), push, start=half)
        rest.until(0.025)
        assert whole.gauss_history().max() > 1e-4
        for name, value in whole.state().items():
            assert np.array_equal(rest.state()[name], value), name
    with pytest.raises(ValueError, match="same grid, of the same material in every cell"):
        mpm.FiniteElements(layers.grid, dense.SOIL, mpm.Newmark(5e-3), push, start=half)
    with pytest.raises(ValueError, match="these materials belong to the cells of another grid"):
        mpm.FiniteElements(first.grid, half.material, mpm.Newmark(5e-3), [])


def test_snapshots_show_the_materials(tmp_path):
    layers = Layers(soils(2, 3.0))
    run = layers.run(mpm.QuasiStatic(1), layers.rollers())
    run.record(mpm.Snapshots(tmp_path / "layers"))
    import meshio

    shown = meshio.read(
        next(tmp_path.glob("*grid_000000.vtu"), None) or sorted(tmp_path.glob("*000000.vtu"))[0]
    )
    assert sorted(shown.cell_data["material"][0].ravel()) == sorted(run.materials.number)


# -- refusals --------------------------------------------------------------------------------------


A, B = soils(2, 3.0)


def fill(grid, law, low, high, **keywords):
    return mpm.MaterialPoints.fill(grid, law, 4, lambda x: (x[1] > low) & (x[1] < high), **keywords)


def with_field(body, name, value):
    setattr(body, name, np.full_like(body.stress if name == "stress" else body.x, value))
    return body


REFUSED = [
    (lambda g: mpm.LinearElastic, "got the class LinearElastic itself: call it with its numbers"),
    (lambda g: "clay", "got 'clay'"),
    (lambda g: None, "got None"),
    (lambda g: [], r"got \[\]"),
    (lambda g: [A, B], r"or pairs \(material, where\) .* got \[LinearElastic\(young=20"),
    (lambda g: (A, lambda x: x[0] > 0), r"pairs \(material, where\)"),
    (lambda g: [fill(g, A, 0, 1), B], r"got \[a body of LinearElastic\(.*\), LinearElastic"),
    (
        lambda g: fill(g, A, 0, 0.5),
        r"cell \d+ with its centre at x=\[0.125 0.625\] holds no material points.* empty",
    ),
    (
        lambda g: [fill(g, A, 0, 0.6), fill(g, B, 0.6, 1)],
        r"cell \d+ with .* points of bodies 0 and 1",
    ),
    (
        lambda g: [fill(g, A, 0, 0.5), fill(g, B, 0.5, 0.85)],
        r"bodies fill 0.5 of cell \d+ with .*\[0.125 0.875\]",
    ),
    (lambda g: [with_field(fill(g, A, 0, 1), "stress", 1.0)], "stress of body 0 is not zero"),
    (
        lambda g: [fill(g, A, 0, 0.5), with_field(fill(g, B, 0.5, 1), "velocity", 1.0)],
        "velocity of body 1 .*at rest",
    ),
    (
        lambda g: [(A, lambda x: x[1] < 0.5)],
        r"cell \d+ with its centre at x=\[0.125 0.625\] lies in no region",
    ),
    (
        lambda g: [(A, lambda x: x[1] < 0.6), (B, lambda x: x[1] > 0.3)],
        r"cell \d+ .* lies in the regions \[0, 1\]",
    ),
    (
        lambda g: [(A, lambda x: x[1] < 9), (B, lambda x: x[1] > 9)],
        "region 1 holds the centre of no cell",
    ),
    (lambda g: [(A, lambda x: True)], r"where must map \(dim, n\) to \(n,\), gave \(\) for n=16"),
    (
        lambda g: [
            (mpm.Hencky(1e6, 0.2, 1e3), lambda x: x[1] < 0.5),
            (perfect(A, 1e3), lambda x: x[1] > 0.5),
        ],
        "yields at small strain cannot share a run with one of finite strain, got VonMises",
    ),
]


@pytest.mark.parametrize(("make", "message"), REFUSED, ids=range(len(REFUSED)))
def test_what_is_no_material_of_each_cell_is_refused(make, message):
    grid = mpm.Grid.box((0, 0), (1, 1), (4, 4))
    with pytest.raises(ValueError, match=message) as caught:
        mpm.FiniteElements(grid, make(grid), mpm.QuasiStatic(1), [])
    assert re.match("material|where|stress", str(caught.value))


def test_what_is_doubtful_is_said():
    grid = mpm.Grid.box((0, 0), (1, 1), (4, 4))
    with pytest.warns(
        UserWarning, match=r"edges of regions cut 4 cells, one with its centre at x=\[0.125 0.625\]"
    ):
        mpm.FiniteElements(
            grid, [(A, lambda x: x[1] < 0.6), (B, lambda x: x[1] >= 0.6)], mpm.QuasiStatic(1), []
        )
    by_hand = mpm.MaterialPoints(
        A, fill(grid, A, 0, 1).x, np.full((64, 2), 0.05), np.full(64, 0.01)
    )
    with pytest.warns(
        UserWarning, match=r"bodies fill 0.64 of cell 0 .* finite elements all of it"
    ):
        mpm.FiniteElements(grid, by_hand, mpm.QuasiStatic(1), [])


def test_jitter_and_domains_across_grid_lines_fill_the_cells_all_the_same():
    grid, rng = dense.uneven(2), np.random.default_rng(3)
    jittered = [
        mpm.MaterialPoints.fill(grid, law, 9, where, jitter=0.4, seed=4)
        for law, where in ((A, lambda x: x[0] < 0.3), (B, lambda x: x[0] > 0.3))
    ]
    assert np.bincount(CellMaterials.of(grid, jittered).number).tolist() == [3, 6]
    assert CellMaterials.of(grid, dense.tiles(grid, rng, material=A)).one == A
