"""Laws that users have compiled by the convention of Abaqus's UMAT."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from ..common.checks import array, finite, positive, several, whole
from ..common.errors import SolverError
from .elastic import LinearElastic
from .material import NOTHING, Given, Law, checked_rows
from .umat_call import BEYOND, NO_NUMBER, SMALLER, Frame, batch, frame
from .umat_checks import check_guards, check_tangent
from .umat_library import absolute, address, fingerprint

STRAIN = tuple(f"strain_{name}" for name in ("xx", "yy", "zz", "xy", "yz", "xz"))

BORNE = 1e-6
"""Of the stress: what a call without strain may change it by."""


@dataclass(frozen=True)
class Umat(Law):
    """Soil whose law is a compiled routine UMAT, in Fortran or C, called in a compiled loop.

    ``library``: path of the shared library; ``properties``: its PROPS, numbers, or numbers by
    name; ``state_variables``: how many STATEV it has, or their names, or their values at the start
    by name (else 0).  ``elastic``: density and elastic reference, or ``density`` (kg/m³) and
    ``lame`` (λ, μ), Pa.  Properties and initial state variables may differ from point to point,
    named as here or, where there are only numbers, property_1, ... and state_1, ...

    ``symbol``: the routine's name in the library.  ``symmetric``: DDSDDE is; ``keeps_volume``: it
    can flow at constant volume.  ``length`` (m): CELENT plays a part, and is the size of a point's
    first cell.  ``total_strain``: it uses STRAN, which is then kept.  ``energies``: it fills SSE,
    SPD and SCD, which become the state variables "stored_energy" and "plastic_work" (J/m³); else
    energy is that of the elastic reference and plastic work σ_after : (Δε - C⁻¹ : Δσ).

    ``check_pressure`` (Pa, compression positive) and ``check_strain`` (-): where the routine is
    tried when a scene is built, for writing where it must not and for a tangent that is not the
    derivative of its stress; ``check_tangent=False`` leaves out the latter.

    Small strain, plane strain (NDI 3, NSHR 1) and 3D.  Rows are put into Abaqus's order.  KSTEP is
    1, DTIME 1.  The first call for a point has no strain, KINC 1 and TIME 0, that the routine can
    initialise STATEV; then KINC is 2 and TIME 1.  TEMP and PREDEF are 0, DROT the identity; COORDS,
    DFGRD0, DFGRD1, and STRAN and CELENT unless asked for, are NaN.  PNEWDT < 1 halves the step.

    Raises ``ValueError`` naming what is wrong with the library or a parameter.
    """

    library: str = field(compare=False)
    properties: Sequence[float] | Mapping[str, float]
    state_variables: int | Sequence[str] | Mapping[str, float]
    elastic: LinearElastic | None = None
    density: float | None = None
    lame: tuple[float, float] | None = None
    symbol: str = "umat_"
    symmetric: bool = False
    keeps_volume: bool = True
    length: float | None = None
    total_strain: bool = False
    energies: bool = False
    check_pressure: float = 0.0
    check_strain: float = 1e-3
    check_tangent: bool = True
    build: str = field(init=False, repr=False)

    def __post_init__(self) -> None:
        put = partial(object.__setattr__, self)
        put("library", absolute(self.library))
        put("properties", _named("properties", "property", self.properties))
        states = self.state_variables
        if isinstance(states, Mapping | str) or not isinstance(states, Sequence):
            states = states if isinstance(states, Mapping) else whole("state_variables", states, 0)
        put("state_variables", _states(states))
        self._take_reference(put)
        if self.length is not None:
            put("length", positive("length", self.length))
        put("check_strain", positive("check_strain", self.check_strain))
        put("check_pressure", finite("check_pressure", self.check_pressure))
        for name in ("symmetric", "keeps_volume", "total_strain", "energies", "check_tangent"):
            if getattr(self, name) not in (True, False):
                raise ValueError(f"{name} must be True or False, got {getattr(self, name)!r}")
        names = [name for name, _ in (*self.properties, *self.state_variables)]
        twice = sorted({name for name in (*names, *self.history) if names.count(name) > 1})
        taken = sorted({*names} & {"size", *self.history[len(self.state_variables) :]})
        if twice or taken:
            raise ValueError(
                f"properties and state_variables must have names of their own, got "
                f"{', '.join([*twice, *taken])} more than once or for what the package names so"
            )
        put("build", fingerprint(self.library))
        address(self.library, self.build, self.symbol)

    def _take_reference(self, put) -> None:
        """Density and moduli, from ``elastic`` or by themselves."""
        elastic = self.elastic
        if elastic is None:
            if self.density is None or self.lame is None:
                raise ValueError(
                    "elastic, or density and lame, must be given: dashpots and the first solve of "
                    f"a step go by them; got density={self.density!r}, lame={self.lame!r}"
                )
            put("density", positive("density", self.density))
            pair = array("lame", self.lame)
            if pair.shape != (2,) or not (pair[1] > 0.0 and 3.0 * pair[0] + 2.0 * pair[1] > 0.0):
                raise ValueError(
                    "lame must be two numbers λ and μ (Pa) with μ > 0 and λ + 2μ/3 > 0, got "
                    f"{self.lame!r}"
                )
            put("lame", (float(pair[0]), float(pair[1])))
            return
        if not isinstance(elastic, LinearElastic):
            raise ValueError(f"elastic must be a LinearElastic, got {elastic!r}")
        if elastic.kinematics.finite:
            raise ValueError(
                f"elastic of a Umat must be of small strain, such as LinearElastic, got {elastic!r}"
                ": DFGRD1 and DROT are not passed"
            )
        for name, mine in (("density", elastic.density), ("lame", elastic.lame)):
            if getattr(self, name) not in (None, mine):
                raise ValueError(
                    f"{name} must be left out where elastic is given, got {getattr(self, name)!r}"
                )
            put(name, mine)

    @property
    def _name(self) -> str:
        """What it is called in messages."""
        return f"{self.symbol} of {Path(self.library).name}"

    @property
    def history(self) -> tuple[str, ...]:
        """Names of the state variables: the routine's own, and what is kept for it."""
        own = tuple(name for name, _ in self.state_variables)
        kept = ("stored_energy", "plastic_work") if self.energies else ("plastic_work",)
        return (*own, *(STRAIN if self.total_strain else ()), *kept)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the properties and of the routine's own state variables."""
        return tuple(name for name, _ in (*self.properties, *self.state_variables))

    def initial_history(self, stress: np.ndarray, given: Given = NOTHING) -> np.ndarray:
        """State variables (n, k): as given, and as the routine's first call leaves them, of no
        strain and with KINC = 1.

        Raises ``ValueError`` for a stress that this call changes: the law cannot bear it.
        """
        history = np.zeros((len(stress), len(self.history)))
        for k, (name, value) in enumerate(self.state_variables):
            history[:, k] = given.get(name, value)
        at_rest = np.zeros_like(stress, float)
        new, history, _ = self._ask(at_rest, stress, history, given, False, True)
        off = np.abs(new - stress).max(axis=1, initial=0.0)
        allowed = BORNE * np.abs(stress).max(axis=1, initial=np.finfo(float).tiny)
        row = int((off - allowed).argmax()) if len(off) else 0
        if len(off) and off[row] > allowed[row]:
            raise ValueError(
                f"stress must be one that {self._name} can bear: without any strain it makes of "
                f"{np.asarray(stress)[row]} Pa {new[row]}"
            )
        return history

    def respond(self, strain, stress, history, given: Given = NOTHING):
        """Stress (n, components), Pa, and state variables (n, k) after the increments ``strain``
        (n, components).

        Raises ``SolverError`` where the routine asks for a smaller step or gives what is no
        number, ``ValueError`` where it writes beyond its arguments.
        """
        return self._ask(strain, stress, history, given, False)[:2]

    def tangent(self, strain, stress, history, given: Given = NOTHING):
        """``respond``, and DDSDDE (n, components, components), Pa."""
        return self._ask(strain, stress, history, given, True)

    def energy(self, stress: np.ndarray, history: np.ndarray | None = None) -> np.ndarray:
        """Stored energy per volume (n,), J/m³: SSE with ``energies``, else ½ σ : C⁻¹ : σ."""
        if self.energies and history is not None:
            return history[:, -2]
        return super().energy(stress)

    def check(self, dim: int) -> None:
        """Try the routine: raise ``ValueError`` where it writes beyond its arguments, or where its
        tangent is not the derivative of its stress."""
        check_guards(self, dim)
        if self.check_tangent:
            check_tangent(self, dim)

    def _ask(self, strain, stress, history, given, with_tangent: bool, first: bool = False):
        """Arrays of the loop, refused unless their shapes agree: compiled loops do not look."""
        strain, stress, history = checked_rows(strain, stress, history, len(self.history))
        n = len(strain)
        size = self._sizes(n, given)
        count = strain.shape[1]
        mine = _frame(self, 2 if count == 4 else 3, first)
        arrays = (
            *(mine.real, mine.whole, mine.offset, mine.integer),
            *(mine.watched, mine.watched_whole),
        )
        out = np.empty_like(stress), np.empty_like(history)
        tangent = np.empty((n, count if with_tangent else 0, count))
        ended, row, said = batch(
            address(self.library, self.build, self.symbol),
            arrays,
            strain,
            stress,
            history,
            self._columns(n, given),
            size,
            (len(self.state_variables), int(self.total_strain), int(self.energies)),
            self.lame,
            out,
            tangent,
        )
        if ended:
            self._stop(ended, row, said, mine, strain, stress)
        return *out, tangent

    def _sizes(self, n: int, given: Given) -> np.ndarray:
        """CELENT (n,), m, or nothing (0,)."""
        if self.length is None:
            return np.zeros(0)
        if "size" not in given:
            raise ValueError(f"size is required, because length = {self.length} is given, got None")
        return np.ascontiguousarray(np.broadcast_to(np.asarray(given["size"], float), n))

    def _columns(self, n: int, given: Given) -> np.ndarray:
        """PROPS, (1, k), or (n, k) where they differ from point to point."""
        numbers = np.array([[value for _, value in self.properties]], float)
        theirs = [k for k, (name, _) in enumerate(self.properties) if name in given]
        if theirs:
            numbers = np.repeat(numbers, n, axis=0)
            for k in theirs:
                numbers[:, k] = given[self.properties[k][0]]
        return numbers

    def _stop(self, ended: int, row: int, said: float, mine: Frame, strain, stress) -> None:
        """Say why the loop ended early."""
        name = self._name
        where = f"at the strain increment {strain[row]} from the stress {stress[row]} Pa"
        if ended == BEYOND:
            place, integer = (int(said), False) if said >= 0 else (-1 - int(said), True)
            raise ValueError(
                f"{name} changes what it must not, in or beyond {mine.owner(place, integer)}: it "
                f"is called with NTENS = {strain.shape[1]}, NSTATV = {len(self.state_variables)} "
                f"and NPROPS = {len(self.properties)}; give as many state_variables as it has"
            )
        if ended == SMALLER:
            raise SolverError(f"{name} asks for a smaller step, PNEWDT = {said:.3g}, {where}")
        if ended == NO_NUMBER:
            unknown = ["COORDS", "DFGRD0", "DFGRD1"]
            unknown += [] if self.total_strain else ["STRAN (say total_strain=True)"]
            unknown += [] if self.length else ["CELENT (give length)"]
            raise SolverError(
                f"{name} gives what is no number, {where}; it may read beyond PROPS or STATEV, of "
                f"which there are {len(self.properties)} and {len(self.state_variables)}, or use "
                f"what a Umat is not told: {', '.join(unknown)}"
            )


