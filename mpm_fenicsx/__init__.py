"""Implicit material point method on DOLFINx grids, with boundaries that absorb waves."""

__version__ = "0.1.0"

from .common import requirements as _needs  # noqa: F401  first: it says what is missing

# isort: split
from .analytical.waves import relative_error
from .common import tensors
from .common.errors import RunError
from .common.ranks import end_together as _end_together
from .common.spread import Spread
from .contact.contact import Contact
from .dynamics.record import Record
from .dynamics.spectra import FourierSpectrum, ResponseSpectrum
from .dynamics.time_stepping import GeneralizedAlpha, Newmark, QuasiStatic
from .dynamics.waveform import Waveform
from .grid.grid import Grid
from .grid.stress_field import StressField
from .mapping.methods import (
    CMPM,
    DM,
    DM_C,
    DM_G,
    DM_GC,
    DM_GCL,
    GIMP,
    MAPPINGS,
    MPM,
    AccelerationCorrection,
    Mapping,
)
from .mapping.projection import AT_POINTS, DOUBLE_MAPPED
from .mapping.velocities import flip, trapezoidal
from .materials import (
    Curve,
    DruckerPrager,
    Hencky,
    Hyperbolic,
    Hysteretic,
    LinearElastic,
    MatchedTo,
    ModifiedCamClay,
    MohrCoulomb,
    OnElastic,
    OverNonlocal,
    ReductionCurve,
    Tresca,
    Umat,
    Undrained,
    VonMises,
    hydrostatic,
)
from .materials.material import Law, Material, hooke, stiffness
from .output.checkpoint import Checkpoint
from .output.plot import plot
from .output.recorder import Recorder
from .output.recorders import Energy, Probe, Series
from .output.travelling_waves import TravellingWaves
from .output.vtk import Snapshots
from .points.geostatic_stress import GeostaticStress
from .points.initial_stress import initial_stress
from .points.material_points import MaterialPoints
from .points.surface_points import SurfacePoints
from .runs.finite_elements import FiniteElements
from .runs.free_field import FreeField
from .runs.material_points import Simulation
from .runs.options import PAPER, InitialAcceleration
from .runs.removal import REMOVE, OnExit
from .runs.repartitioning import Repartition
from .solver.newton import Newton
from .solver.solver import Solver
from .terms.absorbing import ViscoelasticBoundary, ViscousBoundary
from .terms.absorbing_layer import AbsorbingLayer
from .terms.body import Gravity
from .terms.contribution import Contribution
from .terms.far_field import FarField
from .terms.ghost_penalty import GhostPenalty
from .terms.incident_wave import IncidentWave
from .terms.loads import DeadLoad, Pressure, Traction
from .terms.rayleigh_damping import RayleighDamping
from .terms.supports import Fixed
from .terms.term import Term
from .terms.tied import Tied

__all__ = [
    "AT_POINTS",
    "CMPM",
    "DM",
    "DM_C",
    "DM_G",
    "DM_GC",
    "DM_GCL",
    "DOUBLE_MAPPED",
    "GIMP",
    "MAPPINGS",
    "MPM",
    "PAPER",
    "REMOVE",
    "AbsorbingLayer",
    "AccelerationCorrection",
    "Checkpoint",
    "Contact",
    "Contribution",
    "Curve",
    "DeadLoad",
    "DruckerPrager",
    "Energy",
    "FarField",
    "FiniteElements",
    "Fixed",
    "FourierSpectrum",
    "FreeField",
    "GeneralizedAlpha",
    "GeostaticStress",
    "GhostPenalty",
    "Gravity",
    "Grid",
    "Hencky",
    "Hyperbolic",
    "Hysteretic",
    "IncidentWave",
    "InitialAcceleration",
    "Law",
    "LinearElastic",
    "Mapping",
    "MatchedTo",
    "Material",
    "MaterialPoints",
    "ModifiedCamClay",
    "MohrCoulomb",
    "Newmark",
    "Newton",
    "OnElastic",
    "OnExit",
    "OverNonlocal",
    "Pressure",
    "Probe",
    "QuasiStatic",
    "RayleighDamping",
    "Record",
    "Recorder",
    "ReductionCurve",
    "Repartition",
    "ResponseSpectrum",
    "RunError",
    "Series",
    "Simulation",
    "Snapshots",
    "Solver",
    "Spread",
    "StressField",
    "SurfacePoints",
    "Term",
    "Tied",
    "Traction",
    "TravellingWaves",
    "Tresca",
    "Umat",
    "Undrained",
    "ViscoelasticBoundary",
    "ViscousBoundary",
    "VonMises",
    "Waveform",
    "flip",
    "hooke",
    "hydrostatic",
    "initial_stress",
    "plot",
    "relative_error",
    "stiffness",
    "tensors",
    "trapezoidal",
]

_end_together()
_BEFORE = {"Viscous": "ViscousBoundary", "Viscoelastic": "ViscoelasticBoundary"}


def __getattr__(name: str):
    """Names of releases before, with a ``DeprecationWarning``."""
    if name not in _BEFORE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import warnings

    now = _BEFORE[name]
    warnings.warn(f"mpm_fenicsx.{name} is now {now}", DeprecationWarning, stacklevel=2)
    return globals()[now]
