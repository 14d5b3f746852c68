"""Contact: bodies push one another, never pull, and share momentum without loss."""

from itertools import combinations

import inside
import numpy as np
import pytest
from hats import LINES

import mpm_fenicsx as mpm
from mpm_fenicsx.common.errors import SolverError
from mpm_fenicsx.contact.complementarity import complementary

H = 0.25
SOIL = mpm.LinearElastic(young=20e6, poisson=0.0, density=1500.0)
C = SOIL.p_speed


def bars(
    mapping=mpm.DM_GC,
    n=(10, 10),
    gap=0.0,
    velocities=(0.5e-3, -0.5e-3),
    courant=0.5,
    places=0.0,
    soils=(SOIL, SOIL),
    stepping=None,
):
    """Two bars of ``n`` cells on a line, ``gap`` cells apart, at ``velocities`` (c), ``places``
    cells off the lines."""
    cells = sum(n) + 8
    grid = mpm.Grid.box((0, 0), (cells * H, H), (cells, 1))
    stepping = stepping or mpm.Newmark(courant * H / C)
    runs = []
    for k, start in ((0, 3), (1, 4 + n[0])):
        body = mpm.MaterialPoints.fill(
            grid,
            soils[k],
            4,
            inside=lambda x, a=start, k=k: (x[0] > a * H) & (x[0] < (a + n[k]) * H),
        )
        body.x[:, 0] += (places + k * (gap - 1)) * H
        body.velocity = np.tile([velocities[k] * C, 0.0], (len(body), 1))
        runs.append(
            mpm.Simulation(
                grid, body, stepping, [mpm.Fixed(grid.facets("bottom", "top"), "y")], mapping
            )
        )
    left, right = runs
    return mpm.Contact(
        (left, left.bodies[0].surface("right")), (right, right.bodies[0].surface("left"))
    )


def momentum(run):
    return sum(body.mass @ body.velocity for body in run.bodies)


def mean(body):
    return body.mass @ body.velocity / body.mass.sum()


def follow(run, travel, n):
    """Forces on the first body, momenta and energies after each step, for ``travel`` times n
    H/c."""
    found = []
    while run.time < travel * n * H / C:
        run.step()
        found.append((run.forces[0, 0], *momentum(run), sum(run.energy().values())))
    return np.array(found)


# -- forces that only push -------------------------------------------------------------------------


def by_enumeration(S, g):
    """The active set that fits, of all there are."""
    for size in range(len(g) + 1):
        for active in map(list, combinations(range(len(g)), size)):
            λ = np.zeros(len(g))
            if active:
                λ[active] = np.linalg.solve(S[np.ix_(active, active)], -g[active])
            if (λ >= 0).all() and (S @ λ + g >= -1e-12).all():
                return λ
    raise AssertionError


@pytest.mark.parametrize("seed", range(20))
def test_complementarity_by_trying_all_active_sets(seed):
    rng = np.random.default_rng(seed)
    n = rng.integers(1, 8)
    B, g = rng.normal(size=(n, n + 2)), rng.normal(size=n)
    S = B @ B.T
    λ = complementary(lambda x: S @ x, g, np.maximum(rng.normal(size=n), 0.0), 1e-11)
    assert λ == pytest.approx(by_enumeration(S, g), abs=1e-7 * np.linalg.cond(S))


@pytest.mark.parametrize("seed", range(10))
def test_rows_that_say_the_same_do_no_harm(seed):
    rng = np.random.default_rng(seed)
    B = rng.normal(size=(4, 6))
    S, g = np.tile(B @ B.T, (3, 3)), np.tile(rng.normal(size=4), 3)
    λ = complementary(lambda x: S @ x, g, np.zeros(12), 1e-10)
    rest = S @ λ + g
    assert λ.min() >= 0.0 and rest.min() > -1e-9 and np.abs(λ * rest).max() < 1e-8


def test_gaps_that_no_force_opens_are_refused():
    with pytest.raises(SolverError, match="no force opens the gaps"):
        complementary(lambda x: 0.0 * x, np.array([1.0, -1.0]), np.zeros(2), 1e-10)


def faced(dim, seed=0):
    """Two blocks on an uneven grid off the origin, a tenth of a face apart, and their contact."""
    grid = mpm.Grid.rectilinear([np.array(line) for line in LINES[dim]])
    x = LINES[dim][0]
    split = x[2]
    rng = np.random.default_rng(seed)
    runs = []
    for k in range(2):
        body = mpm.MaterialPoints.fill(
            grid, SOIL, 2**dim, inside=lambda y, k=k: (y[0] < split) == (k == 0)
        )
        body.half[:, 0] *= 1.0 - 0.1 * k
        runs.append(mpm.Simulation(grid, body, mpm.Newmark(1e-3), []))
    run = mpm.Contact(
        (runs[0], runs[0].bodies[0].surface("right")), (runs[1], runs[1].bodies[0].surface("left"))
    )
    run.attempt(0.0, 1e-3, run.stepping)
    return run, grid, rng


