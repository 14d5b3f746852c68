"""The call of a compiled UMAT: where its 37 arguments lie, and the loop over points.

All arguments lie in two arrays, one of floats and one of integers, with guard zones between them
that no routine may write to.  The loop works on copies, so that threads and ranks share nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import types
from numba.core.cgutils import ir  # of llvmlite, which comes with numba
from numba.extending import intrinsic

from ..common import tensors
from ..common.compiled import jit

ARGUMENTS = (
    *("STRESS", "STATEV", "DDSDDE", "SSE", "SPD", "SCD", "RPL", "DDSDDT", "DRPLDE", "DRPLDT"),
    *("STRAN", "DSTRAN", "TIME", "DTIME", "TEMP", "DTEMP", "PREDEF", "DPRED", "CMNAME", "NDI"),
    *("NSHR", "NTENS", "NSTATV", "PROPS", "NPROPS", "COORDS", "DROT", "PNEWDT", "CELENT"),
    *("DFGRD0", "DFGRD1", "NOEL", "NPT", "LAYER", "KSPT", "KSTEP", "KINC"),
)
"""In the order of Abaqus."""
OUTPUT = frozenset(
    ("STRESS", "STATEV", "DDSDDE", "SSE", "SPD", "SCD", "RPL", "DDSDDT", "DRPLDE", "DRPLDT")
) | {"PNEWDT"}
POINTWISE = frozenset(("STRAN", "DSTRAN", "PROPS", "CELENT"))
"""Inputs that may differ from point to point."""
GUARD = 64
"""Numbers between two arguments."""
CHARACTERS = 80
"""Of the material's name, which Fortran is told in a hidden argument."""
WELL, SMALLER, NO_NUMBER, BEYOND = 0, 1, 2, 3
"""What a batch ends with."""
FIRST, LATER = 1, 2
"""KINC of the call that initialises, and of all others."""


@dataclass(frozen=True)
class Frame:
    """Arguments of one call as the arrays in which they lie.

    ``real`` and ``whole``: numbers with guards of NaN and of the least integer; ``offset`` (37,):
    where each argument begins, in the array of its kind; ``integer`` (37,): whether that is
    ``whole``; ``watched``, ``watched_whole``: places that a call must leave alone.
    """

    real: np.ndarray
    whole: np.ndarray
    offset: np.ndarray
    integer: np.ndarray
    watched: np.ndarray
    watched_whole: np.ndarray

    def owner(self, place: int, integer: bool) -> str:
        """The argument in or after which a place lies."""
        mine = [n for n in range(len(ARGUMENTS)) if self.integer[n] == integer]
        before = [n for n in mine if self.offset[n] <= place]
        if not before:
            return f"before {ARGUMENTS[mine[0]]}"
        last = max(before, key=lambda n: self.offset[n])
        return ARGUMENTS[last]


