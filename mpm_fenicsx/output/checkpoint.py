"""Checkpoints: all that a run needs to go on bit for bit, in one file that is whole or not
there."""

from __future__ import annotations

import errno
import json
import os
import tempfile
import zipfile
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..common.checks import in_short, whole
from ..common.files import complete, failing_together, named
from ..common.ranks import anywhere, together

NO_CHECKPOINT = (
    "it is no checkpoint, or not a whole one: give the file that a recorder Checkpoint wrote"
)


class Checkpoint:
    """Recorder that keeps the state of the run after every ``every`` steps, for
    ``run.restart(path)``.

    The file (NumPy's npz) holds the last checkpoint only.  It replaces its forerunner when it is
    complete, so that a full disk, or an end of the process while it is written, leaves the one
    before.  Nothing is written when attached: a script that is started again may attach it and then
    call ``restart``.  It looks after all other recorders, whose series it keeps.  Several ranks
    write one file, which as many ranks can read.

    Raises ``ValueError`` for a ``path`` without name or ``every`` < 1, and when it writes, for a
    recorder whose ``state()`` cannot be kept; ``OSError`` naming the path, on every rank, when
    attached or later, where nothing can be written.
    """

    last = True

    def __init__(self, path: str | os.PathLike, every: int = 1):
        self.path, self.every = named(path), whole("every", every)

    def attach(self, run) -> None:
        """Make the folder, and see that there can be a file in it."""
        with failing_together(run.grid.comm, "no checkpoint can be written", self.path):
            if run.grid.comm.rank == 0:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                if self.path.is_dir():
                    raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
                with tempfile.TemporaryFile(dir=self.path.parent):
                    pass

    def __call__(self, run) -> None:
        """Write the state after a step, if it is its turn."""
        if run.steps % self.every == 0:
            write(run, self.path)


def write(run, path: Path) -> None:
    """Write the run's state and its recorders' to one file, on the first rank."""
    comm = run.grid.comm
    mine = {"identity": np.array(json.dumps(run.identity()))}
    with together(comm):
        recorded = {
            label: _arrays(label, recorder) for label, recorder in _remembering(run).items()
        }
    mine.update({f"run/{name}": value for name, value in run.state().items()})
    mine.update(
        {
            f"recorders/{label}/{name}": value
            for label, arrays in recorded.items()
            for name, value in arrays.items()
        }
    )
    ranks = comm.gather(mine)
    with failing_together(comm, "checkpoint not written", path):
        if comm.rank == 0:
            arrays = {
                "steps": np.array(run.steps),
                "ranks": np.array(comm.size),
                **{
                    f"{k}/{name}": value
                    for k, part in enumerate(ranks)
                    for name, value in part.items()
                },
            }
            with complete(path) as part, open(part, "wb") as file:
                with zipfile.ZipFile(
                    file, "w"
                ) as store:  # NumPy's savez does not close it when the disk is full
                    for name, value in arrays.items():
                        with store.open(name + ".npy", "w", force_zip64=True) as entry:
                            np.lib.format.write_array(
                                entry, np.asanyarray(value), allow_pickle=False
                            )
                file.flush()
                os.fsync(file.fileno())


def restart(run, path: str | os.PathLike) -> None:
    """Set the run to the state in a file; see ``Run.restart``."""
    comm, path = run.grid.comm, named(path)
    parts = steps = None
    with failing_together(comm, "checkpoint not read", path):
        if comm.rank == 0:
            steps, parts = _read(path)
    ranks = comm.bcast(parts and len(parts))
    if ranks != comm.size:
        raise ValueError(f"{path}: it is of a run on {ranks} ranks, and here are {comm.size}")
    steps, kept, recorders = comm.bcast(steps), comm.scatter(parts), _remembering(run)
    found = json.loads(str(kept.pop("identity")))
    message = anywhere(
        comm,
        _difference(found, run.identity())
        or _misfit(kept, run.state(), recorders, run.arrays_that_move()),
    )
    if message:
        raise ValueError(f"{path}: {message}")
    run.restore({name: kept[f"run/{name}"] for name in run.state()})
    for label, recorder in recorders.items():
        recorder.restore(_below(f"recorders/{label}/", kept))
    run.resume(steps)


def _read(path: Path) -> tuple[int, list[dict[str, np.ndarray]]]:
    """Steps done, and the arrays of each rank."""
    with open(path, "rb") as file:
        if not zipfile.is_zipfile(file):
            raise ValueError(NO_CHECKPOINT)
    with np.load(path, allow_pickle=False) as file:
        if "steps" not in file or "ranks" not in file:
            raise ValueError(NO_CHECKPOINT)
        arrays = dict(file)
    return int(arrays["steps"]), [_below(f"{k}/", arrays) for k in range(int(arrays["ranks"]))]


def _below(prefix: str, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name[len(prefix) :]: value for name, value in arrays.items() if name.startswith(prefix)}


def _remembering(run) -> dict[str, object]:
    """The recorders that have a state, by their labels; of those with the same label the second has
    the number 2."""
    found, count = {}, Counter()
    for recorder in run.recorders:
        if hasattr(recorder, "state"):
            label = getattr(recorder, "label", type(recorder).__name__)
            count[label] += 1
            found[label if count[label] == 1 else f"{label} {count[label]}"] = recorder
    return found


def _arrays(label: str, recorder) -> dict[str, np.ndarray]:
    """What a recorder wants kept; ``ValueError`` where that cannot be, or not be given back."""
    state = recorder.state()
    if not isinstance(state, Mapping):
        raise ValueError(
            f"recorder {label}: state() must return arrays by name, {{}} where there are none, got "
            f"{in_short(state)}"
        )
    if not callable(getattr(recorder, "restore", None)):
        raise ValueError(
            f"recorder {label} has state() and no restore(state), which a restart calls: write "
            "it, or leave both out"
        )
    for name, value in state.items():
        try:
            kind = np.asanyarray(value).dtype
        except ValueError:
            kind = np.dtype(object)
        if kind.hasobject:
            raise ValueError(
                f"recorder {label}: {name!r} of state() must be an array of numbers or text, got "
                f"{in_short(value)}"
            )
    return dict(state)


def _difference(found: dict[str, str], here: dict[str, str]) -> str | None:
    """The first thing in which a checkpoint's run is another one."""
    for name in {**here, **found}:
        if found.get(name) != here.get(name):
            return f"{name} is {found.get(name)} in the checkpoint, and here {here.get(name)}"
    return None


def _misfit(
    kept: dict[str, np.ndarray],
    state: dict[str, np.ndarray],
    recorders: dict[str, object],
    moving: set[str],
) -> str | None:
    """The first array of a checkpoint that does not fit the run; those that are ``moving`` may have
    more or fewer rows."""
    for name in {**state, **_below("run/", kept)}:
        found, here = (
            None if a is None else (a.dtype.name, a.shape[name in moving :])
            for a in (kept.get(f"run/{name}"), state.get(name))
        )
        if found != here:
            return f"{name} is {found} in the checkpoint, and here {here}"
    known = {name.split("/")[1] for name in kept if name.startswith("recorders/")}
    for label, recorder in recorders.items():
        if label not in known and _arrays(label, recorder):
            return (
                f"recorder {label} is not in the checkpoint, which has {sorted(known)}: record it "
                "after the restart"
            )
    return None
