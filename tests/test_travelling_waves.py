"""What travels up and what travels down, apart."""

import numpy as np
import pytest
from earthquakes import ROCK, compliant, pulse

import mpm_fenicsx as mpm

H, HEIGHT, FREQUENCY = 0.5, 20.0, 8.0


def column(wave, points):
    """A column of rock whose surface sends back what comes up."""
    cells = round(HEIGHT / H)
    grid = mpm.Grid.box((0.0, 0.0), (H, HEIGHT + H * points), (1, cells + points))
    terms = [mpm.Tied("left", "right"), *compliant(grid, motion=pulse(FREQUENCY), wave=wave)]
    stepping = mpm.Newmark(0.25 * H / ROCK.p_speed)
    if not points:
        return mpm.FiniteElements(grid, ROCK, stepping, terms)
    body = mpm.MaterialPoints.fill(grid, ROCK, 4, lambda x: x[1] < HEIGHT)
    return mpm.Simulation(grid, body, stepping, terms)


@pytest.mark.parametrize("points", [False, True])
@pytest.mark.parametrize("wave, component", [("SV", 0), ("P", 1)])
def test_what_comes_up_goes_back_down(wave, component, points):
    run = column(wave, points)
    height = 7.25
    waves = run.record(mpm.TravellingWaves((0.5 * H, height), ROCK))
    within = run.record(mpm.Probe("velocity", (0.5 * H, height)))
    speed = ROCK.s_speed if wave == "SV" else ROCK.p_speed
    run.until(3.0 / FREQUENCY)
    t, exact = waves.times, pulse(FREQUENCY).velocity
    assert np.abs(waves.up[:, component] - exact(t - height / speed)).max() < 3e-4
    assert np.abs(waves.down[:, component] - exact(t - (2 * HEIGHT - height) / speed)).max() < 3e-4
    assert waves.total == pytest.approx(within.values, abs=1e-15)
    assert np.abs(waves.values[..., 1 - component]).max() < 1e-6


def test_it_goes_on_after_a_restart(tmp_path):
    runs = [column("SV", True) for _ in range(2)]
    waves = [run.record(mpm.TravellingWaves((0.25, 7.25), ROCK)) for run in runs]
    runs[0].record(mpm.Checkpoint(tmp_path / "state", every=10))
    for _ in range(10):
        runs[0].step()
    runs[1].restart(tmp_path / "state")
    for run in runs:
        run.step()
    assert np.array_equal(waves[0].values, waves[1].values)


def test_a_material_without_speeds_is_refused():
    with pytest.raises(ValueError, match="material of TravellingWaves"):
        mpm.TravellingWaves((0.0, 0.0), object())
