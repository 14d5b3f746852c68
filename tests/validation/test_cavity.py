"""Case 19: a cylindrical cavity in Mohr-Coulomb soil is blown up, or gives way."""

import pytest
from methods import over

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes.cavity import Cavity

pytestmark = pytest.mark.validation

EXPANDS, CONTRACTS = 400e3, 20e3
BANDS = "bands form where flow is not associated, in place of the even answer, and Newton stops"


def cells(mapping):
    """A radius."""
    return 40 if mapping is None else 20


def case(pressure, φ, ψ):
    name = "expansion" if pressure > 100e3 else "contraction"
    return f"19 cavity, {name}, φ = {φ}°, ψ = {ψ}°"


@pytest.mark.parametrize(
    "pressure, φ, ψ",
    [(EXPANDS, 20, 20), (CONTRACTS, 20, 20), (CONTRACTS, 30, 10), (CONTRACTS, 30, 0)],
)
@over(None, mpm.DM_G, mpm.DM_GC)
def test_wall_and_plastic_radius(mapping, pressure, φ, ψ, record):
    cavity = Cavity(pressure, float(φ), float(ψ), cells=cells(mapping))
    run = cavity.finite_elements() if mapping is None else cavity.material_points(mapping)
    run.until(1.0)
    for what, error in cavity.errors(run).items():
        record(f"{case(pressure, φ, ψ)}: {what.replace('_', ' ')}", mapping, abs(error))
        assert abs(error) < (5e-3 if mapping is None else 1e-2)


@pytest.mark.parametrize("ψ", [0, 10])
@over(None, mpm.DM_GC)
def test_expansion_with_flow_that_is_not_associated(mapping, ψ, record):
    """Rings of cells keep the symmetry; squares that the wall cuts do not, and strain gathers in
    bands at 45° to them."""
    cavity = Cavity(EXPANDS, 30.0, float(ψ), cells=cells(mapping))
    names = [f"{case(EXPANDS, 30, ψ)}: {what}" for what in ("displacement", "plastic radius")]
    if mapping is not None:
        for name in names:
            record(name, mapping, None, BANDS)
        with pytest.raises(mpm.RunError, match="Newton does not converge"):
            cavity.material_points(mapping).until(1.0)
        return
    run = cavity.finite_elements()
    run.until(1.0)
    for name, error in zip(names, cavity.errors(run).values(), strict=True):
        record(name, mapping, abs(error))
        assert abs(error) < 5e-3
