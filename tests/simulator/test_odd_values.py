"""Public functions take an odd value as the plain number that it represents, or refuse it.

A refusal names the argument.
"""

import pickle
import subprocess
import sys
import warnings

import numpy as np
import odd_values
import pytest

from impact_env import Beam, ParameterError, Record
from impact_env.loads import Random
from impact_env.plain import to_scene

CHEAP = odd_values.targets()


@pytest.mark.parametrize("name", CHEAP)
def test_odd_values_are_right_or_refused(name: str) -> None:
    make, good = CHEAP[name]
    make(**good)
    with warnings.catch_warnings(), odd_values.limited():
        warnings.simplefilter("ignore")  # of numpy, where numbers are extreme
        complaints = list(odd_values.walk(name, make, good))
    assert [problem for problem in complaints if problem is not None] == []
    assert len(complaints) >= len(odd_values.ODD) / 3


def test_small_integers_of_numpy_are_plain_ones() -> None:
    assert Record(samples_per_period=np.uint8(200)) == Record(samples_per_period=200)
    assert type(Record(samples_per_period=np.uint8(200)).samples_per_period) is int
    assert Beam(elements=np.uint8(200)).freedoms == 400


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"length": 1e9}, "length = 1000000000.0 is not allowed: at most 4194304 samples"),
        ({"factor": 0.5j}, "factor = 0.5j"),
        ({"number": True}, "number = True"),
        ({"number": [[0.0, 1.0]]}, "number = [[0.0, 1.0]]"),
    ],
)
def test_random_loads_are_refused_before_anything_is_drawn(
    change: dict[str, object], message: str
) -> None:
    with odd_values.limited(1.0), pytest.raises(ParameterError) as raised:
        Random(**{"spectrum": [[20.0, 0.05], [60.0, 0.05]], "length": 4.0, **change})
    assert message in str(raised.value)


def test_share_of_a_scene_file_is_a_number() -> None:
    one = {"position": 1, "share": "0.75"}
    plain = {"absorber": {"kind": "several", "absorbers": [one, {"position": 0.7, "share": 0.25}]}}
    with pytest.raises(ParameterError) as raised:
        to_scene(plain)
    assert "scene.absorber.absorbers[0].share = '0.75' is not allowed" in str(raised.value)


def test_errors_carry_name_value_allowed_and_argument_also_through_pickle() -> None:
    with pytest.raises(ParameterError) as raised:
        Beam(damping_ratio=[0.01, -1.0], modes=2)
    error = raised.value
    assert (error.name, error.value, error.argument) == (
        "damping_ratio",
        [0.01, -1.0],
        "damping_ratio",
    )
    assert "0 to 1000" in str(error.allowed)
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.name, again.argument) == (str(error), error.name, error.argument)


def test_without_asserts_a_small_scene_runs_the_same_and_bad_values_are_refused() -> None:
    code = """
from impact_env import *
scene = beam_scene(Beam(modes=2), impact_absorber(restitution=0.7))
drive = Drive(3.5, constant_frequency(scene.model.resonance_omega(1), 0.98, 2.0))
print(repr(simulate(scene, drive).end_state.tolist()))
try:
    Beam(modes=0)
except ParameterError as error:
    print(error)
"""
    runs = [
        subprocess.run(
            [sys.executable, *flags, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        for flags in ([], ["-O"])
    ]
    assert runs[0] == runs[1]
    assert "modes = 0 is not allowed" in runs[0]
