"""A far field of finite elements is the same ground as the points that it goes on from."""

import dataclasses

import numpy as np
import open_ground
import pytest
from heard import warned
from inside import at_nodes, let_drift, plain
from open_ground import TIGHT, soil

import mpm_fenicsx as mpm

DEEP = mpm.LinearElastic(young=20e6, poisson=0.3, density=2000.0)
G = 9.81


def lower(level):
    return lambda x: x[1] < level


# -- waves -----------------------------------------------------------------------------------------


def back(wave, cells, courant, **how):
    """Energy that the far field sends back, of that which came: where all are points none does."""
    (one, time), (all_points, _) = (
        open_ground.column(wave, cells, courant, half, **how) for half in (True, False)
    )
    came = sum(one.energy().values())
    for run in (one, all_points):
        run.until(round(time / run.stepping.dt) * run.stepping.dt)
    upper = np.lexsort(np.round(one.bodies[0].x, 2).T)
    whole = np.lexsort(np.round(all_points.bodies[0].x, 2).T)[-len(upper) :]
    mass = one.bodies[0].mass[upper]
    other = one.bodies[0].velocity[upper] - all_points.bodies[0].velocity[whole]
    return float(mass @ (other**2).sum(axis=1)) / came


@pytest.mark.parametrize("wave", ["P", "S"])
def test_little_of_a_wave_comes_back_and_less_by_the_fair_rule(wave):
    own, fair = (back(wave, 16, 0.5, fair=fair) for fair in (False, True))
    assert fair < own <= 1e-5
    assert fair <= 3e-6


def test_with_generalized_alpha():
    def stepping(dt):
        return mpm.GeneralizedAlpha(dt)

    assert back("P", 16, 0.5, stepping=stepping) <= 1e-5


# -- rest ------------------------------------------------------------------------------------------


def resting(follows=False, young=20e6):
    """Static run of a column, points on a far field, under its weight; and what its run needs."""
    material = mpm.LinearElastic(young=young, poisson=0.3, density=2000.0)
    grid = mpm.Grid.box((0.0, 0.0), (2.0, 8.0), (4, 16))
    body = mpm.MaterialPoints.fill(grid, material, 4, lambda x: (x[1] > 4) & (x[1] < 7))
    far = mpm.FarField(lower(4.0), material, follows=follows)
    always = [mpm.Fixed(grid.facets("left", "right"), "x"), mpm.Gravity((0.0, -G))]
    terms = [far, mpm.Fixed(grid.facets("bottom")), *always]
    run = mpm.Simulation(grid, body, mpm.QuasiStatic(4), terms, solver=TIGHT)
    run.until(1.0)
    run.settle()
    return run, material, always


def test_a_column_at_rest_bears_its_weight():
    """σ_yy = -ρ g (7 - y) in the points, ε = σ_yy/M at the centre of the lowest cell."""
    run, material, _ = resting(young=2e9)
    body, M = run.bodies[0], material.lame[0] + 2 * material.lame[1]
    assert np.allclose(body.stress[:, 1], -2000 * G * (7.0 - body.x[:, 1]), atol=10.0)
    assert run.far_field_strain() == pytest.approx(2000 * G * 6.75 / M, rel=1e-6)
    part = plain(run)[0]
    y = run.grid.space.tabulate_dof_coordinates()[part.nodes, 1]
    exact = -2000 * G / M * (7.0 * y - 0.5 * y**2)
    assert at_nodes(run, part.U)[part.nodes, 1] == pytest.approx(exact, rel=1e-4, abs=1e-9)


@pytest.mark.parametrize("follows", [False, True])
def test_nothing_moves_when_statics_become_dynamics(follows):
    static, material, always = resting(follows)
    grid, body = static.grid, static.bodies[0]
    held = static.reactions(grid.facets("bottom"))
    far = mpm.FarField(lower(4.0), material, follows=follows, start=static)
    dashpots = mpm.ViscousBoundary(grid.facets("bottom"), material)
    terms = [far, dashpots, *held, *always]
    run = mpm.Simulation(grid, body, mpm.Newmark(2e-3), terms, solver=TIGHT)
    stress = body.stress.copy()
    for _ in range(40):
        run.step()
    assert np.abs(body.velocity).max() < 1e-10
    assert np.abs(body.stress - stress).max() < 1e-9 * np.abs(stress).max()


def test_a_far_field_without_its_static_run_is_warned_of():
    static, material, always = resting()
    base = mpm.Fixed(static.grid.facets("bottom"))
    for start, told in ((static, 0), (None, 1)):
        far = mpm.FarField(lower(4.0), material, start=start)
        terms = [far, base, *always]
        run = mpm.Simulation(static.grid, static.bodies[0], mpm.Newmark(2e-3), terms)
        said = warned(run.step)
        assert sum("the FarField beside them none" in words for words in said) == told


