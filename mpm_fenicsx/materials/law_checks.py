"""Materials: whether a law has what a run asks of it, and does what a run takes it to do."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from ..common import tensors
from ..common.checks import array, in_short, positive
from .material import stiffness

NEEDED = {
    "density": "kg/m³",
    "lame": "λ and μ, Pa",
    "kinematics": "SMALL_STRAIN or FINITE_STRAIN",
    "linear": "True where λ and μ are all its response",
    "symmetric": "whether its tangent is",
    "history": "names of what it remembers, () for nothing",
    "parameters": "names of those that may differ from point to point, () for none",
    "length": "m, None where size plays no part",
    "keeps_volume": "whether flow keeps the volume, or ties it to shear",
    "moduli": "of stress and history, λ and μ, Pa",
    "respond": "of strain, stress, history and parameters",
    "energy": "of stress rows and history, J/m³",
}
BEYOND = {
    "initial_history": "of stress and parameters",
    "tangent": "of strain, stress, history and parameters",
    "plastic_work": "of history and parameters, J/m³",
}
"""What a law needs that is not linear."""
PROBES = 10.0 ** np.arange(-8, 0)
"""Sizes of strain that a law without history is asked for; any that yields at all does so at the
largest."""
AT_REST = 1e-6
"""Of the bulk modulus: a pressure under which no law yields."""
APART = 0.1
"""Of the stiffness of λ and μ: a tangent at rest that is less, or as many times more, is
doubted."""
LINEAR = 1e-9
"""Of the stress increment: what an elastic law may differ by from C : ε."""
SYMMETRIC = 1e-8
"""Of its largest entry: so much may a tangent be askew that is symmetric but for round-off."""


def has(name: str, thing, attributes: Sequence[str]) -> None:
    """Raise ``ValueError`` naming ``name`` and which of ``attributes`` it lacks, or that it is a
    class."""
    if isinstance(thing, type):
        raise ValueError(
            f"{name} must be an object, got {in_short(thing)}: call it with its numbers"
        )
    known = {**NEEDED, **BEYOND}
    missing = [
        f"{a} ({known[a]})" if a in known else a for a in attributes if not hasattr(thing, a)
    ]
    if missing:
        raise ValueError(
            f"{name} lacks {', '.join(missing)}, which a class that inherits from Law has, such as "
            f"LinearElastic(young, poisson, density), got {in_short(thing)}"
        )


def check_law(material, dim: int) -> None:
    """Raise ``ValueError`` for a material that a run in ``dim`` dimensions cannot take.

    One that lacks parts: all that are missing are named.  One that says that it is linear and is
    not, or that its tangent is symmetric and is not.  A law that has ``check(dim)`` is asked that
    first, and one that has ``check_pressure`` (Pa) and ``check_strain`` is tried there.
    """
    if isinstance(material, list | tuple):
        raise ValueError(f"material must be one object, got {material!r}")
    linear = bool(getattr(material, "linear", True))
    finite = bool(getattr(getattr(material, "kinematics", None), "finite", False))
    more = [] if linear else [*BEYOND, "strain" if finite else "yields"]
    has("material", material, [*NEEDED, *more])
    for name in ("history", "parameters"):
        names = getattr(material, name)
        if not isinstance(names, tuple | list) or not all(isinstance(n, str) for n in names):
            raise ValueError(
                f'{name} of material must be a tuple of names, such as ("plastic_strain",), got '
                f"{names!r}"
            )
    has(
        "kinematics of material",
        material.kinematics,
        ("respond", "plastic_work", "moduli", "reference", "energy", "finite"),
    )
    positive("density of material", material.density)
    lame = array("lame of material", material.lame)
    if lame.shape != (2,) or not np.isfinite(lame).all():
        raise ValueError(
            f"lame of material must be two finite numbers λ and μ (Pa), got {material.lame!r}"
        )
    if not (lame[1] > 0.0 and 3.0 * lame[0] + 2.0 * lame[1] > 0.0):
        raise ValueError(
            f"lame of material must have μ > 0 and λ + 2μ/3 > 0 (Pa), got {material.lame!r}"
        )
    if linear:
        if finite:
            raise ValueError(f"material: {type(material).__name__} of finite strain is not linear")
        _refuse_unless_linear(material, dim)
    else:
        if hasattr(material, "check"):
            material.check(dim)
        _refuse_unless_as_it_says(material, dim)


def _probes(dim: int) -> np.ndarray:
    """Strain rows (n, components) of many sizes and directions."""
    count = tensors.components(dim)
    rng = np.random.default_rng(0)
    directions = np.concatenate((np.eye(count), -np.eye(count), rng.normal(size=(4, count))))
    if dim == 2:
        directions[:, 2] = 0.0  # plane strain
    directions = directions[np.abs(directions).max(axis=1) > 0.0]
    return (PROBES[:, None, None] * directions).reshape(-1, count)


def _refuse_unless_as_it_says(material, dim: int) -> None:
    """Ask a law for its tangent after strains of many sizes, and for its plastic work."""
    strain = _probes(dim) * (getattr(material, "check_strain", PROBES[-1]) / PROBES[-1])
    stress, name = np.zeros_like(strain), type(material).__name__
    stress[:, :3] -= getattr(material, "check_pressure", 0.0)
    given = {"size": np.full(len(strain), material.length)} if material.length else {}
    try:
        history = np.asarray(material.initial_history(stress, given), float)
        if history.shape != (len(strain), len(material.history)):
            raise ValueError(
                f"initial_history must be {(len(strain), len(material.history))} numbers, one "
                f"column a name in history = {material.history}, got shape {history.shape}"
            )
        inputs = strain.copy(), stress.copy(), history.copy()
        new, after, tangent = material.tangent(*inputs, given)
        again, _ = material.respond(*inputs, given)
        work = material.plastic_work(history, given)
    except Exception as error:
        raise ValueError(f"material: {name} cannot be asked for its response: {error}") from error
    count = strain.shape[1]
    for what, value, shape in (
        ("stress", new, strain.shape),
        ("history", after, history.shape),
        ("tangent", tangent, (*strain.shape, count)),
        ("plastic_work", work, (len(strain),)),
    ):
        if np.shape(value) != shape:
            raise ValueError(
                f"material: {what} of {name} must be {shape} numbers for {len(strain)} points in "
                f"{dim}D, got shape {np.shape(value)}"
            )
    for what, before, now in zip(
        ("strain", "stress", "history"), (strain, stress, history), inputs, strict=True
    ):
        if not np.array_equal(before, now):
            raise ValueError(
                f"material: {name} changes the {what} that it is given: it must return new arrays"
            )
    if not material.kinematics.finite:
        _refuse_total_strain(material, dim)
    size = np.abs(new).max(initial=np.finfo(float).tiny)
    if not np.allclose(again, new, rtol=1e-9, atol=1e-9 * size, equal_nan=True):
        raise ValueError(f"material: respond and tangent of {name} give different stresses")
    if not material.symmetric:
        return
    plane = tensors.in_plane(dim)
    tangent = np.asarray(tangent)[:, plane[:, None], plane]
    askew = np.abs(tangent - tangent.transpose(0, 2, 1)).max(axis=(1, 2))
    askew /= np.abs(tangent).max(axis=(1, 2), initial=np.finfo(float).tiny)
    row = int(np.argmax(np.where(np.isfinite(askew), askew, 0.0)))
    if askew[row] > SYMMETRIC:
        raise ValueError(
            f"material: {name} says symmetric = True, and its tangent is askew by "
            f"{askew[row]:.2g} of its largest entry after the strain {strain[row]}: say "
            "symmetric = False, and it is carried whole"
        )


def _refuse_total_strain(material, dim: int) -> None:
    """Ask for the stress after no strain at all: it is what it was, here a small pressure, or the
    one under which the law is to be looked at."""
    λ, μ = material.lame
    before = np.zeros((1, tensors.components(dim)))
    before[:, :3] = -(getattr(material, "check_pressure", 0.0) or AT_REST * (λ + 2 * μ / 3))
    given = {"size": np.full(1, material.length)} if material.length else {}
    history = np.asarray(material.initial_history(before, given), float)
    new, _, tangent = material.tangent(np.zeros_like(before), before.copy(), history, given)
    name = type(material).__name__
    if not np.abs(new - before).max() <= 0.5 * np.abs(before).max():
        raise ValueError(
            f"material: without any strain {name} makes of the stress {before[0]} Pa {new[0]}: "
            "strain is the increment of the step, and what a law returns is the stress that was "
            "there and what the increment adds"
        )
    plane = tensors.in_plane(dim)
    moduli = tuple(float(np.ravel(value)[0]) for value in material.moduli(before, history))
    found = np.abs(np.asarray(tangent)[0][plane[:, None], plane]).max()
    known = np.abs(stiffness(moduli, dim)).max()
    if not APART * known < found < known / APART:
        warnings.warn(
            f"material: the tangent of {name} at rest has entries up to {found:.3g} Pa, and those "
            f"of its λ and μ = {moduli} are up to {known:.3g} Pa: energies and the first solve of "
            "a step go by λ and μ",
            UserWarning,
            stacklevel=5,
        )


def _refuse_unless_linear(material, dim: int) -> None:
    """Ask a law that says that it is linear for stress after strains of many sizes, and compare
    with C : ε."""
    strain = _probes(dim)
    λ, μ = material.lame
    linear = μ * strain
    linear[:, :3] = 2 * μ * strain[:, :3] + λ * strain[:, :3].sum(axis=1, keepdims=True)
    rng = np.random.default_rng(0)
    start = np.abs(linear).max() * rng.normal(size=strain.shape[1]) * [1e-3]
    start = np.broadcast_to(start, strain.shape).copy()
    what = f"{type(material).__name__} says linear = True"
    cure = "say linear = False, and give it a tangent"
    for before in (np.zeros_like(strain), start):
        try:
            found, _ = material.respond(strain.copy(), before.copy(), None)
            found = np.asarray(found, float).reshape(strain.shape) - before
        except Exception as error:
            raise ValueError(
                f"material: {what}, and cannot be asked for its stress: {error}; {cure}"
            ) from error
        size = np.abs(linear).max(axis=1) + np.finfo(float).eps * np.abs(before).max() / LINEAR
        off = np.abs(found - linear).max(axis=1) / size
        row = int(np.argmax(np.where(np.isfinite(off), off, np.inf)))
        if not off[row] <= LINEAR:
            raise ValueError(
                f"material: {what}, and is not: its stress differs from that of its lame = "
                f"{tuple(material.lame)} by {off[row]:.2g} of itself at the strain {strain[row]}; "
                f"{cure}"
            )