@pytest.mark.parametrize("dim", [2, 3])
def test_force_and_back_force_are_one_line(dim):
    """Resultant and moment of the nodal forces vanish; gaps are those of flat faces, and open as
    rigid motion says."""
    run, grid, rng = faced(dim)
    gaps, place = inside.gaps(run), grid.space.tabulate_dof_coordinates()[:, :dim]
    nearest = run.bodies[1]
    exact = np.unique(np.round((nearest.half / 0.9 * 0.1)[nearest.exposed[:, 0, 0], 0], 12))
    assert gaps.start == pytest.approx(np.full(len(gaps.start), exact[0]))
    force, back = gaps.forces(rng.uniform(size=len(gaps.start)))
    assert np.abs(force).max() > 0.01
    assert force.sum(axis=0) == pytest.approx(-back.sum(axis=0), abs=1e-12)
    moment = np.einsum("ni,nj->ij", place, force + back)
    assert moment[0, 1:] == pytest.approx(moment[1:, 0], abs=1e-12)
    u = [np.tile(rng.normal(size=dim), (grid.nodes, 1)) for _ in range(2)]
    assert gaps.opening(u) == pytest.approx(np.full(len(gaps.start), (u[1] - u[0])[0, 0]))
    λ = rng.uniform(size=len(gaps.start))  # forces are the transpose of opening
    v = [rng.normal(size=(grid.nodes, dim)) for _ in range(2)]
    assert gaps.opening(v) @ λ == pytest.approx(
        sum((f * x).sum() for f, x in zip(gaps.forces(λ), v, strict=True))
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_a_uniform_pressure_is_among_the_forces(dim):
    """Rows λ_i = p Σ_f T_i A_f press every point with p A_f."""
    run, _, _ = faced(dim)
    pair = inside.touching(run)
    area = pair.points.points.area
    pair.keep(pair._hats @ area[pair.near])
    assert pair.force == pytest.approx(area)


def test_only_faces_that_look_at_one_another():
    """Of all sides of a thin plate and a block, those between them; what lies beside the other's
    faces is left out."""
    grid = mpm.Grid.box((0, 0), (6 * H, 6 * H), (6, 6))
    plate = mpm.MaterialPoints.fill(
        grid, SOIL, 16, inside=lambda x: (np.abs(x[0] - 2.9 * H) < 0.1 * H) & (x[1] > H)
    )
    block = mpm.MaterialPoints.fill(grid, SOIL, 4, inside=lambda x: (x[0] > 3 * H) & (x[1] < 4 * H))
    runs = [mpm.Simulation(grid, body, mpm.Newmark(1e-3), []) for body in (plate, block)]
    sides = "left", "right", "bottom", "top"
    run = mpm.Contact(*((one, one.bodies[0].surface(*sides)) for one in runs))
    pair = inside.touching(run)
    own = pair.points.points
    assert (own.normal[pair.near] == [1.0, 0.0]).all() and (pair.normal == [-1.0, 0.0]).all()
    facing = (own.normal[:, 0] == 1.0) & (own.x[:, 1] < 4 * H)
    assert np.array_equal(pair.near, np.flatnonzero(facing))
    assert pair.gap == pytest.approx(np.zeros(len(pair.gap)), abs=1e-12)


# -- bars ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("places", [0.0, 0.2, 0.37])  # 0.2: an edge in a cell without points
@pytest.mark.parametrize("mapping", [mpm.MPM, mpm.GIMP, mpm.DM_GC], ids=str)
def test_equal_bars_exchange_velocities(mapping, places):
    """d'Alembert: stress −ρ c v for 2L/c, then the bars have exchanged velocities; n = 10 cells a
    bar.

    The nodes at the contact, 1/2n of a bar, meet inelastically: of the velocity exchanged as much
    may be lost.
    """
    n = 10
    run = bars(mapping, (n, n), places=places)
    p0, mass = momentum(run), sum(body.mass.sum() for body in run.bodies)
    E0, v = sum(run.energy().values()), 0.5e-3 * C
    found = follow(run, 2.5, n)
    force, energy = found[:, 0], found[:, 3]
    assert np.abs(found[:, 1:3] - p0).max() < 1e-13 * mass * v
    assert (force <= 0.0).all()  # on the left bar, to the left: it is never pulled
    t = run.stepping.dt * np.arange(1, len(force) + 1) * C / (n * H)
    assert force[t > 2.15].max(initial=0.0) == force[t > 2.15].min(initial=0.0) == 0.0
    assert (force[t < 1.9] != 0.0).mean() > 0.9
    impulse = -force.sum() * run.stepping.dt
    assert impulse == pytest.approx(2 * run.bodies[0].mass.sum() * v, rel=1.0 / n)
    velocities = [mean(body)[0] / v for body in run.bodies]
    assert velocities == pytest.approx([-1.0, 1.0], abs=1.0 / n)
    assert energy.max() < 1.05 * E0 and energy[-1] < E0


def test_force_is_what_changes_momentum():
    """Whatever the rule: impulse is what a body has got in the end."""
    for stepping in (
        mpm.Newmark(0.5 * H / C),
        mpm.GeneralizedAlpha(0.7 * H / C, spectral_radius=0.5),
        mpm.GeneralizedAlpha(0.7 * H / C, spectral_radius=0.5, start=0.4),
    ):
        run = bars(n=(4, 4), stepping=stepping)
        left = run.bodies[0]
        before, found = mean(left)[0], follow(run, 8.0, 4)
        assert not run.forces.any()
        impulse = found[:, 0].sum() * stepping.dt / left.mass.sum()
        assert mean(left)[0] - before == pytest.approx(impulse, rel=1e-11)


def test_unequal_bars():
    """1 at v meets 2 of its length at rest: after 2L/c it rests, the other goes on with v/2."""
    n = 10
    run = bars(n=(n, 2 * n), velocities=(1e-3, 0.0))
    found = follow(run, 4.0, n)
    velocities = [mean(body)[0] / (1e-3 * C) for body in run.bodies]
    assert velocities == pytest.approx([0.0, 0.5], abs=0.02)
    assert (found[:, 0] <= 0.0).all()


def test_before_they_touch_bodies_do_not_know_of_one_another():
    """Four tenths of a cell apart, in one cell: each is bit for bit what it is alone."""
    run, alone = bars(gap=0.4, velocities=(0.01, 0.0)), bars(gap=0.4, velocities=(0.01, 0.0)).runs
    until = 0.35 * H / (0.01 * C)
    run.until(until)
    for one, body in zip(alone, run.bodies, strict=True):
        one.until(until)
        for name, value in one.bodies[0].state().items():
            assert np.array_equal(value, body.state()[name]), name
    assert not run.forces.any()
    run.until(0.45 * H / (0.01 * C))
    assert run.forces[0, 0] < 0.0


def test_three_bodies_in_a_row():
    """Of three equal bars the last takes it all, and momentum stays."""
    n = 6
    cells = 3 * n + 12
    grid, stepping, runs = (
        mpm.Grid.box((0, 0), (cells * H, H), (cells, 1)),
        mpm.Newmark(0.5 * H / C),
        [],
    )
    for k in range(3):
        body = mpm.MaterialPoints.fill(
            grid,
            SOIL,
            4,
            inside=lambda x, k=k: (x[0] > (3 + k * n) * H) & (x[0] < (3 + (k + 1) * n) * H),
        )
        body.velocity = np.tile([1e-3 * C if k == 0 else 0.0, 0.0], (len(body), 1))
        runs.append(
            mpm.Simulation(grid, body, stepping, [mpm.Fixed(grid.facets("bottom", "top"), "y")])
        )
    run = mpm.Contact(*((one, one.bodies[0].surface("left", "right")) for one in runs))
    p0 = momentum(run)
    follow(run, 5.0, n)
    assert momentum(run) == pytest.approx(p0, rel=1e-13)
    assert [mean(body)[0] / (1e-3 * C) for body in run.bodies] == pytest.approx(
        [0.0, 0.0, 1.0], abs=0.15
    )


# -- statics, gravity, sliding ---------------------------------------------------------------------


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("ratio", [1.0, 100.0])
@pytest.mark.parametrize("mapping", [mpm.GIMP, mpm.DM_GC], ids=str)
def test_bars_in_series(mapping, ratio, swap):
    """A traction p stretches a bar through a gap g against another: q = (p a − g)/(a + b), a and b
    being L/E.

    Exact but for the change of lengths, ε = 1e-4.
    """
    na, nb, p = 4, 6, 2e3
    a, b = na * H / 20e6, nb * H / (20e6 * ratio)
    g = 0.5 * p * a
    grid = mpm.Grid.box((0, 0), ((na + nb) * H, 2 * H), (na + nb, 2))
    soils = [mpm.LinearElastic(E, 0.0, 1500.0) for E in (20e6, 20e6 * ratio)]
    left, right = (
        mpm.MaterialPoints.fill(grid, soil, 4, inside=lambda x, k=k: (x[0] < na * H) == (k == 0))
        for k, soil in enumerate(soils)
    )
    for value in (left.x[:, 0], left.half[:, 0], left.volume):
        value *= 1.0 - g / (na * H)
    end, start = left.surface("right"), right.surface("left")
    smooth = mpm.Fixed(grid.facets("bottom", "top"), "y")
    one = mpm.Simulation(
        grid,
        left,
        mpm.QuasiStatic(2),
        [smooth, mpm.Fixed(grid.facets("left")), mpm.Traction(end, lambda t: (p * t, 0.0))],
        mapping,
    )
    two = mpm.Simulation(
        grid, right, mpm.QuasiStatic(2), [smooth, mpm.Fixed(grid.facets("right"))], mapping
    )
    run = mpm.Contact(*[(one, end), (two, start)][:: -1 if swap else 1])
    run.step()
    assert np.abs(run.forces).max() < 1e-9 * p
    run.step()
    q = (p * a - g) / (a + b)
    assert np.abs(right.stress[:, 0] + q).max() < 3e-4 * q
    assert np.abs(left.stress[:, 0] - (p - q)).max() < 3e-4 * q
    assert run.forces[1 if swap else 0] == pytest.approx([-q * 2 * H, 0.0], rel=3e-4, abs=1e-6 * q)


def resting(dim=2, slide=0.0, ramp=None):
    """A block on a wider one, under gravity that comes within ``ramp`` steps."""
    soil, y = mpm.LinearElastic(20e6, 0.3, 1500.0), dim - 1
    cells = (*(9,) * (dim - 1), 5)
    grid = mpm.Grid.box((0,) * dim, tuple(n * H for n in cells), cells)
    stepping = mpm.Newmark(0.5 * H / soil.p_speed)
    base = mpm.MaterialPoints.fill(grid, soil, 2**dim, inside=lambda x: x[y] < 2 * H)
    block = mpm.MaterialPoints.fill(
        grid,
        soil,
        2**dim,
        inside=lambda x: (
            (x[y] > 2 * H) & (x[y] < 4 * H) & np.all((x[:y] > 3 * H) & (x[:y] < 6 * H), axis=0)
        ),
    )
    block.velocity = np.zeros_like(block.x)
    block.velocity[:, 0] = slide
    weight = mpm.Gravity(lambda t: (0.0,) * y + (-9.81 * min(1.0, t / (ramp * stepping.dt)),))
    bottom, top = (("bottom", "top"), ("back", "front"))[dim - 2]
    above = mpm.Simulation(grid, block, stepping, [weight])
    below = mpm.Simulation(grid, base, stepping, [weight, mpm.Fixed(grid.facets(bottom))])
    return mpm.Contact((above, block.surface(bottom)), (below, base.surface(top)))


@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.validation)])
def test_a_block_bears_its_weight_and_slides_on(dim):
    """The force is the weight, on average over the swing of the block; what slides without friction
    keeps sliding."""
    run = resting(dim, slide=0.5, ramp=60 if dim == 3 else 120)
    block, found = run.bodies[0], []
    weight = 9.81 * block.mass.sum()
    for _ in range(120 if dim == 3 else 240):
        run.step()
        found.append(run.forces[0] / weight)
    found = np.array(found)
    last = found[len(found) // 2 :]
    assert last[:, -1].mean() == pytest.approx(1.0, abs=0.02)
    assert last[:, -1].min() > 0.5
    assert np.abs(found[:, :-1]).max() < 2e-3  # the base sags by 1e-4 of its height
    assert mean(block)[0] == pytest.approx(0.5, rel=1e-3)


@pytest.mark.parametrize(
    "elastic", [SOIL, mpm.Hencky(20e6, 0.0, 1500.0)], ids=["small strain", "finite strain"]
)
def test_yielding_blocks(elastic):
    """Forces and yielding agree: gaps close to what is asked, and momentum stays.  Before they meet
    no force is at work in them, and what Newton leaves of inertia is round-off."""
    soil = mpm.VonMises(elastic, 20e3, 20e3, 0.0)
    run = bars(n=(4, 4), gap=0.015, velocities=(0.01, -0.01), soils=(soil, soil), courant=0.25)
    v, p0 = 0.01 * C, momentum(run)
    deepest = 2 * v * run.stepping.dt
    for _ in range(20):
        run.attempt(run.time, run.next_time, run.stepping)
        gap, λ = run._gap(), inside.gaps(run).λ
        assert (
            gap.min() > -2e-6 * deepest and np.abs(gap[λ > 0.0]).max(initial=0.0) < 2e-6 * deepest
        )
        run.step()
    assert run.bodies[0].history[:, 0].max() > 0.0
    assert np.abs(momentum(run) - p0).max() < 1e-9 * run.bodies[0].mass.sum() * v


# -- a run like others -----------------------------------------------------------------------------


def test_restart_goes_on_bit_for_bit(tmp_path):
    whole, first, again = (bars(n=(4, 4)) for _ in range(3))
    probe = whole.record(mpm.Probe("velocity", at=(6 * H, 0.5 * H)))
    whole.until(20 * whole.stepping.dt)
    for run in (first, again):
        run.record(mpm.Probe("velocity", at=(6 * H, 0.5 * H)))
    first.record(mpm.Checkpoint(tmp_path / "kept", every=6))
    first.until(8 * first.stepping.dt)
    again.restart(tmp_path / "kept.npz" if (tmp_path / "kept.npz").exists() else tmp_path / "kept")
    assert again.steps == 6 and {one.steps for one in again.runs} == {6}
    again.until(20 * again.stepping.dt)
    for name, value in whole.state().items():
        assert np.array_equal(value, again.state()[name]), name
    assert np.array_equal(again.recorders[0].values, probe.values)


def test_recorders_see_the_bodies_and_the_whole(tmp_path):
    run = bars(n=(4, 4))
    with pytest.raises(ValueError, match="Energy is of one body"):
        run.record(mpm.Energy())
    each = [one.record(mpm.Energy()) for one in run.runs]
    run.record(mpm.Snapshots(tmp_path / "meet", every=5))
    run.until(10 * run.stepping.dt)
    assert len(each[0].times) == 11
    for name, value in run.energy().items():
        assert value == pytest.approx(sum(one[name][-1] for one in each)), name
    assert each[0]["strain"][-1] > 0.1 * each[0]["kinetic"][0]
    assert list(tmp_path.glob("meet*"))


def test_a_step_that_fails_moves_no_body():
    """One body turns inside out when all have been solved and one has moved; it is put back."""
    run = bars(n=(4, 4))
    right = run.bodies[1]
    right.velocity[:, 0] = -4.0 * (right.x[:, 0] - right.x[:, 0].mean()) / run.stepping.dt
    kept = {name: value.copy() for name, value in run.state().items()}
    with pytest.raises(mpm.RunError, match=r"step 1, t = .* inside out"):
        run.step()
    for name in (name for name in kept if "/bodies/" in name or "/surfaces/" in name):
        assert np.array_equal(run.state()[name], kept[name]), name
    assert run.steps == 0 and {one.steps for one in run.runs} == {0}


def test_what_cannot_go_together_is_refused():
    grid, other = (mpm.Grid.box((0, 0), (4 * H, H), (4, 1)) for _ in range(2))

    def make(grid, low, high, dt=1e-3):
        body = mpm.MaterialPoints.fill(
            grid, SOIL, 4, inside=lambda x: (x[0] > low * H) & (x[0] < high * H)
        )
        return mpm.Simulation(grid, body, mpm.Newmark(dt), []), body.surface("left", "right")

    one, two = make(grid, 0, 2), make(grid, 2, 4)
    with pytest.raises(ValueError, match=r"two or more pairs .* got 1"):
        mpm.Contact(one)
    with pytest.raises(ValueError, match=r"pairs .* got \(Simulation, GridSurface\)"):
        mpm.Contact(one, (two[0], grid.facets("left")))
    with pytest.raises(ValueError, match="named twice"):
        mpm.Contact(one, one)
    with pytest.raises(ValueError, match="one grid"):
        mpm.Contact(one, make(other, 2, 4))
    with pytest.raises(ValueError, match=r"one stepping, got .*0\.001.* and .*0\.002"):
        mpm.Contact(one, make(grid, 2, 4, dt=2e-3))
    moved = make(grid, 2, 4)
    moved[1].x[:, 0] -= 0.1 * H
    with pytest.raises(ValueError, match=r"bodies 0 and 1 overlap by 0\.025 m"):
        mpm.Contact(make(grid, 0, 2), moved)
    both = mpm.Contact(make(grid, 0, 2), make(grid, 2, 4))
    for ask, words in (
        (both.settle, "settle is of one body: settle each body in a QuasiStatic run of its own"),
        (both.balance, r"balance is of one body: .*run\.balance\(\)"),
        (both.reactions, r"reactions are of one body: .*run\.reactions"),
    ):
        with pytest.raises(ValueError, match=words):
            ask()