def test_the_grid_follows_what_settles():
    run, *_ = resting(follows=True, young=1e6)
    shared = plain(run)[0].shared
    drift = at_nodes(run, plain(run)[0].U)[shared].mean(axis=0)
    assert drift[1] < -0.2  # m, of cells of 0.5 m
    assert run.grid.offset == pytest.approx(drift, abs=1e-12)
    assert run.grid.lower_corner == pytest.approx(drift, abs=1e-12)


def test_material_that_leaves_its_far_field_is_refused():
    with pytest.raises(mpm.RunError, match=r"FarField has moved by 0\.\d+ of a cell.*follows=True"):
        resting(young=1e6)


# -- what a scene says of it -----------------------------------------------------------------------


def small(**how):
    grid = mpm.Grid.box((0.0, 0.0), (4.0, 8.0), (4, 8))
    body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: x[1] > 4)
    given = {"where": lower(4.0), "material": soil, **how}
    terms = [mpm.FarField(**given), mpm.Fixed(grid.facets("bottom"))]
    return mpm.Simulation(grid, body, mpm.Newmark(0.3), terms, solver=TIGHT)


@pytest.mark.parametrize(
    "how, message",
    [
        ({"where": lower(4.9)}, "there are material points in the cell at"),
        ({"where": lower(-1.0)}, "no cell of the grid is in it"),
        ({"material": mpm.VonMises(soil, 1.0, 1.0, 0.0)}, "must be linear elastic at small strain"),
        ({"material": mpm.Hencky(2.5, 0.25, 1.0)}, "must be linear elastic at small strain"),
        ({"material": [(soil, lower(3.0))]}, "lies in several of the regions, or in none"),
        ({"start": 3}, "start of FarField must be a run on the same grid, got int"),
    ],
)
def test_what_cannot_be_is_refused(how, message):
    with pytest.raises(ValueError, match=message):
        small(**how)


def test_a_start_that_leaves_springs_behind_is_warned_of():
    run = small()
    springs = mpm.ViscoelasticBoundary(run.grid.facets("left"), soil, 2.0)
    before = mpm.Simulation(
        run.grid, run.bodies[0], mpm.Newmark(0.3), [mpm.FarField(lower(4.0), soil), springs]
    )
    far = mpm.FarField(lower(4.0), soil, start=before)
    with pytest.warns(UserWarning, match="springs on facets, and an AbsorbingLayer, of the run"):
        mpm.Simulation(run.grid, run.bodies[0], mpm.Newmark(0.3), [far, springs])


def test_two_far_fields_share_no_cell():
    grid = mpm.Grid.box((0.0, 0.0), (4.0, 8.0), (4, 8))
    body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: x[1] > 4)
    both = [mpm.FarField(lower(4.0), soil), mpm.FarField(lower(1.0), soil)]
    with pytest.raises(ValueError, match="FarField and FarField both have the cell at"):
        mpm.Simulation(grid, body, mpm.Newmark(0.3), both)


def test_a_point_that_comes_into_it_stops_the_run():
    run = small()
    run.bodies[0].velocity[:, 1] = -0.5
    let_drift(run)
    with pytest.raises(mpm.RunError, match="has come into a cell of the FarField"):
        for _ in range(20):
            run.step()


def test_large_strains_are_warned_of_once():
    run = small()
    at_nodes(run, plain(run)[0].V)[:, 0] = 0.1
    let_drift(run)
    with pytest.warns(UserWarning, match=r"FarField is strained by .* give the points more room"):
        for _ in range(10):
            run.step()


# -- what it is made of ----------------------------------------------------------------------------


def test_cells_become_points_in_mid_run():
    run = small()
    body, part = run.bodies[0], plain(run)[0]
    body.velocity[:] = 1e-3 * np.sin(body.x)
    for _ in range(5):
        run.step()

    def momentum():
        of_points = sum((b.mass[:, None] * b.velocity).sum(axis=0) for b in run.bodies)
        part = plain(run)[0]
        return of_points + part.lumped @ at_nodes(run, part.V)

    before, energy = momentum(), sum(run.energy().values())
    new = run.release(lambda x: x[1] > 2)
    assert len(new) == 4 * 8 and len(plain(run)[0].cells) == 4 * 2 < len(part.cells)
    assert momentum() == pytest.approx(before, rel=1e-12)
    assert sum(run.energy().values()) == pytest.approx(energy, rel=0.02)
    run.step()
    new.velocity[:] = 1e6
    with pytest.raises(mpm.RunError, match="body 1, "):
        run.step()


