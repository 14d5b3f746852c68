"""A process makes as many runs as it likes, one after the other."""

import gc

import mpm_fenicsx as mpm


def test_grids_that_nobody_asks_for_leave_their_communicators():
    """Some 290 at a time are all that MPI has communicators for; here they are kept by what refers
    to itself, as a run does, and Python frees nothing by itself."""
    gc.disable()
    try:
        for _ in range(330):
            kept = [mpm.Grid.box((0.0, 0.0), (1.0, 1.0), (1, 1))]
            kept.append(kept)
    finally:
        gc.enable()
