"""How far a kernel is inlined: decided by what it is given, and not by what a process has compiled before. All in fresh processes."""

import os
import subprocess
import sys
from functools import cache

import numpy as np
from numba import typeof
from places import ROOT, SUPPORT

from impact_env.kernels.compiling.parts import _is_sparing
from impact_env.kernels.motion.level import Level
from impact_env.kernels.motion.observers import Energy, Events, Observe, Series


@cache
def compiled(*words: str) -> dict[str, list[str]]:
    """Return for each word the kernel's result, and then its instructions."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    result = subprocess.run([sys.executable, str(SUPPORT / "inlined.py"), *words], env=environment, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stderr
    return dict(zip(words, map(str.split, result.stdout.splitlines()), strict=True))


def test_machine_code_does_not_depend_on_what_was_compiled_before() -> None:
    first, last = compiled("bare", "sparing"), compiled("sparing", "bare")
    assert first["bare"] == last["bare"]
    assert first["sparing"] == last["sparing"]


def test_a_sparing_group_spares_copies_and_changes_no_digit() -> None:
    code = compiled("plain", "sparing")
    assert code["plain"][0] == code["sparing"][0] == compiled("bare", "sparing")["bare"][0]
    assert len(code["sparing"]) < len(code["plain"])  # by how much is the processor's: half on one with AVX-512, a few in a hundred without AVX


def test_energies_and_states_spare_and_cheaper_observers_do_not() -> None:
    level, energy = Level(np.zeros(3), np.zeros(1), np.zeros(2)), Energy(np.zeros(1), np.zeros(2))
    events = Events(np.zeros(1), np.zeros(1), np.zeros(1))
    cheap = Observe(1.0, (2, 3), level, events)
    assert not _is_sparing(typeof(cheap))
    assert _is_sparing(typeof(cheap._replace(energy=energy)))
    assert _is_sparing(typeof((1.0, cheap._replace(series=Series(np.zeros((2, 2)))))))
