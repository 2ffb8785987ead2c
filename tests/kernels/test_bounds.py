"""Kernels access arrays only within their bounds.

They are compiled with NUMBA_BOUNDSCHECK=1. test_plain_python.py runs every kind of scene.
"""

import json
import sys

import numpy as np
import pytest
from every_scene import EVERY, bits
from places import fresh

from impact_env.kernels.compiling.jit import jit
from impact_env.kernels.compiling.plain_code import PlainCode, PlainNumber

# under control scratch memory has sizes that depend on orders; each kind compiles again, those for
# the night for up to a minute
KINDS = [
    "intervals, Moreau",
    *(
        pytest.param(name, marks=pytest.mark.nightly)
        for name in ("intervals", "intervals, no absorber", "level", "several absorbers")
    ),
]


@jit
def write_beyond(values):
    """Write the number behind an array's last one."""
    values[values.shape[0]] = 1.0


@pytest.mark.parametrize("name", KINDS)
def test_kernels_that_check_bounds_stay_within_them_and_have_the_same_bits(name: str) -> None:
    result = fresh(__file__, name, NUMBA_BOUNDSCHECK=1)
    assert json.loads(result.stdout) == bits(EVERY[name]())


@pytest.mark.plain
@pytest.mark.parametrize("index", [-1, 1, 2**40])
def test_vector_code_in_plain_python_stays_within_an_array(index: int) -> None:
    code = PlainCode()
    array = np.zeros(code.lanes)
    vector = code.vector(array, 0)
    single = index if index < 0 else index + code.lanes - 1
    for access in (
        lambda: code.vector(array, index),
        lambda: code.store(vector, array, index),
        lambda: code.number(array, single),
        lambda: code.put(PlainNumber(np.float64(1.0)), array, single),
    ):
        with pytest.raises(IndexError, match="numbers from"):
            access()
    assert not array.any()


if __name__ == "__main__":
    with pytest.raises(IndexError):
        write_beyond(np.zeros(4)[:3])  # no harm where bounds are not checked
    print(json.dumps(bits(EVERY[sys.argv[1]]())))
