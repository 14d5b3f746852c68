"""Checkpoints: all that a run needs to go on bit for bit, in files that are whole or not there."""

from __future__ import annotations

import errno
import json
import os
import re
import tempfile
import zipfile
import zlib
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

from mpi4py import MPI

import numpy as np

from ..common.checks import in_short, whole
from ..common.files import complete, failing_together, named
from ..common.ranks import anywhere, together
from ..common.spread import Part, below

NO_CHECKPOINT = (
    "it is no checkpoint, or not a whole one: give the file that a recorder Checkpoint wrote"
)


LABELS = ("cells", "nodes", "owned", "weight")


class Checkpoint:
    """Recorder that keeps the state of the run after every ``every`` steps, for
    ``run.restart(path)``.

    The file (NumPy's npz) holds the last checkpoint only.  It replaces its forerunner when it is
    complete, so that a full disk, or an end of the process while it is written, leaves the one
    before.  Nothing is written when attached: a script that is started again may attach it and then
    call ``restart``.  It looks after all other recorders, whose series it keeps.

    On several ranks each writes a file of its own, ``<path>.<tag>.<rank>``, and when all are
    complete the first rank replaces ``path``, which names them, and removes those of before.  Any
    number of ranks can go on from them.

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
    """Write the run's state and its recorders', each rank its own."""
    comm = run.grid.comm
    mine = {"identity": np.array(json.dumps(run.identity())), "partition": run.partition()}
    with together(comm):
        recorded = {
            label: _arrays(label, recorder) for label, recorder in _remembering(run).items()
        }
    part = run.part()
    mine.update({f"part/{name}": getattr(part, name) for name in LABELS})
    mine.update({f"run/{name}": value for name, value in part.state.items()})
    mine.update(
        {
            f"recorders/{label}/{name}": value
            for label, arrays in recorded.items()
            for name, value in arrays.items()
        }
    )
    head = {"steps": np.array(run.steps), "ranks": np.array(comm.size)}
    if comm.size == 1:
        with failing_together(comm, "checkpoint not written", path):
            _save(path, {**head, **{f"0/{name}": value for name, value in mine.items()}})
            _remove_others(path, "")
        return
    tag = comm.bcast(uuid4().hex[:8])
    own = _part(path, tag, comm.rank)
    with failing_together(comm, "checkpoint not written", path):
        _save(own, {"whose": np.array(_whose(tag, comm.rank)), **mine})
    with failing_together(comm, "checkpoint not written", path):
        if comm.rank == 0:
            _save(path, {**head, "tag": np.array(tag)})
            _remove_others(path, tag)


def _part(path: Path, tag: str, rank: int) -> Path:
    """The file of a rank."""
    return path.with_name(f"{path.name}.{_whose(tag, rank)}")


def _whose(tag: str, rank: int) -> str:
    """What the file of a rank says of itself."""
    return f"{tag}.{rank}"


def _remove_others(path: Path, tag: str) -> None:
    """Remove the files of ranks that are not of the checkpoint with this tag."""
    of_ranks = re.compile(re.escape(path.name) + r"\.([0-9a-f]{8})\.\d+(\.part)?")
    for file in path.parent.iterdir():
        found = of_ranks.fullmatch(file.name)
        if found and found[1] != tag:
            with suppress(OSError):
                file.unlink()


def _save(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write one file, on the disk when it gets its name."""
    with complete(path) as part, open(part, "wb") as file:
        with zipfile.ZipFile(file, "w") as store:  # NumPy's savez does not close it on a full disk
            for name, value in arrays.items():
                with store.open(name + ".npy", "w", force_zip64=True) as entry:
                    np.lib.format.write_array(entry, np.asanyarray(value), allow_pickle=False)
        file.flush()
        os.fsync(file.fileno())


