"""From scene and method to kernels: the families, and the table that finds the one. No other module looks at kinds of scenes."""

from impact_env.families.exact import COMPLIANT_SOLVER, LINEAR_SOLVER, RIGID_SOLVER, SEVERAL_SOLVER
from impact_env.families.family import Solver
from impact_env.families.stepping import MOREAU_SOLVER, RUNGE_KUTTA_SOLVER
from impact_env.laws import SceneKind
from impact_env.loads import AnyDrive
from impact_env.methods import Exact, Method, Moreau, RungeKutta, check_supported, method_class
from impact_env.scene import Scene

__all__ = ["SOLVERS", "Solver", "find_solver", "kernel_key"]
SOLVERS: dict[tuple[SceneKind, type[Method]], Solver] = {
    (SceneKind.LINEAR, Exact): LINEAR_SOLVER,
    (SceneKind.LINEAR, Moreau): MOREAU_SOLVER,
    (SceneKind.LINEAR, RungeKutta): RUNGE_KUTTA_SOLVER,
    (SceneKind.RIGID, Exact): RIGID_SOLVER,
    (SceneKind.RIGID, Moreau): MOREAU_SOLVER,
    (SceneKind.SMOOTH, RungeKutta): RUNGE_KUTTA_SOLVER,
    (SceneKind.COMPLIANT, Exact): COMPLIANT_SOLVER,
    (SceneKind.COMPLIANT, RungeKutta): RUNGE_KUTTA_SOLVER,
    (SceneKind.SEVERAL, Exact): SEVERAL_SOLVER,
}


def find_solver(scene: Scene, method: Method) -> Solver:
    """Return the family of kernels that simulates a scene with a method; raises ParameterError if the method cannot do the scene."""
    check_supported(scene, method)
    return SOLVERS[scene.kind, method_class(method)]


def kernel_key(scene: Scene, method: Method, drive: AnyDrive | None = None) -> tuple[object, ...]:
    """Return the key of a run's kernels, see `Family.key`; raises ParameterError as `find_solver` does."""
    return find_solver(scene, method).key(scene, drive)
