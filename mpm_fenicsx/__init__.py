"""Implicit material point method on DOLFINx grids, with boundaries that absorb waves."""

from . import needs as _needs  # noqa: F401  first: it says what is missing

# isort: split
from .acceleration_correction import AccelerationCorrection
from .checkpoint import Checkpoint
from .contact import Contact
from .failure import RunError
from .finite_elements import FiniteElements
from .ghost_penalty import GhostPenalty
from .grid import Grid
from .mapping import CMPM, DM, DM_C, DM_G, DM_GC, DM_GCL, GIMP, MAPPINGS, MPM, Mapping
from .materials import Hencky, LinearElastic, VonMises
from .newton import Newton
from .options import PAPER, InitialAcceleration
from .output import Snapshots
from .points import MaterialPoints, SurfacePoints
from .recorders import Energy, Probe
from .simulation import Simulation
from .terms import DeadLoad, Fixed, Gravity, Traction, Viscoelastic, Viscous
from .time_stepping import GeneralizedAlpha, Newmark, QuasiStatic
from .velocities import flip, trapezoidal

__all__ = [
    "CMPM", "DM", "DM_C", "DM_G", "DM_GC", "DM_GCL", "GIMP", "MAPPINGS", "MPM", "PAPER",
    "AccelerationCorrection", "Checkpoint", "Contact", "DeadLoad", "Energy", "FiniteElements",
    "Fixed", "GeneralizedAlpha", "GhostPenalty", "Gravity", "Grid", "Hencky", "InitialAcceleration",
    "LinearElastic", "Mapping", "MaterialPoints", "Newmark", "Newton", "Probe", "QuasiStatic",
    "RunError", "Simulation", "Snapshots", "SurfacePoints", "Traction", "Viscoelastic", "Viscous",
    "VonMises", "flip", "trapezoidal",
]