def restart(run, path: str | os.PathLike) -> None:
    """Set the run to the state in a file; see ``Run.restart``."""
    comm, path = run.grid.comm, named(path)
    head = None
    with failing_together(comm, "checkpoint not read", path):
        if comm.rank == 0:
            head = _head(path)
    steps, ranks, tag = comm.bcast(head)
    with failing_together(comm, "checkpoint not read", path):
        files = [_read(path, tag, rank) for rank in range(comm.rank, ranks, comm.size)]
    found, here = str(files[0]["identity"]) if files else "", run.identity()
    if ranks == comm.size:
        message = _difference(json.loads(found), here)
    else:
        found = json.loads(comm.bcast(found))
        message = _difference(_without_arrays(found), _without_arrays(here))
    _refuse(comm, path, message)
    parts = [
        Part(*(file[f"part/{name}"] for name in LABELS), below("run/", file)) for file in files
    ]
    run.lie_as(parts)
    recorders, state = _remembering(run), run.state()
    stays = ranks == comm.size and comm.allreduce(
        int(
            np.array_equal(files[0]["partition"], run.partition())
            and set(parts[0].state) == set(state)
        ),
        op=MPI.MIN,
    )
    if stays:
        recorded = below("recorders/", files[0])
        message = _misfit(parts[0].state, state, run.arrays_that_move())
    else:
        recorded = comm.bcast(below("recorders/", files[0]) if files else None)
        message = run.misfit(parts)
    _refuse(comm, path, message or _unknown(recorders, recorded))
    if stays:
        run.restore(parts[0].state)
    else:
        run.receive(parts)
    for label, recorder in recorders.items():
        recorder.restore(below(f"{label}/", recorded))
    run.resume(steps)


def _refuse(comm, path: Path, message: str | None) -> None:
    """Raise ``ValueError``, on all ranks, where one has a message."""
    message = anywhere(comm, message)
    if message:
        raise ValueError(f"{path}: {message}")


def _head(path: Path) -> tuple[int, int, str | None]:
    """Steps done, on how many ranks, and the tag of these ranks' files where they have some."""
    with open(path, "rb") as file:
        if not zipfile.is_zipfile(file):
            raise ValueError(NO_CHECKPOINT)
    with np.load(path, allow_pickle=False) as file:
        if "steps" not in file or "ranks" not in file:
            raise ValueError(NO_CHECKPOINT)
        tag = str(file["tag"]) if "tag" in file else None
        return int(file["steps"]), int(file["ranks"]), tag


def _read(path: Path, tag: str | None, rank: int) -> dict[str, np.ndarray]:
    """The arrays of a rank."""
    if tag is not None:
        path = _part(path, tag, rank)
        if not path.exists():
            raise FileNotFoundError(
                errno.ENOENT, f"the checkpoint names {path.name} beside it, which is not there"
            )
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
    except (ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise OSError(errno.EINVAL, f"{path.name} is damaged: {error}") from error
    if tag is None:
        return below(f"{rank}/", arrays)
    whose = str(arrays.pop("whose", ""))
    if whose != _whose(tag, rank):
        raise OSError(errno.EINVAL, f"{path.name} is the file of another rank, {whose!r}")
    return arrays


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
    name = "released cells"
    if found.get(name) != here.get(name):
        return (
            f"its run had released {found.get(name, 0)} cells of its far fields, and this one has "
            f"{here.get(name, 0)}: call run.release as that run did, then restart"
        )
    for name in {**here, **found}:
        if found.get(name) != here.get(name):
            return f"{name} is {found.get(name)} in the checkpoint, and here {here.get(name)}"
    return None


def _without_arrays(words: Mapping[str, str]) -> dict[str, str]:
    """Words without what arrays hold row by row, of which other ranks may have other rows."""
    return {
        name: re.sub(r"(array \([\d, ]*\)|field) \S+, [^,)]+|\[\[.*?\]\]|\[\]", "rows", word)
        for name, word in words.items()
    }


def _misfit(
    kept: Mapping[str, np.ndarray], state: Mapping[str, np.ndarray], moving: set[str]
) -> str | None:
    """The first array of a checkpoint that does not fit the run; those that are ``moving`` may have
    more or fewer rows."""
    for name in {**state, **kept}:
        found, here = (
            None if a is None else (a.dtype.name, a.shape[name in moving :])
            for a in (kept.get(name), state.get(name))
        )
        if found != here:
            return f"{name} is {found} in the checkpoint, and here {here}"
    return None


def _unknown(recorders: Mapping[str, object], recorded: Mapping[str, np.ndarray]) -> str | None:
    """The first recorder that a checkpoint does not know."""
    known = {name.split("/")[0] for name in recorded}
    for label, recorder in recorders.items():
        if label not in known and _arrays(label, recorder):
            return (
                f"recorder {label} is not in the checkpoint, which has {sorted(known)}: record it "
                "after the restart"
            )
    return None
