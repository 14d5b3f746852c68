"""Case 24: an earthquake comes up through rock into layers of damped soil.

Exact: the transfer function of the layers with Rayleigh's damping (Thomson 1950, Haskell 1953),
times the spectrum of the record.  Sides are tied; nothing else holds the column.
"""

import numpy as np
import pytest
from methods import over

import mpm_fenicsx as mpm
from mpm_fenicsx.scenes.soil_column import SoilColumn, Stratum, soil, synthetic_record

pytestmark = pytest.mark.validation

ROCK = soil(800.0, 2300.0)
RECORD = synthetic_record(5.0, peak=3.0, low=0.4, high=6.0, seed=4)


def strata(*layers):
    """Of thickness (m), speed of shear waves (m/s), density (kg/m³) and damping ratio."""
    return tuple(
        Stratum(soil(speed, density), thickness, mpm.RayleighDamping(ratio, (1.0, 6.0)))
        for thickness, speed, density, ratio in layers
    )


COLUMNS = {
    "two layers": strata((8.0, 150.0, 1800.0, 0.05), (12.0, 300.0, 2000.0, 0.02)),
    "five layers": strata(
        (4.0, 140.0, 1700.0, 0.06),
        (5.0, 220.0, 1900.0, 0.04),
        (3.0, 160.0, 1750.0, 0.05),
        (8.0, 320.0, 2000.0, 0.03),
        (10.0, 500.0, 2100.0, 0.01),
    ),
}


@over(None, *mpm.MAPPINGS)
@pytest.mark.parametrize("name", COLUMNS)
def test_the_surface_moves_as_the_transfer_function_has_it(name, mapping, record):
    """Cells of 1 m, 23 and more a wavelength at 6 Hz; a run of the record's length."""
    column = SoilColumn(COLUMNS[name], ROCK, RECORD, step=RECORD.dt)
    run = column.finite_elements() if mapping is None else column.material_points(mapping)
    probes = {field: run.record(column.probe(field)) for field in ("acceleration", "velocity")}
    energy = run.record(mpm.Energy())
    run.until(RECORD.duration)
    for field, probe in probes.items():
        record(f"24 {name}, damped: surface {field} (L2)", mapping, column.error(probe))
    lost = np.abs(energy.lost).max() / energy["work"].max()
    assert column.error(probes["acceleration"]) < 0.01
    assert column.error(probes["velocity"]) < 0.01
    assert lost < 0.005
