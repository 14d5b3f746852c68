"""Waves that come up straight through damped layers, in the frequency domain: transfer functions
of a site (Thomson 1950, Haskell 1953), and records at any depth.

With e^{iωt} and depth z a layer moves by A e^{ikz} + B e^{−ikz}, up-going and down-going, with
k² = ω² ρ(1 − iα/ω)/G*, G* = ρ c² (1 + 2iξ + iωβ): hysteretic damping of the ratio ξ, and Rayleigh
damping α M + β K, which is exact here, not only its ratio α/2ω + βω/2.  At interfaces u and
iωZ (A − B) go on, Z = G* k/ω.  The ratio B/A is carried down from the free surface, where it is 1,
and amplitudes up from the base, so that nothing grows in thick layers.

Shear waves have the speed c_s and move sideways, P waves c_p and up and down.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.fft import next_fast_len

KINDS = "up-going", "outcrop", "within"
_WRAPPED = 1e-4
"""Of the peak: change that a record twice as long may bring."""
_LONGEST = 128
"""Times its length, up to which a record is lengthened by zeros."""


@dataclass(frozen=True)
class HalfSpace:
    """Ground of one kind without an end below: ``density`` (kg/m³), ``speed`` (m/s) and damping.

    ``damping`` is the ratio ξ (of 1) of hysteretic damping, a number or a function of frequencies
    (n,), Hz; ``mass_damping`` α (1/s) and ``stiffness_damping`` β (s) are those of Rayleigh.
    Raises ``ValueError`` naming what is out of range.
    """

    density: float
    speed: float
    damping: float | Callable[[np.ndarray], np.ndarray] = 0.0
    mass_damping: float = 0.0
    stiffness_damping: float = 0.0

    def __post_init__(self) -> None:
        _positive("density", self.density)
        _positive("speed", self.speed)
        for name in ("damping", "mass_damping", "stiffness_damping"):
            value = getattr(self, name)
            if not callable(value) and not 0.0 <= value < np.inf:
                raise ValueError(f"{name} must not be negative, got {value}")
        if not callable(self.damping) and self.damping >= 1.0:
            raise ValueError(
                f"damping must be a ratio below 1, got {self.damping}: 5 % are damping=0.05"
            )

    def damping_ratio(self, frequency: np.ndarray) -> np.ndarray:
        """Ratio (n,), of 1, of all damping at frequencies (n,), Hz: ξ + α/2ω + βω/2."""
        ω = 2 * np.pi * np.asarray(frequency, float)
        return self._hysteretic(ω) + self.mass_damping / (2 * ω) + self.stiffness_damping * ω / 2

    def modulus(self, ω: np.ndarray) -> np.ndarray:
        """Complex modulus G* (n,), Pa, at angular frequencies (n,), 1/s."""
        loss = 2 * self._hysteretic(ω) + ω * self.stiffness_damping
        return self.density * self.speed**2 * (1 + 1j * loss)

    def wavenumber(self, ω: np.ndarray) -> np.ndarray:
        """Complex wavenumber k (n,), 1/m, at angular frequencies (n,), 1/s."""
        return np.sqrt(self.density * ω * (ω - 1j * self.mass_damping) / self.modulus(ω))

    def _hysteretic(self, ω: np.ndarray) -> np.ndarray:
        if not callable(self.damping):
            return np.full(np.shape(ω), float(self.damping))
        ratio = np.asarray(self.damping(ω / (2 * np.pi)), float)
        if ratio.shape not in ((), np.shape(ω)) or not (ratio >= 0).all():
            raise ValueError(
                "damping must map frequencies (n,), Hz, to (n,) ratios that are not negative, gave "
                f"{ratio}"
            )
        return np.broadcast_to(ratio, np.shape(ω))


@dataclass(frozen=True, kw_only=True)
class Layer(HalfSpace):
    """A layer of ``thickness`` (m); the other parameters are those of ``HalfSpace``."""

    thickness: float

    def __post_init__(self) -> None:
        super().__post_init__()
        _positive("thickness", self.thickness)


class _Waves(NamedTuple):
    """Of each layer from the top, then of the half-space (layers + 1, n): wavenumber, modulus,
    up-going amplitude at its top and down-going over up-going there; (layers, n): up-going
    amplitude at the bottom."""

    k: np.ndarray
    modulus: np.ndarray
    top: np.ndarray
    ratio: np.ndarray
    bottom: np.ndarray


@dataclass(frozen=True)
class LayeredGround:
    """Level ground of ``layers`` from the surface down, on a half-space or, with None as ``base``,
    on a rigid base.

    Motions go by the motion of the base at its top, of one of three kinds: ``"up-going"``, that of
    the wave which comes in; ``"outcrop"``, twice that, the motion of the base were it bare; or
    ``"within"``, that of the base under the layers, up-going and down-going together.  Of a rigid
    base only the last is known.
    Raises ``ValueError`` for what are no layers, other kinds and depths outside the ground.
    """

    layers: tuple[Layer, ...]
    base: HalfSpace | None

    def __post_init__(self) -> None:
        object.__setattr__(self, "layers", tuple(self.layers))
        wrong = [layer for layer in self.layers if not isinstance(layer, Layer)]
        if wrong or not self.layers:
            raise ValueError(f"layers must be Layer objects, one or more, got {self.layers!r}")
        if self.base is not None and type(self.base) is not HalfSpace:
            raise ValueError(
                f"base must be a HalfSpace, or None for a rigid one, got {self.base!r}"
            )

    @property
    def depth(self) -> float:
        """Depth (m) of the base."""
        return float(sum(layer.thickness for layer in self.layers))

    def transfer(
        self, frequency: np.ndarray, depth: float = 0.0, kind: str = "up-going"
    ) -> np.ndarray:
        """Complex motion (n,) at ``depth`` (m) over that of ``kind``, at frequencies (n,), Hz."""
        waves = self._waves(frequency, kind)
        up, down = self._amplitudes(waves, depth)
        return (up + down).reshape(np.shape(frequency))

    def strain_transfer(
        self, frequency: np.ndarray, depth: float, kind: str = "up-going"
    ) -> np.ndarray:
        """Complex strain (n,), 1/m, at ``depth`` (m) over the displacement of ``kind``, at
        frequencies (n,), Hz: ∂u/∂y with y upwards, in the upper layer at an interface."""
        waves = self._waves(frequency, kind)
        up, down = self._amplitudes(waves, depth)
        k = waves.k[self._layer_at(depth)]
        return (1j * k * (down - up)).reshape(np.shape(frequency))

    def stress_transfer(
        self, frequency: np.ndarray, depth: float, kind: str = "up-going"
    ) -> np.ndarray:
        """Complex stress (n,), Pa/m, at ``depth`` (m) over the displacement of ``kind``, at
        frequencies (n,), Hz: that on a face that looks upwards, G* times the strain."""
        layer = [*self.layers, self.base][self._layer_at(depth)]
        modulus = layer.modulus(_angular(frequency, self)).reshape(np.shape(frequency))
        return modulus * self.strain_transfer(frequency, depth, kind)

    def motion_at(
        self,
        depth: float,
        record: np.ndarray,
        dt: float,
        kind: str = "up-going",
        quiet: float | None = None,
    ) -> np.ndarray:
        """Motion (n,) at ``depth`` (m) of a ``record`` (n,) of ``kind``, every ``dt`` (s).

        Displacements give displacements, velocities and accelerations likewise.  ``quiet``: time
        (s) at rest after the record, in which the ground comes to rest; without it, as long as it
        takes for twice of it to change nothing by 1e-4 of the peak.
        Raises ``ValueError`` where 128 times the record are not enough: undamped ground on a rigid
        base never rests.
        """
        return self._in_time(lambda f: self.transfer(f, depth, kind), record, dt, quiet)

    def strain_at(
        self,
        depth: float,
        acceleration: np.ndarray,
        dt: float,
        kind: str = "up-going",
        quiet: float | None = None,
    ) -> np.ndarray:
        """Strain (n,) at ``depth`` (m) of a record of ``acceleration`` (n,), m/s², as
        ``motion_at``."""

        def transfer(frequency: np.ndarray) -> np.ndarray:
            return self.strain_transfer(frequency, depth, kind) / -(_angular(frequency, self) ** 2)

        return self._in_time(transfer, acceleration, dt, quiet)

    def stress_at(
        self,
        depth: float,
        acceleration: np.ndarray,
        dt: float,
        kind: str = "up-going",
        quiet: float | None = None,
    ) -> np.ndarray:
        """Stress (n,), Pa, at ``depth`` (m) of a record of ``acceleration`` (n,), m/s², as
        ``motion_at``: σ_xy of shear waves along x, σ_yy of P waves, y upwards; what damps is
        part of it."""

        def transfer(frequency: np.ndarray) -> np.ndarray:
            return self.stress_transfer(frequency, depth, kind) / -(_angular(frequency, self) ** 2)

        return self._in_time(transfer, acceleration, dt, quiet)

    def _in_time(self, transfer: Callable, record: np.ndarray, dt: float, quiet) -> np.ndarray:
        record = np.asarray(record, float)
        if record.ndim != 1 or len(record) < 2 or not np.isfinite(record).all():
            raise ValueError(
                f"record must be finite numbers (n,), at even times, got shape {record.shape}"
            )
        _positive("dt", dt)
        n = len(record)

        def answer(many: int) -> np.ndarray:
            spectrum = np.fft.rfft(record, many) * transfer(np.fft.rfftfreq(many, dt))
            return np.fft.irfft(spectrum, many)[:n]

        if quiet is not None:
            return answer(next_fast_len(n + int(np.ceil(quiet / dt)), real=True))
        many = next_fast_len(2 * n, real=True)
        before = answer(many)
        while many < _LONGEST * n:
            many = next_fast_len(2 * many, real=True)
            found = answer(many)
            if np.abs(found - before).max() <= _WRAPPED * np.abs(found).max():
                return found
            before = found
        raise ValueError(
            f"the ground does not come to rest in {many * dt:.4g} s, {_LONGEST} times the record: "
            "damp its layers, put it on a HalfSpace, or say by quiet=... how long to wait (s)"
        )

    def _waves(self, frequency: np.ndarray, kind: str) -> _Waves:
        """Waves at frequencies (n,), Hz, of a motion of 1 of ``kind``."""
        if kind not in KINDS:
            raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {kind!r}")
        if self.base is None and kind != "within":
            raise ValueError(
                f"kind must be 'within' on a rigid base, got {kind!r}: only its own motion is "
                "known there"
            )
        ω, count = _angular(frequency, self), len(self.layers)
        grounds = [*self.layers, *([] if self.base is None else [self.base])]
        k = np.array([ground.wavenumber(ω) for ground in grounds])
        modulus = np.array([ground.modulus(ω) for ground in grounds])
        across = np.exp([-1j * k[j] * self.layers[j].thickness for j in range(count)])
        ratio = np.ones_like(k)
        sums = np.ones_like(k)  # of a layer's up-going wave below over that of the next one
        for j in range(count):
            arrived = ratio[j] * across[j] ** 2  # down-going over up-going at its bottom
            if j + 1 < len(grounds):
                Z = k[j] * modulus[j] / (k[j + 1] * modulus[j + 1])
                both, difference = 1 + arrived, Z * (1 - arrived)
                ratio[j + 1] = (both - difference) / (both + difference)
                sums[j] = 2 / (both + difference)
            else:
                sums[j] = 1 / (1 + arrived)
        top, bottom = np.ones_like(k), np.ones_like(across)
        if self.base is not None:
            top[-1] = {"up-going": 1.0, "outcrop": 0.5, "within": 1 / (1 + ratio[-1])}[kind]
        for j in reversed(range(count)):
            bottom[j] = sums[j] * (top[j + 1] if j + 1 < len(grounds) else 1.0)
            top[j] = bottom[j] * across[j]
        return _Waves(k, modulus, top, ratio, bottom)

    def _amplitudes(self, waves: _Waves, depth: float) -> tuple[np.ndarray, np.ndarray]:
        """Up-going and down-going motion (n,) at ``depth``."""
        j = self._layer_at(depth)
        z = depth - sum(layer.thickness for layer in self.layers[:j])
        k, down = waves.k[j], waves.top[j] * waves.ratio[j]
        if j == len(self.layers):
            return waves.top[j] * np.exp(1j * k * z), down * np.exp(-1j * k * z)
        left = self.layers[j].thickness - z
        return waves.bottom[j] * np.exp(-1j * k * left), down * np.exp(-1j * k * z)

    def _layer_at(self, depth: float) -> int:
        """Number of the layer at ``depth``, at an interface that of the upper one."""
        if not 0.0 <= depth < np.inf or (self.base is None and depth > self.depth * (1 + 1e-12)):
            deepest = "" if self.base is not None else f" and {self.depth} m, the rigid base"
            raise ValueError(f"depth must lie between 0{deepest}, got {depth}")
        bottoms = np.cumsum([layer.thickness for layer in self.layers])
        j = int(np.searchsorted(bottoms, depth))
        return min(j, len(self.layers) - (self.base is None))


def _angular(frequency: np.ndarray, ground: LayeredGround) -> np.ndarray:
    """Angular frequencies (n,), 1/s, of frequencies (n,), Hz, and for 0 so low a one that it is the
    limit."""
    f = np.atleast_1d(np.asarray(frequency, float))
    if f.ndim != 1 or not (np.isfinite(f).all() and (f >= 0).all()):
        raise ValueError(f"frequency must be numbers (n,), Hz, not negative, got {frequency}")
    travel = sum(layer.thickness / layer.speed for layer in ground.layers)
    return np.where(f == 0.0, 1e-9 / travel, 2 * np.pi * f)


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise ValueError(f"{name} must be positive, got {value}")


def split(layers: Sequence[Layer], most: float) -> tuple[Layer, ...]:
    """The same layers, each in as few equal ones as are no thicker than ``most`` (m)."""
    _positive("most", most)
    found = []
    for layer in layers:
        parts = int(np.ceil(layer.thickness / most - 1e-9))
        found += [replace(layer, thickness=layer.thickness / parts)] * parts
    return tuple(found)
