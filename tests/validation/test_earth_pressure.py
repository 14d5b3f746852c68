"""Case 18: a smooth wall that moves by 1e-4 of its height bears Rankine's earth pressure."""

import pytest
from methods import over

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes.wall import Wall

pytestmark = pytest.mark.validation


@pytest.mark.parametrize("cohesion", [0.0, 5e3], ids=["sand", "cohesive"])
@pytest.mark.parametrize("passive", [False, True], ids=["active", "passive"])
@over(None, mpm.GIMP, mpm.DM_G, mpm.DM_GC, mpm.DM_GCL)
def test_the_wall_bears_rankines_pressure(mapping, passive, cohesion, record):
    wall = Wall(passive, cohesion=cohesion)
    run = wall.finite_elements() if mapping is None else wall.material_points(mapping)
    run.until(1.0)
    error = wall.error(run)
    name = "passive" if passive else "active"
    record(f"18 Rankine, {name}, φ = 30°, c = {cohesion / 1e3:g} kPa: force", mapping, abs(error))
    assert abs(error) < (1e-12 if mapping is None else 5e-3 if passive else 1e-3)


@pytest.mark.parametrize("cohesion", [0.0, 5e3], ids=["sand", "cohesive"])
@pytest.mark.parametrize("passive", [False, True], ids=["active", "passive"])
def test_the_force_does_not_know_the_dilation_angle(passive, cohesion):
    """Elements find the even state of flow at ψ = 0, too."""
    wall = Wall(passive, cohesion=cohesion, dilation_angle=0.0, young=0.6e9 if passive else 50e6)
    run = wall.finite_elements()
    run.until(1.0)
    assert abs(wall.error(run)) < 1e-12
