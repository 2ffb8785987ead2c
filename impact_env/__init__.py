"""Simulation of impact absorbers: a small mass that rattles in a cavity of a vibrating structure.

>>> from impact_env import Beam, Drive, beam_scene, impact_absorber, linear_sweep, simulate
>>> scene = beam_scene(Beam(modes=3), impact_absorber(gap=1e-3, restitution=0.7))
>>> schedule = linear_sweep(scene.model.resonance_omega(1), 0.9, 1.06)
>>> response = simulate(scene, Drive(3.5, schedule))
>>> print(f"{1e3 * response.recorded.level.value:.2f} mm, {response.impact_count > 1000}")
1.31 mm, True

- **Structure**: `Beam`, `load_structure` (a file), `ModalModel` (modes).
- **Absorber**: `impact_absorber`, `friction_damper`, `tuned_absorber`, `impact_absorbers`;
  structure and absorber together are a `Scene` (`beam_scene`).
- **Load**: `Drive` with `linear_sweep` or `constant_frequency`; others in `impact_env.loads`.
- **Run**: `simulate` returns a `Response`; `Record` says what it records.
- **Many runs**: `performance_curve`, the level over the force with its band; `impact_env.ensemble`.
- **Environments**: `gymnasium.make("ImpactAbsorber/ActiveGap-v0")`; `evaluate` scores a policy.

Everything is in SI units. Wrong values raise `ParameterError`.
"""

from importlib.metadata import PackageNotFoundError, version
from typing import Any

from impact_env.checks import ParameterError
from impact_env.curve import CurveCase, Pass, PerformanceCurve, curve_passes, performance_curve
from impact_env.drive import Drive, FrequencySchedule, constant_frequency, linear_sweep
from impact_env.envs import register_environments
from impact_env.first_use import Compilation, on_compile
from impact_env.methods import Exact, Moreau, RungeKutta
from impact_env.modes import ModalModel, modal_model, mode_shapes
from impact_env.parameters import (
    Beam,
    CompliantWalls,
    CoulombFriction,
    ElasticCoulombFriction,
    NonlinearSink,
    RigidWalls,
    Section,
    SeveralAbsorbers,
    SlidingAbsorber,
    StuckAbsorber,
    TunedAbsorber,
    YieldingWalls,
    friction_damper,
    impact_absorber,
    impact_absorbers,
    tuned_absorber,
)
from impact_env.plain import StructureWarning, load_structure
from impact_env.prepare import Preparation, is_ready, prepare
from impact_env.results import Record, Response, Window
from impact_env.scene import InitialState, Scene, beam_scene
from impact_env.sweep import IntegrationError, Stop, Stopped, simulate

__all__ = [
    "Beam",
    "ModalModel",
    "Section",
    "StructureWarning",
    "load_structure",
    "modal_model",
    "mode_shapes",
]
__all__ += [
    "CompliantWalls",
    "CoulombFriction",
    "ElasticCoulombFriction",
    "NonlinearSink",
    "RigidWalls",
    "SeveralAbsorbers",
    "YieldingWalls",
]
__all__ += [
    "ParameterError",
    "SlidingAbsorber",
    "StuckAbsorber",
    "TunedAbsorber",
    "friction_damper",
    "impact_absorber",
    "impact_absorbers",
    "tuned_absorber",
]
__all__ += [
    "Drive",
    "FrequencySchedule",
    "InitialState",
    "Scene",
    "beam_scene",
    "constant_frequency",
    "linear_sweep",
]
__all__ += ["Exact", "Moreau", "RungeKutta"]
__all__ += ["IntegrationError", "Record", "Response", "Stop", "Stopped", "Window", "simulate"]
__all__ += [
    "CurveCase",
    "Pass",
    "PerformanceCurve",
    "curve_passes",
    "evaluate",
    "performance_curve",
]
__all__ += ["Compilation", "Preparation", "__version__", "is_ready", "on_compile", "prepare"]


def __getattr__(name: str) -> Any:
    """Import a name at its first use."""
    if name == "evaluate":
        from impact_env.envs.evaluation import evaluate

        return evaluate
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Return the public names."""
    return sorted(__all__)


try:
    __version__ = version("impact-absorber-workbench")
except PackageNotFoundError:  # a checkout on the path, not installed
    __version__ = "0+unknown"

register_environments()
