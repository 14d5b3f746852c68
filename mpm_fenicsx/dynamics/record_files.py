"""Files of records: PEER's AT2, and columns of text or CSV."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from ..common.checks import in_short, one_of, positive, whole
from .units import LARGEST, UNITS, doubt

UNEVEN = 0.02  # of a step: what rounded times may be off by
_SIZES = (
    r"NPTS\s*=?\s*(?P<npts>\d+)\s*,?\s*DT\s*=?\s*(?P<dt>[\d.]+(?:E[-+]?\d+)?)",
    r"^\s*(?P<npts>\d+)\s+(?P<dt>[\d.]+(?:E[-+]?\d+)?)\s+NPTS\s*,?\s*DT",
)
"""Number of samples and step of an AT2, as PEER writes them now and as it did."""
_SPELT = {"m/s/s": "m/s2", "cm/s/s": "cm/s2", "cm/sec2": "cm/s2", "m/sec2": "m/s2", "gals": "gal"}
"""Units as names of columns spell them, to those of ``UNITS``."""
_IN_HEADER = {"G": "g", "CM/S/S": "cm/s2", "CM/SEC/SEC": "cm/s2", "M/S/S": "m/s2", "GAL": "gal"}


def read(
    path: str | os.PathLike,
    unit: str | None,
    column: int | str | None,
    time_column: int | str | None,
    dt: float | None,
    skip: int,
) -> tuple[np.ndarray, float]:
    """Accelerations (n,), m/s², and their step, s, of a file: see ``Record.read``."""
    if not isinstance(path, str | os.PathLike):
        raise ValueError(f"path must be a path, got {in_short(path)}")
    path, skip = Path(path), whole("skip", skip, least=0)
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()[skip:]
    if not any(line.strip() for line in lines):
        raise ValueError(f"{path}: the file has no lines after the first {skip}")
    size = _size(lines)
    if path.suffix.lower() == ".at2" and size is None:
        raise ValueError(
            f"{path}: an AT2 has the number of samples and their step in its header, as NPTS= 4000,"
            " DT= .0050 SEC, and this has not; read it as text, with another suffix and dt=..."
        )
    if size is not None:
        if column is not None or time_column is not None:
            raise ValueError(f"{path}: an AT2 has no columns to choose from; leave out column")
        values, step, unit = _at2(path, lines, size, unit)
    else:
        values, step = _columns(path, lines, column, time_column, dt, unit)
    if dt is not None and abs(positive("dt", dt) / step - 1.0) > 1e-6:
        raise ValueError(f"{path}: the file's step is {step:.9g} s, got dt={dt:.9g}; leave dt out")
    if unit is None:
        raise ValueError(
            f'{path}: unit must be given, for the file does not say it: "g", "m/s2" or "cm/s2"'
        )
    one_of("unit", unit, UNITS)
    peak = float(np.abs(values).max())
    if peak * UNITS[unit] > LARGEST:
        raise ValueError(f"{path}: {doubt(peak, unit)}")
    return values * UNITS[unit], step


# -- AT2 -------------------------------------------------------------------------------------------


def _size(lines: list[str]) -> tuple[int, int, float] | None:
    """Line after the header of an AT2, number of samples and step, or None for another file."""
    for i, line in enumerate(lines[:10]):
        for pattern in _SIZES:
            found = re.search(pattern, line, re.IGNORECASE)
            if found:
                return i + 1, int(found["npts"]), float(found["dt"])
    return None


def _at2(
    path: Path, lines: list[str], size: tuple[int, int, float], unit: str | None
) -> tuple[np.ndarray, float, str | None]:
    """Values, step and unit of an AT2."""
    first, samples, dt = size
    header = " ".join(lines[:first]).upper()
    kind = re.search(r"(VELOCITY|DISPLACEMENT)\s+TIME", header)
    if kind:
        raise ValueError(
            f"{path}: the header says {kind[1].lower()}, and a record is acceleration: take the "
            "file that ends in AT2, or Record.from_velocity(velocity, dt)"
        )
    says = re.search(r"UNITS?\s+OF\s+([A-Z/0-9]+)", header)
    own = _IN_HEADER.get(says[1]) if says else None
    if own and unit is not None and UNITS.get(unit) != UNITS[own]:
        raise ValueError(f"{path}: the header says units of {own}, got unit={unit!r}; leave it out")
    values: list[float] = []
    for number, line in enumerate(lines[first:], first + 1):
        try:
            values += map(float, line.split())
        except ValueError:
            raise ValueError(f"{path}: line {number} is not of numbers: {in_short(line)}") from None
    if len(values) != samples:
        raise ValueError(
            f"{path}: NPTS is {samples} in the header, and there are {len(values)} values: the "
            "file is not whole, or has been edited"
        )
    return _finite(path, np.array(values)), positive("dt", dt), own or unit


# -- columns ---------------------------------------------------------------------------------------


def _columns(
    path: Path,
    lines: list[str],
    column: int | str | None,
    time_column: int | str | None,
    dt: float | None,
    unit: str | None,
) -> tuple[np.ndarray, float]:
    """Values and step of a file of columns."""
    table = _table(path, lines)
    names = list(table.columns)
    told = ", ".join(f"{i} {name!r}" if name != i else f"{i}" for i, name in enumerate(names))
    if column is None and len(names) > 1 + (dt is None):
        raise ValueError(f"{path}: column must say where accelerations are, one of {told}")
    if time_column is None and dt is None:
        if len(names) == 1:
            raise ValueError(f"{path}: dt must be given, for the file has no column of time")
        if len(names) > 2:
            raise ValueError(f"{path}: time_column, one of {told}, or dt must be given")
        time_column = 0 if _number(path, "column", column, names, told, 1) == 1 else 1
    at = _number(path, "column", column, names, told, len(names) - 1)
    _refuse_other_unit(path, names[at], unit)
    a = _finite(path, _floats(path, table, at))
    if time_column is None:
        return a, positive("dt", dt)
    at_time = _number(path, "time_column", time_column, names, told, 0)
    if at_time == at:
        raise ValueError(f"{path}: column and time_column are the same, {told.split(', ')[at]}")
    if _in_brackets(names[at_time]) in ("ms", "msec", "min", "h"):
        raise ValueError(
            f"{path}: time must be in s, and its column is named {names[at_time]!r}: give dt (s) "
            "and leave time_column out"
        )
    return a, _step(path, _finite(path, _floats(path, table, at_time)))


def _in_brackets(name: str | int) -> str:
    """What a column's name has in brackets, its unit as a rule; empty where it has nothing."""
    found = re.search(r"[(\[]([^)\]]*)[)\]]", str(name))
    return found[1].strip().lower().replace("²", "2").replace("^", "") if found else ""