def test_energy_goes_on_where_cells_become_points():
    """The balance of a column that is pushed, and ends on dashpots, is that without a release."""
    lost = []
    for released in (False, True):
        grid = mpm.Grid.box((0.0, 0.0), (4.0, 8.0), (4, 8))
        body = mpm.MaterialPoints.fill(grid, soil, 4, lambda x: x[1] > 4)
        push = mpm.Traction(grid.facets("top"), (0.0, -1e-4))
        dashpots = mpm.ViscousBoundary(grid.facets("bottom"), soil)
        rollers = mpm.Fixed(grid.facets("left", "right"), "x")
        terms = [mpm.FarField(lower(4.0), soil), push, dashpots, rollers]
        run = mpm.Simulation(grid, body, mpm.Newmark(0.3), terms, solver=TIGHT)
        energy = run.record(mpm.Energy())
        for step in range(60):
            if released and step == 20:
                run.release(lambda x: x[1] > 3)
            run.step()
        lost.append((energy["work"][-1], energy["absorbed"][-1]))
    assert lost[1] == pytest.approx(lost[0], rel=0.02)


def test_b_bar_holds_in_the_far_field_too():
    """Nearly incompressible ground under a strip settles as finite elements with b_bar do."""
    clay = mpm.LinearElastic(young=2.5e6, poisson=0.4999, density=1000.0)
    strip = {"strip": lambda x: (x[1] > -1e-9) & (abs(x[0] - 1) <= 0.5)}
    grid = mpm.Grid.box((0.0, -6.0), (4.0, 0.0), (8, 12), facets=strip)
    sides = mpm.Fixed(grid.facets("left", "right"), "x")
    terms = [mpm.Traction(grid.facets("strip"), (0.0, -150.0)), sides]
    terms = [*terms, mpm.Fixed(grid.facets("bottom"))]
    body = mpm.MaterialPoints.fill(grid, clay, 4, lambda x: x[1] > -0.5)
    far = mpm.FarField(lambda x: x[1] < -0.5, clay)
    mapping = dataclasses.replace(mpm.DM_GC, b_bar=True)
    run = mpm.Simulation(grid, body, mpm.QuasiStatic(1), [far, *terms], mapping)
    twin = mpm.FiniteElements(grid, clay, mpm.QuasiStatic(1), terms, b_bar=True)
    run.step()
    twin.step()
    settled = [one.nodal("increment")[:, 1].min() for one in (run, twin)]
    assert settled[0] == pytest.approx(settled[1], rel=0.01)
    assert run.energy()["strain"] == pytest.approx(twin.energy()["strain"], rel=0.02)


@pytest.mark.parametrize("law", [soil, mpm.VonMises(soil, 1e3, 1e3, 0.0)])
def test_the_twin_tells_the_stress_of_its_far_field(law):
    """That of a whole run, at cell centres and at Gauss points."""
    grid = mpm.Grid.box((0.0, 0.0), (4.0, 8.0), (4, 8))
    terms = [mpm.Fixed(grid.facets("bottom")), mpm.Traction(grid.facets("top"), (0.3, -1.0))]
    parts = mpm.FiniteElements(
        grid, law, mpm.QuasiStatic(1), [mpm.FarField(lower(4.0), soil), *terms]
    )
    whole = mpm.FiniteElements(grid, soil, mpm.QuasiStatic(1), terms, b_bar=parts.b_bar)
    for run in (parts, whole):
        run.step()
    cells = np.arange(grid.owned_cells)
    assert parts.stress(cells) == pytest.approx(whole.stress(cells), rel=1e-9, abs=1e-9)
    assert parts.gauss_stress() == pytest.approx(whole.gauss_stress(), rel=1e-9, abs=1e-9)


def test_the_twin_is_finite_elements_all_over():
    """With a far field, and without, the same run."""
    grid = mpm.Grid.box((0.0, 0.0), (4.0, 8.0), (4, 8))
    base = mpm.Fixed(grid.facets("bottom"))
    load = mpm.Traction(grid.facets("top"), lambda t: (0.0, np.sin(t)))
    whole, parts = (
        mpm.FiniteElements(grid, soil, mpm.Newmark(0.3), [*far, base, load])
        for far in ([], [mpm.FarField(lower(4.0), soil)])
    )
    for run in (whole, parts):
        for _ in range(20):
            run.step()
    for name in ("displacement", "velocity", "acceleration"):
        one, other = whole.nodal(name), parts.nodal(name)
        assert np.abs(one - other).max() < 1e-11 * np.abs(one).max()
    assert sum(parts.energy().values()) == pytest.approx(sum(whole.energy().values()), rel=1e-11)


def test_a_restart_goes_on_bit_for_bit(tmp_path):
    path = tmp_path / "state"
    run, again = (open_ground.block(2, fair=True, follows=True) for _ in range(2))
    run.record(mpm.Checkpoint(path, every=5))
    for _ in range(5):
        run.step()
    again.restart(path)
    for _ in range(5):
        run.step()
        again.step()
    for name, value in run.state().items():
        assert np.array_equal(value, again.state()[name]), name
    assert np.array_equal(run.grid.offset, again.grid.offset)
