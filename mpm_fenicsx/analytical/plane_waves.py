"""Plane waves that come up through a homogeneous elastic half-space, and what its free surface
sends back.

A wave u = d f(t − s·x) has the slowness s of length 1/c, and moves along the unit vector d; its
stress is −(λ (s·d) I + μ (s dᵀ + d sᵀ)) f'.  All waves share the horizontal slowness p = sin θ/c
of the one that comes in (Snell's law).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

KINDS = "P", "SV", "SH"
_SHEAR = {2: ((0, 1),), 3: ((0, 1), (1, 2), (0, 2))}
"""Components of stress rows after xx, yy, zz."""


@dataclass(frozen=True, eq=False)
class PlaneWaves:
    """A plane wave that comes up through elastic ground, and its reflections at a free surface.

    ``kind``: P, SV or SH, which moves horizontally across the plane of the wave and needs 3D.
    ``angle`` (degrees) from the vertical, between −90 and 90, both excluded: a positive one travels
    towards ``azimuth``, which is +x in 2D, a negative one away from it.  ``density`` (kg/m³),
    ``p_speed`` and ``s_speed`` (m/s) are those of the ground.
    ``motion`` is that of the incoming wave alone at ``origin`` (dim,), m: an object with functions
    ``displacement`` (m), ``velocity`` (m/s) and ``acceleration`` (m/s²) of an array of times (s),
    such as a ``Waveform``.  Positive is P along the direction of travel, thus upwards; SV along
    (cos θ, −sin θ), towards the azimuth and upwards; SH towards ``azimuth`` + 90°.
    ``surface``: height (m) of the free surface, or None for a full space, in which nothing comes
    back.  ``dim`` 2 or 3; ``up``: the vertical axis, 1 (y), in 3D also 2 (z); ``azimuth``
    (degrees, 3D): direction of travel, from x towards the other horizontal axis.

    Places may lie above the surface: the waves are the same there, and unbounded.

    Raises ``ValueError`` naming what is out of range; for SV waves beyond the critical angle
    arcsin(c_s/c_p), whose reflected P wave does not travel and has no form that a delay could give,
    where there is a surface; for SH in 2D; and for an ``origin`` above the surface.
    """

    kind: str
    angle: float
    density: float
    p_speed: float
    s_speed: float
    motion: object
    origin: tuple[float, ...]
    surface: float | None = None
    dim: int = 2
    up: int = 1
    azimuth: float = 0.0

    def __post_init__(self) -> None:
        if self.dim not in (2, 3):
            raise ValueError(f"dim must be 2 or 3, got {self.dim}")
        if self.up not in range(1, self.dim):
            axes = "1" if self.dim == 2 else "1 or 2"
            raise ValueError(f"up must be {axes} in {self.dim}D, got {self.up}")
        _check_wave(self.kind, self.angle, self.p_speed, self.s_speed)
        if self.kind == "SH" and self.dim == 2:
            raise ValueError(
                "kind must be P or SV in 2D, got 'SH', which moves out of the plane: take dim=3"
            )
        if not (np.isfinite(self.density) and self.density > 0):
            raise ValueError(f"density must be positive, got {self.density}")
        if not np.isfinite(self.azimuth) or (self.dim == 2 and self.azimuth != 0):
            raise ValueError(
                f"azimuth must be finite, and 0 in 2D, got {self.azimuth}: a wave towards −x in 2D "
                "has a negative angle"
            )
        origin = np.asarray(self.origin, float)
        if origin.shape != (self.dim,) or not np.isfinite(origin).all():
            raise ValueError(f"origin must be {self.dim} numbers (m), got {self.origin}")
        if self.surface is not None and not origin[self.up] <= self.surface < np.inf:
            raise ValueError(
                f"surface must not be below origin, at {origin[self.up]} m, got {self.surface}"
            )
        object.__setattr__(self, "origin", tuple(origin.tolist()))
        along, across, vertical = self._axes()
        to_surface = 0.0 if self.surface is None else self.surface - origin[self.up]
        directions, slownesses, amplitudes = [], [], []
        for type_, way, amplitude in self._waves():
            p = np.sin(np.radians(self.angle)) / self._speed(self.kind)
            c = self._speed(type_)
            q = way * _vertical(p, c)
            slownesses.append(p * along + q * vertical)
            direction = {
                "P": c * (p * along + q * vertical),
                "SV": way * c * (q * along - p * vertical),
                "SH": across,
            }
            directions.append(direction[type_])
            amplitudes.append(amplitude)
        s = np.array(slownesses)
        # to the surface straight above the origin with the incoming wave, from there with its own
        reference = to_surface * (s[0] - s) @ vertical
        object.__setattr__(self, "_slowness", s)
        object.__setattr__(self, "_direction", np.array(directions))
        object.__setattr__(self, "_amplitude", np.array(amplitudes))
        object.__setattr__(self, "_reference", reference)

    def displacement(self, t: float, x: np.ndarray, incoming_only: bool = False) -> np.ndarray:
        """Displacement (n, dim), m, at time ``t`` (s) of places ``x`` (n, dim), m."""
        return self._moved("displacement", t, x, incoming_only)

    def velocity(self, t: float, x: np.ndarray, incoming_only: bool = False) -> np.ndarray:
        """Velocity (n, dim), m/s, at time ``t`` (s) of places ``x`` (n, dim), m."""
        return self._moved("velocity", t, x, incoming_only)

    def acceleration(self, t: float, x: np.ndarray, incoming_only: bool = False) -> np.ndarray:
        """Acceleration (n, dim), m/s², at time ``t`` (s) of places ``x`` (n, dim), m."""
        return self._moved("acceleration", t, x, incoming_only)

    def stress(self, t: float, x: np.ndarray, incoming_only: bool = False) -> np.ndarray:
        """Stress (n, 4 or 6), Pa, tension positive, at time ``t`` (s) of places ``x`` (n, dim), m:
        rows of xx, yy, zz, xy in plane strain, and yz, xz in 3D.  It needs the velocity."""
        f = self._of_motion("velocity", t, x, incoming_only)
        μ = self.density * self.s_speed**2
        λ = self.density * self.p_speed**2 - 2 * μ
        rows = np.zeros((len(f), 3 + len(_SHEAR[self.dim])))
        for k, (s, d) in enumerate(zip(self._slowness[: len(f)], self._direction, strict=False)):
            rows[k, :3] = -λ * (s @ d)
            rows[k, : self.dim] -= 2 * μ * s * d
            for j, (a, b) in enumerate(_SHEAR[self.dim]):
                rows[k, 3 + j] = -μ * (s[a] * d[b] + s[b] * d[a])
        return f.T @ rows

    def traction(
        self, t: float, x: np.ndarray, normal: np.ndarray, incoming_only: bool = False
    ) -> np.ndarray:
        """Traction (n, dim), Pa, on the body whose outward unit normals are ``normal`` (n, dim), or
        (dim,) for all, at time ``t`` (s) of places ``x`` (n, dim), m."""
        rows = self.stress(t, x, incoming_only)
        n = np.broadcast_to(np.asarray(normal, float), (len(rows), self.dim))
        found = rows[:, : self.dim] * n
        for j, (a, b) in enumerate(_SHEAR[self.dim]):
            found[:, a] += rows[:, 3 + j] * n[:, b]
            found[:, b] += rows[:, 3 + j] * n[:, a]
        return found

    def delays(self, x: np.ndarray, incoming_only: bool = False) -> np.ndarray:
        """Delays (waves, n), s, of the motion at places ``x`` (n, dim), m: of the incoming wave,
        then of those that are reflected; negative where a wave comes by earlier than at
        ``origin``."""
        x = np.asarray(x, float)
        if x.ndim != 2 or x.shape[1] != self.dim:
            raise ValueError(f"x must be places (n, {self.dim}), got shape {x.shape}")
        count = 1 if incoming_only else len(self._amplitude)
        return self._reference[:count, None] + self._slowness[:count] @ (x - self.origin).T

    def _moved(self, name: str, t: float, x: np.ndarray, incoming_only: bool) -> np.ndarray:
        f = self._of_motion(name, t, x, incoming_only)
        return f.T @ self._direction[: len(f)]

    def _of_motion(self, name: str, t: float, x: np.ndarray, incoming_only: bool) -> np.ndarray:
        """Motion (waves, n) of each wave along its direction."""
        function = getattr(self.motion, name, None)
        if not callable(function):
            raise ValueError(
                f"motion must have a function {name} of time, has {function!r}: give motion.{name}"
            )
        times = np.asarray(t, float) - self.delays(x, incoming_only)
        try:
            values = np.asarray(function(times.ravel()), float)
        except Exception as error:
            raise ValueError(
                f"motion.{name} must take an array of times (n,), s, raises "
                f"{type(error).__name__}: {error}"
            ) from error
        if values.shape not in ((), (times.size,)):
            raise ValueError(
                f"motion.{name} must map times (n,) to (n,) numbers, gave shape {values.shape} for "
                f"n={times.size}"
            )
        values = np.broadcast_to(values, (times.size,)).reshape(times.shape)
        return self._amplitude[: len(times), None] * values

    def _axes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Unit vectors (dim,): along the azimuth, across it and upwards."""
        unit = np.eye(self.dim)
        first = unit[0]
        second = unit[3 - self.up] if self.dim == 3 else np.zeros(2)
        α = np.radians(self.azimuth)
        along = np.cos(α) * first + np.sin(α) * second
        across = np.cos(α) * second - np.sin(α) * first
        return along, across, unit[self.up]

    def _waves(self) -> list[tuple[str, int, float]]:
        """(kind, 1 up or −1 down, amplitude) of the incoming wave, then of the reflected ones that
        have an amplitude."""
        waves = [(self.kind, 1, 1.0)]
        if self.surface is None:
            return waves
        back = reflection(self.kind, self.angle, self.p_speed, self.s_speed)
        return waves + [(kind, -1, value) for kind, value in back.items() if value]

    def _speed(self, kind: str) -> float:
        return self.p_speed if kind == "P" else self.s_speed