@lru_cache(maxsize=64)
def _frame_of(dim: int, states: int, properties: int, name: str, first: bool) -> Frame:
    return frame(dim, states, properties, name, first)


def _frame(law: Umat, dim: int, first: bool) -> Frame:
    """Arguments of a law's calls."""
    name = Path(law.library).stem.encode("ascii", "replace").decode()
    return _frame_of(dim, len(law.state_variables), len(law.properties), name, first)


def _named(what: str, stem: str, values) -> tuple[tuple[str, float], ...]:
    """Names and finite numbers."""
    if not isinstance(values, Mapping):
        listed = several(what, values, "numbers, or numbers by name")
        if listed and all(isinstance(one, tuple) for one in listed):
            values = dict(listed)
        else:
            values = {f"{stem}_{n + 1}": value for n, value in enumerate(listed)}
    return tuple((str(name), finite(f"{name} of {what}", v)) for name, v in values.items())


def _states(states) -> tuple[tuple[str, float], ...]:
    """Names and initial values of state variables that are counted, named or given by name."""
    if isinstance(states, int):
        states = {f"state_{n + 1}": 0.0 for n in range(states)}
    elif not isinstance(states, Mapping):
        names = list(states)
        if names and all(isinstance(one, tuple) for one in names):
            states = dict(names)
        elif all(isinstance(one, str) for one in names) and len(set(names)) == len(names):
            states = dict.fromkeys(names, 0.0)
        else:
            raise ValueError(
                "state_variables must be their number, different names, or initial values by name, "
                f"got {states!r}"
            )
    return _named("state_variables", "state", states)
