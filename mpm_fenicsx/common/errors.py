"""What a run says when it cannot go on."""


class SolverError(RuntimeError):
    """A step that could not be solved; says why."""


class RunError(RuntimeError):
    """A run that cannot go on; names the step and its time.  What was recorded before is kept."""


class OutputError(OSError, RunError):
    """A recorder could not write: names step, time and file.

    The step is done and the other recorders have seen it, so that the run can go on when there is
    space, or without that recorder.
    """
