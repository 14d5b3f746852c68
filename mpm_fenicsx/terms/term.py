"""What a term is: a load, a support, a boundary, a stabilisation, damping.

A term of your own is one class in one file.  It needs ``bind`` and nothing else:

    @dataclass(frozen=True)
    class Winkler:
        on: Surface
        stiffness: float  # Pa/m

        def bind(self, scene):
            patch, motion = scene.patch(self.on), scene.motion
            ...
            return Contribution(work=form * patch.measure)
"""

from __future__ import annotations

from typing import Protocol

from .contribution import Contribution
from .scene import Scene


class Term(Protocol):
    """A load, a support, a boundary, a stabilisation, damping."""

    def bind(self, scene: Scene) -> Contribution:
        """What the term does in a run, whose motion, fields and surfaces ``scene`` has.

        Called once, when the run is built.  Raises ``ValueError`` naming what the scene cannot
        serve.
        """