def _refuse_other_unit(path: Path, name: str | int, unit: str | None) -> None:
    """Raise ``ValueError`` where a column's name says another unit than the one given."""
    says = _in_brackets(name)
    known = UNITS.get(_SPELT.get(says, says))
    if known is not None and unit in UNITS and known != UNITS[unit]:
        raise ValueError(
            f"{path}: the column of accelerations is named {name!r}, got unit={unit!r}: if the "
            "name is wrong, correct it in the file"
        )


def _table(path: Path, lines: list[str]):
    """The file's columns, as pandas has them."""
    from io import StringIO

    import pandas

    rows = [line for line in (line.split("#")[0].rstrip() for line in lines) if line.strip()]
    if not rows:
        raise ValueError(f"{path}: the file has nothing but comments")
    last = rows[-1]
    separator = next((mark for mark in (";", "\t") if mark in last), None)
    decimal = "," if separator and "," in last and "." not in last else "."
    separator = separator or ("," if "," in last else r"\s+")
    first = re.split(separator, rows[0].strip())
    named = not any(_is_number(word, decimal) for word in first)
    try:
        table = pandas.read_csv(
            StringIO("\n".join(row.strip() if separator == r"\s+" else row for row in rows)),
            sep=separator,
            decimal=decimal,
            header=0 if named else None,
            skipinitialspace=True,
            index_col=False,
        )
    except pandas.errors.ParserError as error:
        raise ValueError(
            f"{path}: the lines have not all as many columns ({' '.join(str(error).split())}); "
            "skip=... passes over lines at the top"
        ) from error
    table.columns = [str(name).strip() if named else i for i, name in enumerate(table.columns)]
    table = table.dropna(axis="columns", how="all")  # what a comma at the end of lines leaves
    if not table.size:
        raise ValueError(f"{path}: there are no values after the line {in_short(rows[0])}")
    return table


def _is_number(word: str, decimal: str) -> bool:
    try:
        float(word.replace(decimal, "."))
    except ValueError:
        return False
    return True


def _number(path: Path, what: str, given, names: list, told: str, default: int) -> int:
    """Number of a column, given by its name or number."""
    if given is None:
        return default
    if isinstance(given, str):
        if given not in names:
            raise ValueError(f"{path}: {what} must be one of {told}, got {given!r}")
        return names.index(given)
    number = whole(what, given, least=0)
    if number >= len(names):
        raise ValueError(f"{path}: {what} must be one of {told}, got {number}")
    return number


def _floats(path: Path, table, at: int) -> np.ndarray:
    """One column as numbers; what is none is named."""
    import pandas

    column = table.iloc[:, at]
    found = pandas.to_numeric(column, errors="coerce").to_numpy(float)
    wrong = np.flatnonzero(np.isnan(found) & column.notna().to_numpy())
    if len(wrong):
        raise ValueError(
            f"{path}: {column.iloc[wrong[0]]!r} in row {wrong[0] + 1} of column "
            f"{table.columns[at]!r} is no number"
        )
    return found


def _finite(path: Path, values: np.ndarray) -> np.ndarray:
    """Values, two or more and all of them numbers."""
    wrong = np.flatnonzero(~np.isfinite(values))
    if len(wrong):
        raise ValueError(
            f"{path}: value {wrong[0] + 1} of {len(values)} is {values[wrong[0]]}, and "
            f"{len(wrong) - 1} others are no numbers either: fill the gaps before"
        )
    if len(values) < 2:
        raise ValueError(f"{path}: a record has two samples or more, got {len(values)}")
    return values


def _step(path: Path, time: np.ndarray) -> float:
    """The step of times, which must be equal but for their rounding."""
    step = float(time[-1] - time[0]) / (len(time) - 1)
    off = np.abs(time - time[0] - step * np.arange(len(time)))
    if step <= 0.0 or off.max() > UNEVEN * step:
        steps = np.diff(time)
        usual = float(np.median(steps))
        k = int(np.argmax(np.abs(steps - usual)))
        raise ValueError(
            f"{path}: steps of time must be equal, got {usual:.6g} s mostly and {steps[k]:.6g} s "
            f"after {time[k]:.6g} s: interpolate to equal steps before, with numpy.interp"
        )
    return float(f"{step:.10g}")  # 0.01 of times with a few digits, not 0.009999999999998
