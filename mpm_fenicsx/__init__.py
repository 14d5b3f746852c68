"""Implicit material point method on DOLFINx grids, with boundaries that absorb waves."""

from .common import requirements as _needs  # noqa: F401  first: it says what is missing

# isort: split
from .common.errors import RunError
from .contact.contact import Contact
from .dynamics.time_stepping import GeneralizedAlpha, Newmark, QuasiStatic
from .grid.grid import Grid
from .mapping.methods import CMPM, DM, DM_C, DM_G, DM_GC, DM_GCL, GIMP, MAPPINGS, MPM, Mapping
from .mapping.velocities import flip, trapezoidal
from .materials import Hencky, LinearElastic, VonMises
from .output.checkpoint import Checkpoint
from .output.recorders import Energy, Probe
from .output.vtk import Snapshots
from .points.material_points import MaterialPoints
from .points.surface_points import SurfacePoints
from .runs.finite_elements import FiniteElements
from .runs.material_points import Simulation
from .runs.options import PAPER, InitialAcceleration
from .solver.acceleration_correction import AccelerationCorrection
from .solver.newton import Newton
from .terms.absorbing import Viscoelastic, Viscous
from .terms.body import Gravity
from .terms.ghost_penalty import GhostPenalty
from .terms.loads import DeadLoad, Traction
from .terms.supports import Fixed

__all__ = [
    "CMPM",
    "DM",
    "DM_C",
    "DM_G",
    "DM_GC",
    "DM_GCL",
    "GIMP",
    "MAPPINGS",
    "MPM",
    "PAPER",
    "AccelerationCorrection",
    "Checkpoint",
    "Contact",
    "DeadLoad",
    "Energy",
    "FiniteElements",
    "Fixed",
    "GeneralizedAlpha",
    "GhostPenalty",
    "Gravity",
    "Grid",
    "Hencky",
    "InitialAcceleration",
    "LinearElastic",
    "Mapping",
    "MaterialPoints",
    "Newmark",
    "Newton",
    "Probe",
    "QuasiStatic",
    "RunError",
    "Simulation",
    "Snapshots",
    "SurfacePoints",
    "Traction",
    "Viscoelastic",
    "Viscous",
    "VonMises",
    "flip",
    "trapezoidal",
]