def frame(dim: int, states: int, properties: int, name: str, first: bool) -> Frame:
    """Arguments for plane strain or 3D, of so many state variables and properties.

    What a law is not told is NaN: coordinates, deformation gradients, total strain and length of
    the element unless they are written later.  ``first``: the call that initialises, at time 0.
    """
    count, nan = tensors.components(dim), np.nan
    time = 0.0 if first else 1.0
    real = {
        **{"STRESS": [0.0] * count, "STATEV": [0.0] * max(states, 1)},
        **{"DDSDDE": [0.0] * count**2, "SSE": [0.0], "SPD": [0.0], "SCD": [0.0], "RPL": [0.0]},
        **{"DDSDDT": [0.0] * count, "DRPLDE": [0.0] * count, "DRPLDT": [0.0]},
        **{"STRAN": [nan] * count, "DSTRAN": [0.0] * count, "TIME": [time] * 2, "DTIME": [1.0]},
        **{"TEMP": [0.0], "DTEMP": [0.0], "PREDEF": [0.0], "DPRED": [0.0]},
        **{"PROPS": [0.0] * max(properties, 1), "COORDS": [nan] * 3, "DROT": np.eye(3).ravel()},
        **{"PNEWDT": [1.0], "CELENT": [nan], "DFGRD0": [nan] * 9, "DFGRD1": [nan] * 9},
    }
    label = np.frombuffer(name.upper()[:CHARACTERS].ljust(CHARACTERS).encode(), np.int32)
    whole = {
        **{"CMNAME": label, "NDI": [3], "NSHR": [count - 3], "NTENS": [count]},
        **{"NSTATV": [states], "NPROPS": [properties], "NOEL": [1], "NPT": [1], "LAYER": [1]},
        **{"KSPT": [1], "KSTEP": [1, 0, 0, 0], "KINC": [FIRST if first else LATER]},
    }
    reals, where, fixed = _laid_out(real, nan)
    wholes, where_whole, fixed_whole = _laid_out(whole, np.iinfo(np.int32).min)
    offset = np.array([{**where, **where_whole}[name] for name in ARGUMENTS])
    integer = np.array([name in whole for name in ARGUMENTS])
    return Frame(reals, wholes.astype(np.int32), offset, integer, fixed, fixed_whole)


def _laid_out(values: dict, guard: float) -> tuple[np.ndarray, dict[str, int], np.ndarray]:
    """Arguments one after the other with guards around them, where each begins, and which places
    must stay as they are."""
    parts, where, free, length = [[guard] * GUARD], {}, [], GUARD
    for name, value in values.items():
        where[name] = length
        if name in OUTPUT | POINTWISE:
            free += range(length, length + len(value))
        parts += [value, [guard] * GUARD]
        length += len(value) + GUARD
    return np.concatenate(parts), where, np.setdiff1d(np.arange(length), free)


@intrinsic
def _call(typing, address, table):
    """Call the routine at ``address`` with the 37 pointers that lie at ``table``, and the length of
    CMNAME."""
    signature = types.void(types.uintp, types.uintp)

    def code(context, builder, _, values):
        routine, first = values
        pointer, word = ir.IntType(8).as_pointer(), ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [pointer] * len(ARGUMENTS) + [word])
        start = builder.inttoptr(first, word.as_pointer())
        given = [
            builder.inttoptr(builder.load(builder.gep(start, [word(n)])), pointer)
            for n in range(len(ARGUMENTS))
        ]
        builder.call(builder.inttoptr(routine, kind.as_pointer()), [*given, word(CHARACTERS)])
        return context.get_dummy_value()

    return signature, code


@jit
def _pointers(real, whole, offset, integer):
    """Addresses of the arguments (37,)."""
    table = np.empty(len(offset), np.uint64)
    for n in range(len(offset)):
        if integer[n]:
            table[n] = whole.ctypes.data + 4 * offset[n]
        else:
            table[n] = real.ctypes.data + 8 * offset[n]
    return table


@jit
def _theirs(i, count):
    """Abaqus's number of our component: in 3D its shear strains are xy, xz, yz."""
    return i if count == 4 or i < 4 else 9 - i


@jit
def _write(strain, stress, state, properties, real, offset):
    """Arguments of one point; ``state``: its state variables."""
    count = len(strain)
    for i in range(count):
        j = _theirs(i, count)
        real[offset[0] + j] = stress[i]
        real[offset[11] + j] = strain[i]
    for k in range(len(state)):
        real[offset[1] + k] = state[k]
    for k in range(len(properties)):
        real[offset[23] + k] = properties[k]
    for k in range(count * count):
        real[offset[2] + k] = 0.0
    real[offset[27]] = 1.0


@jit
def _read(real, offset, out_stress, out_state, out_tangent):
    """Results of one point; return their sum, which is no number if one of them is none."""
    count = len(out_stress)
    total = 0.0
    for i in range(count):
        out_stress[i] = real[offset[0] + _theirs(i, count)]
        total += out_stress[i]
    for k in range(len(out_state)):
        out_state[k] = real[offset[1] + k]
        total += out_state[k]
    for i in range(len(out_tangent)):
        for j in range(count):  # DDSDDE lies column by column
            out_tangent[i, j] = real[offset[2] + _theirs(i, count) + count * _theirs(j, count)]
            total += out_tangent[i, j]
    return total


