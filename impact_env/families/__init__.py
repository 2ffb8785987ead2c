"""From scene and method to kernels: the families, and the table that finds the one. No other module looks at kinds of scenes."""

from impact_env.families.exact import COMPLIANT, LINEAR, RIGID, SEVERAL
from impact_env.families.family import Family
from impact_env.families.stepping import MOREAU, RUNGE_KUTTA
from impact_env.laws import SceneKind
from impact_env.loads import AnyDrive
from impact_env.methods import Exact, Method, Moreau, RungeKutta, check_supported, method_class
from impact_env.scene import Scene

__all__ = ["FAMILIES", "Family", "family", "kernel_key"]
FAMILIES: dict[tuple[SceneKind, type[Method]], Family] = {
    (SceneKind.LINEAR, Exact): LINEAR,
    (SceneKind.LINEAR, Moreau): MOREAU,
    (SceneKind.LINEAR, RungeKutta): RUNGE_KUTTA,
    (SceneKind.RIGID, Exact): RIGID,
    (SceneKind.RIGID, Moreau): MOREAU,
    (SceneKind.SMOOTH, RungeKutta): RUNGE_KUTTA,
    (SceneKind.COMPLIANT, Exact): COMPLIANT,
    (SceneKind.COMPLIANT, RungeKutta): RUNGE_KUTTA,
    (SceneKind.SEVERAL, Exact): SEVERAL,
}


def family(scene: Scene, method: Method) -> Family:
    """Return the family of kernels that simulates a scene with a method; raises ParameterError if the method cannot do the scene."""
    check_supported(scene, method)
    return FAMILIES[scene.kind, method_class(method)]


def kernel_key(scene: Scene, method: Method, drive: AnyDrive | None = None) -> tuple[object, ...]:
    """Return the key of a run's kernels, see `Family.key`; raises ParameterError as `family` does."""
    return family(scene, method).key(scene, drive)
