"""A portal frame of steel as matrices, by scikit-fem.

Run `pip install scikit-fem`, then `python docs/examples/frame.py`.

Columns and beam are 20 mm by 20 mm, 0.4 m high and 0.6 m wide, in plane stress with quadratic
elements; the feet are clamped. Writes the mass and the stiffness matrix and the coordinates of
their rows beside this file and prints the rows that frame.toml names.
"""

from pathlib import Path

import numpy as np
import scipy.sparse
import skfem
from skfem.models.elasticity import lame_parameters, linear_elasticity

# m: outer frame, side of the square section, length of an element
WIDTH = 0.6
HEIGHT = 0.4
SIZE = 0.02
LENGTH = 0.04
# Pa, kg/m^3
YOUNG = 210e9
POISSON = 0.3
DENSITY = 7850.0
PLACES = {
    "force": (0.0, 0.19, 0),
    "absorber": (WIDTH, HEIGHT, 0),
    "response": (0.0, HEIGHT, 0),
}  # m, m, direction: 0 horizontal


def mesh() -> skfem.MeshQuad:
    """Return the frame cut out of a grid of rectangles."""
    steps = round((WIDTH - 2 * SIZE) / LENGTH)
    x = np.concatenate([[0.0], np.linspace(SIZE, WIDTH - SIZE, steps + 1), [WIDTH]])
    y = np.append(np.linspace(0.0, HEIGHT - SIZE, round((HEIGHT - SIZE) / LENGTH) + 1), HEIGHT)
    whole = skfem.MeshQuad.init_tensor(x, y)
    middle = whole.p[:, whole.t].mean(axis=1)
    inside = (middle[1] > HEIGHT - SIZE) | (middle[0] < SIZE) | (middle[0] > WIDTH - SIZE)
    return whole.restrict(np.flatnonzero(inside))


def main() -> None:
    """Write the example's files beside this one."""
    basis = skfem.Basis(mesh(), skfem.ElementVector(skfem.ElementQuad2()))
    plane_poisson = POISSON / (1 + POISSON)  # plane stress by the formulas of plane strain
    plane_young = YOUNG * (1 + 2 * POISSON) / (1 + POISSON) ** 2
    stiffness = SIZE * linear_elasticity(*lame_parameters(plane_young, plane_poisson)).assemble(
        basis
    )
    mass = SIZE * skfem.BilinearForm(lambda u, v, _: DENSITY * skfem.helpers.dot(u, v)).assemble(
        basis
    )
    at = basis.doflocs
    free = np.flatnonzero(at[1] > 1e-9)
    for name, matrix in (("mass", mass), ("stiffness", stiffness)):
        scipy.sparse.save_npz(
            Path(__file__).parent / f"frame_{name}.npz", matrix.tocsr()[free][:, free]
        )
    np.savetxt(
        Path(__file__).parent / "frame_coordinates.csv",
        np.column_stack([at[:, free].T, np.zeros(len(free))]).round(9),
        fmt="%.9g",
        delimiter=",",
        header="x_m,y_m,z_m",
        comments="",
    )
    for name, (x, y, direction) in PLACES.items():
        node = np.flatnonzero((abs(at[0, free] - x) < 1e-9) & (abs(at[1, free] - y) < 1e-9))
        print(f"{name} = {int(node[direction])}")
    print(
        f"mass_kg = {DENSITY * SIZE * SIZE * (WIDTH + 2 * (HEIGHT - SIZE)):.4f}, {len(free)} "
        "freedoms"
    )


if __name__ == "__main__":
    main()