def reflection(kind: str, angle: float, p_speed: float, s_speed: float) -> dict[str, float]:
    """Amplitudes of the waves that a free surface sends down, by their kind, over that of the
    ``kind`` P, SV or SH that comes up at ``angle`` (degrees from the vertical).

    With B = 1 − 2 c_s² p², C = 4 c_s⁴ p² q_p q_s, q the vertical slownesses:
    P: (C − B²)/(C + B²) as P, 4 c_p c_s p q_p B/(C + B²) as SV;
    SV: (B² − C)/(C + B²) as SV, 4 (c_s³/c_p) p q_s B/(C + B²) as P;  SH: 1.
    Positive is P along its direction of travel, down, and SV along (cos θ, sin θ), up again.
    Raises ``ValueError`` as ``PlaneWaves`` does.
    """
    p, q_p, q_s, B, C = _at_surface(kind, angle, p_speed, s_speed)
    if kind == "SH":
        return {"SH": 1.0}
    same = (C - B**2) / (C + B**2)
    if kind == "P":
        return {"P": same, "SV": 4 * p_speed * s_speed * p * q_p * B / (C + B**2)}
    return {"SV": -same, "P": 4 * s_speed**3 / p_speed * p * q_s * B / (C + B**2)}


def critical_angle(p_speed: float, s_speed: float) -> float:
    """Angle (degrees) arcsin(c_s/c_p) beyond which an SV wave sends no P wave down."""
    return float(np.degrees(np.arcsin(s_speed / p_speed)))


