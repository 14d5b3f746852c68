"""Soil that a run can hardly mean is told of: cells that lock, stress that no law bears, parameters
that are no numbers."""

import re
from dataclasses import replace

import numpy as np
import pytest
from heard import warned

import mpm_fenicsx as mpm

SOIL = mpm.LinearElastic(young=20e6, poisson=0.3, density=1800.0)
FLOWS = mpm.Tresca(SOIL, 5e3)
STEP = mpm.QuasiStatic(1)


def place():
    grid = mpm.Grid.box((0.0, 0.0), (2.0, 2.0), (4, 4))
    sides = mpm.Fixed(grid.facets("left", "right"), "x")
    return grid, [sides, mpm.Fixed(grid.facets("bottom"), "y")]


def points(law, mapping=mpm.DM_GC, stress=None):
    grid, terms = place()
    body = mpm.MaterialPoints.fill(grid, law, 4)
    if stress is not None:
        body.stress[:] = stress
    return mpm.Simulation(grid, body, STEP, terms, mapping)


def elements(law, **options):
    grid, terms = place()
    return mpm.FiniteElements(grid, law, STEP, terms, **options)


@pytest.mark.parametrize("law", [FLOWS, mpm.Undrained(SOIL, 1e8)])
def test_mappings_that_integrate_at_points_say_that_cells_lock(law):
    for mapping in (mpm.GIMP, mpm.MPM, mpm.CMPM):
        (words,) = warned(lambda mapping=mapping: points(law, mapping))
        assert re.search(rf"{mapping} integrates at the points, where cells lock", words)
        assert warned(lambda mapping=mapping: points(law, replace(mapping, b_bar=False))) == []
    assert warned(lambda: points(law)) == warned(lambda: points(SOIL, mpm.GIMP)) == []


@pytest.mark.parametrize("kind", [mpm.LinearElastic, mpm.Hencky])
def test_elastic_soil_that_hardly_changes_volume_says_so(kind):
    clay = kind(young=20e6, poisson=0.499, density=1800.0)
    makers = [points, elements, lambda law: points(law, mpm.GIMP)]
    for make in makers:
        (words,) = warned(lambda make=make: make(clay))
        assert "with ν = 0.499 cells lock" in words and "b_bar=True" in words
    assert warned(lambda: elements(clay, b_bar=True)) == warned(lambda: elements(SOIL)) == []
    assert warned(lambda: points(clay, replace(mpm.DM_GC, b_bar=False))) == []


@pytest.mark.parametrize("finite", [False, True])
def test_stress_beyond_yield_that_is_given_by_hand_is_told_of(finite):
    soil = mpm.Hencky(20e6, 0.3, 1800.0) if finite else SOIL
    law = mpm.Tresca(soil, 5e3)
    run = points(law, stress=(-1e6, 0.0, 0.0, 0.0))
    with pytest.warns(UserWarning, match="points bear stress at the start that Tresca does not"):
        run.step()
    borne = points(law, stress=(-8e3, -1e3, -4e3, 0.0))
    assert warned(borne.step) == []


def test_parameters_given_by_hand_are_looked_at():
    grid, terms = place()
    body = mpm.MaterialPoints.fill(grid, FLOWS, 4, parameters={"cohesion": lambda x: 5e3 + x[0]})
    body.parameters["cohesion"][7] = np.nan
    with pytest.raises(ValueError, match=r"parameters: cohesion is not a number at x=\["):
        mpm.Simulation(grid, body, STEP, terms)
    body.parameters["cohesion"][7] = 5e3
    body.parameters["cohesionn"] = np.ones(len(body))
    with pytest.raises(ValueError, match=r"takes .*cohesion.* and not 'cohesionn'"):
        mpm.Simulation(grid, body, STEP, terms)


def test_a_body_is_said_in_a_line():
    grid, _ = place()
    assert repr(mpm.MaterialPoints.fill(grid, SOIL, 4)).startswith("MaterialPoints(64 of Linear")