@jit
def _plastic_work(strain, before, after, lame):
    """σ_after : (Δε - C⁻¹ : Δσ), J/m³."""
    λ, μ = lame
    trace = 0.0
    for i in range(3):
        trace += after[i] - before[i]
    work, shift = 0.0, λ / (3.0 * λ + 2.0 * μ) * trace
    for i in range(len(strain)):
        change = after[i] - before[i]
        elastic = 0.5 * (change - shift) / μ if i < 3 else change / μ
        work += after[i] * (strain[i] - elastic)
    return work


@jit
def _write_energies(row, real, offset):
    """What is stored and what is lost so far."""
    real[offset[3]], real[offset[4]], real[offset[5]] = row[0], row[1], 0.0


@jit
def _write_strain(row, count, real, offset):
    """Strain before the increment, of a row of six."""
    for i in range(count):
        real[offset[10] + _theirs(i, count)] = row[i]


@jit
def _unharmed(real, whole, copy_real, copy_whole, watched, watched_whole):
    """The first place that a call has changed and must not, as its number or, of an integer, the
    complement of that; else the length of ``real``."""
    before, after = real.view(np.int64), copy_real.view(np.int64)
    for n in watched_whole:  # first: where sizes are changed, the rest follows
        if whole[n] != copy_whole[n]:
            return -1 - n
    for n in watched:
        if before[n] != after[n]:
            return n
    return len(real)


@jit
def batch(address, arrays, strain, stress, history, properties, size, sizes, lame, out, tangent):
    """Call the routine for each row; return how it ended, at which row, and PNEWDT or the place of
    what was overwritten.

    ``arrays``: those of a ``Frame``; ``history`` (n, k): ``sizes[0]`` state variables, then six
    numbers of strain if ``sizes[1]``, stored energy and plastic work if ``sizes[2]``, else plastic
    work alone; ``properties`` (n or 1, k); ``size`` (n,) or (0,), m; ``out``: stress and history
    after it; ``tangent`` (n, c, c), or (n, 0, c) where it is not wanted.
    """
    template, template_whole, offset, integer, watched, watched_whole = arrays
    real, whole = template.copy(), template_whole.copy()
    table = _pointers(real, whole, offset, integer)
    out_stress, out_history = out
    states, total, energies = sizes
    after = states + 6 * total
    ended, row, said = WELL, 0, 0.0
    for p in range(len(strain)):
        given = properties[p if len(properties) > 1 else 0]
        _write(strain[p], stress[p], history[p, :states], given, real, offset)
        if total:
            _write_strain(history[p, states:after], strain.shape[1], real, offset)
        if energies:
            _write_energies(history[p, after:], real, offset)
        if len(size):
            real[offset[28]] = size[p]
        _call(address, table.ctypes.data)
        found = _read(real, offset, out_stress[p], out_history[p, :states], tangent[p])
        if real[offset[27]] < 1.0 or not np.isfinite(found):
            ended = SMALLER if real[offset[27]] < 1.0 else NO_NUMBER
            row, said = p, real[offset[27]]
            break
        for i in range(6 * total):
            more = strain[p, i] if i < strain.shape[1] else 0.0
            out_history[p, states + i] = history[p, states + i] + more
        if energies:
            out_history[p, after] = real[offset[3]]
            out_history[p, after + 1] = real[offset[4]] + real[offset[5]]
        else:
            work = _plastic_work(strain[p], stress[p], out_stress[p], lame)
            out_history[p, after] = history[p, after] + work
    place = _unharmed(template, template_whole, real, whole, watched, watched_whole)
    if place != len(template):
        return BEYOND, row, float(place)
    return ended, row, said