def surface_motion(kind: str, angle: float, p_speed: float, s_speed: float) -> np.ndarray:
    """Motion (3,) of a free surface over that of the ``kind`` P, SV or SH that comes up at
    ``angle`` (degrees from the vertical): along the azimuth, across it and upwards.

    With B and C of ``reflection`` and D = B² + C (Aki & Richards, Quantitative Seismology):
    P: (4 c_p c_s² p q_p q_s, 0, 2 c_p q_p B)/D;  SV: (2 c_s q_s B, 0, −4 c_s³ p q_p q_s)/D;
    SH: (0, 2, 0).  Raises ``ValueError`` as ``PlaneWaves`` does.
    """
    p, q_p, q_s, B, C = _at_surface(kind, angle, p_speed, s_speed)
    if kind == "SH":
        return np.array([0.0, 2.0, 0.0])
    if kind == "P":
        both = np.array([2 * s_speed**2 * p * q_s, 0.0, B]) * 2 * p_speed * q_p
    else:
        both = np.array([B, 0.0, -2 * s_speed**2 * p * q_p]) * 2 * s_speed * q_s
    return both / (B**2 + C)


def _at_surface(kind: str, angle: float, p_speed: float, s_speed: float) -> tuple[float, ...]:
    """p, q_p, q_s (s/m), B and C of ``reflection``."""
    _check_wave(kind, angle, p_speed, s_speed)
    p = float(np.sin(np.radians(angle)) / (p_speed if kind == "P" else s_speed))
    if kind == "SV" and abs(p) * p_speed > 1 + 1e-12:
        raise ValueError(
            f"angle must be at most {critical_angle(p_speed, s_speed):.2f}°, the critical angle of "
            f"SV waves in this ground, got {angle}: beyond it the reflected P wave does not travel"
        )
    q_p, q_s = _vertical(p, p_speed), _vertical(p, s_speed)
    return p, q_p, q_s, 1 - 2 * (s_speed * p) ** 2, 4 * s_speed**4 * p**2 * q_p * q_s


def _vertical(p: float, speed: float) -> float:
    """Vertical slowness (s/m) of the horizontal one."""
    return float(np.sqrt(max(0.0, 1 / speed**2 - p**2)))


def _check_wave(kind: str, angle: float, p_speed: float, s_speed: float) -> None:
    if kind not in KINDS:
        raise ValueError(f"kind must be one of {', '.join(KINDS)}, got {kind!r}")
    if not -90 < angle < 90:
        raise ValueError(
            f"angle must lie between -90 and 90, both excluded, in degrees from the vertical, got "
            f"{angle}"
        )
    if not (0 < s_speed < np.inf and np.sqrt(4 / 3) * s_speed < p_speed < np.inf):
        raise ValueError(
            f"p_speed must be above √(4/3) s_speed, and both positive (m/s), got p_speed={p_speed} "
            f"and s_speed={s_speed}"
        )
