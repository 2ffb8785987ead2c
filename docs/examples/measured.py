"""A simply supported beam as a modal test would find it, written as measured.uff.

Run `pip install pyuff`, then `python docs/examples/measured.py`.

The closed-form modes of a beam of 1 m and 2 kg at seven accelerometers, with the errors of a test:
frequencies to 0.1 %, damping ratios to 10 % and shapes to 2 % of the largest. The file has normal
modes with a modal mass of 1, so the shapes are mass-normalised.
"""

from pathlib import Path

import numpy as np
import pyuff

# m, kg, Hz
LENGTH = 1.0
MASS = 2.0
FIRST = 40.0
# nodes at eighths of the length
MODES = 5
NODES = np.arange(1, 8)
DAMPING = 0.004


def main() -> None:
    """Write the example's files beside this one."""
    noise = np.random.default_rng(5)
    path = Path(__file__).parent / "measured.uff"
    path.unlink(missing_ok=True)
    file = pyuff.UFF(str(path))
    for mode in range(1, MODES + 1):
        shape = np.sqrt(2 / MASS) * np.sin(mode * np.pi * NODES / 8)
        shape = shape + 0.02 * np.sqrt(2 / MASS) * noise.standard_normal(len(NODES))
        file.write_sets(
            pyuff.prepare_55(
                id1="simply supported beam, simulated modal test",
                model_type=1,
                analysis_type=2,
                data_ch=2,
                spec_data_type=8,
                data_type=2,
                n_data_per_node=3,
                load_case=0,
                mode_n=mode,
                freq=FIRST * mode**2 * (1 + 1e-3 * noise.standard_normal()),
                modal_m=1.0,
                modal_damp_vis=DAMPING * (1 + 0.1 * noise.standard_normal()),
                modal_damp_his=0.0,
                node_nums=NODES,
                r1=np.zeros(len(NODES)),
                r2=np.zeros(len(NODES)),
                r3=shape,
            ),
            "add",
        )


if __name__ == "__main__":
    main()
