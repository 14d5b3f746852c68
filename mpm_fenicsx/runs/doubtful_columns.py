"""Columns that can hardly be those of the run's own ground: looked at when a run is built."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..common.checks import in_short
from ..common.ranks import bounds, warn
from ..grid.grid import GridSurface
from ..terms.absorbing import in_words
from ..terms.incident_wave import IncidentWave
from ..terms.incoming import places
from ..terms.rayleigh_damping import RayleighDamping
from ..terms.scene import Scene
from .finite_elements import FiniteElements

ALIKE = 0.02
"""Of impedances: by how much those of the column and of the dashpots beside it may differ."""


def refuse_free_base(column: FiniteElements) -> None:
    """Raise ``ValueError`` for a column with nothing at its base."""
    scene = column.scene
    if not scene.patches and not scene.supports and not any(part.heavy for part in scene.plain):
        raise ValueError(
            "terms of FreeField leave the column free at its base: give it what the run has "
            'there, such as ViscousBoundary and IncidentWave on g.facets("bottom")'
        )


def warn_of_other_terms(scene: Scene, column: FiniteElements) -> None:
    """Warn where another wave comes in below the column than below the run, or other damping acts
    on it."""
    for what, kind, of in (
        ("waves come in", IncidentWave, lambda term: (term.kind, term.wave, term.angle)),
        ("damping acts", RayleighDamping, lambda term: (term.alpha, term.beta, term.material)),
    ):
        run, beside = (
            [of(term) for term in terms if isinstance(term, kind)]
            for terms in (scene.terms, column.terms)
        )
        if set(run) != set(beside):
            warn(
                scene.grid.comm,
                f"FreeField: other {what} in its column, {in_short(beside)}, than in the run, "
                f"{in_short(run)}: level ground beside the side then moves otherwise than it",
                4,
            )


def warn_of_other_impedances(
    scene: Scene, column: FiniteElements, boundaries: Sequence[tuple]
) -> None:
    """Warn of dashpots at the side whose impedances are not those of the column's ground at their
    height."""
    heights, laws = column.grid.centres[:, 1], column.materials
    for on, acting in boundaries:
        x = places(scene, on) if isinstance(on, GridSurface) else on.x
        low, high = bounds(scene.grid.comm, x)
        for number in np.unique(laws.number[(heights > low[1]) & (heights < high[1])]):
            law = laws.materials[number]
            of_ground = law.density * np.array([law.p_speed, law.s_speed])
            for term in acting:
                if not np.allclose(term.impedance, of_ground, rtol=ALIKE, atol=0.0):
                    warn(
                        scene.grid.comm,
                        f"FreeField: between y = {low[1].round(9) + 0.0:g} and "
                        f"{high[1].round(9) + 0.0:g} m its ground has the impedances "
                        f"{in_words(of_ground)}, and {type(term).__name__} beside it "
                        f"{in_words(term.impedance)}: is it the same ground?",
                        4,
                    )
