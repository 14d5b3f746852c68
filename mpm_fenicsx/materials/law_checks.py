"""Materials: whether a law has what a run asks of it, and does what a run takes it to do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..common import tensors
from ..common.checks import array, in_short, positive
from .kinematics import SMALL_STRAIN, FiniteStrain

NEEDED = {
    "density": "kg/m³",
    "lame": "λ and μ, Pa",
    "kinematics": "SMALL_STRAIN or FINITE_STRAIN",
    "history": "names of what it remembers, () for nothing",
    "length": "m, None where size plays no part",
    "energy": "of stress rows, J/m³",
}
PROBES = 10.0 ** np.arange(-8, 0)
"""Sizes of strain that a law without history is asked for; any that yields at all does so at the
largest."""
LINEAR = 1e-9
"""Of the stress increment: what an elastic law may differ by from C : ε."""


def has(name: str, thing, attributes: Sequence[str]) -> None:
    """Raise ``ValueError`` naming ``name`` and which of ``attributes`` it lacks, or that it is a
    class."""
    if isinstance(thing, type):
        raise ValueError(
            f"{name} must be an object, got {in_short(thing)}: call it with its numbers"
        )
    missing = [
        f"{a} ({NEEDED[a]})" if a in NEEDED else a for a in attributes if not hasattr(thing, a)
    ]
    if missing:
        raise ValueError(
            f"{name} lacks {', '.join(missing)}, which LinearElastic(young, poisson, density) or "
            f"VonMises has, got {in_short(thing)}"
        )


def check_law(material, dim: int, response: str = "respond") -> None:
    """Raise ``ValueError`` for a material that a run in ``dim`` dimensions cannot take.

    One that lacks attributes: all that are missing are named.  A law of small strain without
    ``history`` is taken to be linear elastic, with its ``lame`` in the matrix and one solve a step;
    what its ``response`` is not, is refused. ``response``: what the run asks for stress, "respond"
    at material points, "update" in elements.
    """
    if isinstance(material, list | tuple):
        raise ValueError(f"material must be one object, got {material!r}")
    kinematics, history = (
        getattr(material, "kinematics", SMALL_STRAIN),
        getattr(material, "history", ()),
    )
    remembers = history is not None and len(history) > 0 if hasattr(history, "__len__") else False
    finite = isinstance(kinematics, FiniteStrain)
    more = (
        ["respond", "tangent", "strain"]
        if finite
        else ["respond", "tangent", "yields", "elastic"]
        if remembers
        else [response]
    )
    has("material", material, [*NEEDED, *more, *(["plastic_work"] if remembers else [])])
    if not isinstance(history, tuple | list) or not all(isinstance(name, str) for name in history):
        raise ValueError(
            'history of material must be a tuple of names, such as ("plastic_strain",), got '
            f"{history!r}"
        )
    has("kinematics of material", kinematics, ("respond", "plastic_work", "lame", "energy"))
    positive("density of material", material.density)
    lame = array("lame of material", material.lame)
    if lame.shape != (2,) or not np.isfinite(lame).all():
        raise ValueError(
            f"lame of material must be two finite numbers λ and μ (Pa), got {material.lame!r}"
        )
    if remembers and not finite:
        has("elastic of material", material.elastic, ("update", "tangent"))
    elif not finite:
        _refuse_unless_linear(material, dim, response)


def _refuse_unless_linear(material, dim: int, response: str) -> None:
    """Ask a law without history for stress after strains of many sizes, and compare with C : ε."""
    count = tensors.components(dim)
    rng = np.random.default_rng(0)
    directions = np.concatenate((np.eye(count), -np.eye(count), rng.normal(size=(4, count))))
    if dim == 2:
        directions[:, 2] = 0.0  # plane strain
    directions = directions[np.abs(directions).max(axis=1) > 0.0]
    strain = (PROBES[:, None, None] * directions).reshape(-1, count)
    λ, μ = material.lame
    linear = μ * strain
    linear[:, :3] = 2 * μ * strain[:, :3] + λ * strain[:, :3].sum(axis=1, keepdims=True)
    start = np.broadcast_to(
        np.abs(linear).max() * rng.normal(size=count) * [1e-3], strain.shape
    ).copy()
    what = f"a law without history is taken for linear elastic, and {type(material).__name__}"
    cure = (
        'name what it remembers in history, such as history = ("plastic_strain",), even '
        "if that is a dummy"
    )
    for before in (np.zeros_like(strain), start):
        try:
            given = strain.copy(), before.copy()
            found = (
                material.respond(*given, None, None)[0]
                if response == "respond"
                else material.update(*given)
            )
            found = np.asarray(found, float).reshape(strain.shape) - before
        except Exception as error:
            raise ValueError(
                f"material: {what} cannot be asked for its stress: {error}; {cure}"
            ) from error
        size = np.abs(linear).max(axis=1) + np.finfo(float).eps * np.abs(before).max() / LINEAR
        off = np.abs(found - linear).max(axis=1) / size
        row = int(np.argmax(np.where(np.isfinite(off), off, np.inf)))
        if not off[row] <= LINEAR:
            raise ValueError(
                f"material: {what} is not: its {response} differs from its lame = "
                f"{tuple(material.lame)} by {off[row]:.2g} of the stress at the strain "
                f"{strain[row]}; {cure}"
            )
