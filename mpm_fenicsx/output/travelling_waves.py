"""Waves that travel up and down through a place: what comes in, and what goes back."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..common import tensors
from .recorder import Run
from .recorders import Probe, Series


class TravellingWaves(Series):
    """Velocities of the waves that travel vertically through a place, apart:

        up-going (v − σ/ρc)/2,  down-going (v + σ/ρc)/2,

    σ the traction on a horizontal plane from above and ρc the impedance, of S waves for what moves
    horizontally and of P waves for what moves vertically.  Their sum is the motion within; at a
    free surface the two are equal; below level ground the up-going one is half of what an outcrop
    of the ``material`` there would do.

    ``at`` (dim,), m; ``material``: the elastic ground there.  ``values`` (n, 2, dim), m/s.  Stress
    counts from when it is attached, so that what the ground bears at rest is no wave.
    Raises ``ValueError`` as ``Probe`` does, and for a material without density and speeds.
    """

    def __init__(self, at, material):
        super().__init__()
        missing = [n for n in ("density", "p_speed", "s_speed") if not hasattr(material, n)]
        if missing:
            raise ValueError(
                f"material of TravellingWaves must have {', '.join(missing)}, got {material!r}: "
                "take the elastic ground there, such as LinearElastic"
            )
        self.material = material
        self._velocity, self._stress = Probe("velocity", at), Probe("stress", at)

    @property
    def label(self) -> str:
        """Its name in a checkpoint."""
        return f"TravellingWaves at {self._velocity.at}"

    @property
    def up(self) -> np.ndarray:
        """Velocities (n, dim), m/s, of what travels upwards."""
        return self.values[:, 0]

    @property
    def down(self) -> np.ndarray:
        """Velocities (n, dim), m/s, of what travels downwards."""
        return self.values[:, 1]

    @property
    def total(self) -> np.ndarray:
        """Velocities (n, dim), m/s, of the place."""
        return self.values.sum(axis=1)

    def attach(self, run: Run) -> None:
        """Choose the samples, and take the stress at rest."""
        soil = self.material
        speed = np.full(run.grid.dim, soil.s_speed)
        speed[1] = soil.p_speed
        self._impedance = soil.density * speed
        for probe in (self._velocity, self._stress):
            probe.attach(run)
        self._at_rest = self._traction()
        self._write(run)

    def __call__(self, run: Run) -> None:
        """Write down the two velocities now."""
        for probe in (self._velocity, self._stress):
            probe(run)
        self._write(run)

    def _traction(self) -> np.ndarray:
        return tensors.matrix(self._stress.values[-1:], len(self._impedance))[0, 1]

    def _write(self, run: Run) -> None:
        v = self._velocity.values[-1]
        of_stress = (self._traction() - self._at_rest) / self._impedance
        self.note(run, 0.5 * np.stack((v - of_stress, v + of_stress)))

    def _parts(self) -> dict[str, Probe]:
        return {"velocity/": self._velocity, "stress/": self._stress}

    def state(self) -> dict[str, np.ndarray]:
        """The series, those of its probes and the stress at rest."""
        found = {**super().state(), "at_rest": self._at_rest}
        for start, probe in self._parts().items():
            found |= {start + name: value for name, value in probe.state().items()}
        return found

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from what a checkpoint kept."""
        super().restore(state)
        self._at_rest = state["at_rest"]
        for start, probe in self._parts().items():
            probe.restore({k.removeprefix(start): v for k, v in state.items() if start in k})
