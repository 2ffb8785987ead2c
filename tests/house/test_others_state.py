"""The state of the whole process is unchanged by the package.

It is compared in a new process after an import, a compilation, runs and a study.
"""

from pathlib import Path

import pytest
from places import fresh

SCRIPT = """
import atexit, gc, locale, logging, multiprocessing, os, pathlib, random, signal, sys, threading, warnings
import matplotlib.pyplot, numba, numpy as np, scipy.linalg, scipy.optimize, scipy.sparse.linalg
import filelock, gymnasium, optuna
from numba.core.caching import NullCache

@numba.njit(cache=True)
def own(x):
    return x + 1

own(1)  # whatever numba does when it first compiles is done

def state():
    return {
        "numba": (numba.get_num_threads(), {name: value for name, value in vars(numba.config).items() if name.isupper()}),
        "warnings": list(warnings.filters),
        "logging": (logging.root.level, list(logging.root.handlers), logging.lastResort, logging.getLogger("impact_env").handlers),
        "signals": {number: signal.getsignal(number) for number in signal.valid_signals()},
        "environment": (dict(os.environ), os.getcwd(), locale.setlocale(locale.LC_ALL)),
        "numpy": (np.geterr(), np.geterrcall(), np.get_printoptions()),
        "random": (random.getstate(), str(np.random.get_state())),
        "gc": (gc.isenabled(), gc.get_threshold(), gc.get_freeze_count(), list(gc.callbacks)),
        "sys": (list(sys.path), list(sys.meta_path), sys.excepthook, sys.stdout, sys.stderr, sys.getrecursionlimit(), sys.getswitchinterval()),
        "processes": (atexit._ncallbacks(), threading.excepthook, multiprocessing.get_start_method(allow_none=True)),
        "matplotlib": (dict(matplotlib.rcParams), matplotlib.get_backend(auto_select=False)),
        "optuna": optuna.logging.get_verbosity(),
    }

before = state()
from impact_env import Beam, Drive, beam_scene, constant_frequency, simulate
from impact_env.ensemble import Lane, run_lanes
from impact_env.kernels.compiling.jit import jit
from optimisation.search.study import DesignStudy
import optimisation.report.sweep_report
from studies.paper.frame import draw_legends, make_panels, make_saver
from design_studies import Model, problem, settings

@jit
def ours(x):
    return x + 1

ours._cache = NullCache()
ours(1)
scene = beam_scene(Beam(modes=2))
drive = Drive(1.0, constant_frequency(scene.model.resonance_omega(1), 1.0, 3.0))
simulate(scene, drive, progress=lambda time, end: None)
run_lanes([Lane(scene, drive)] * 2)
gymnasium.make("ImpactAbsorber/Passive-v0").close()
DesignStudy(problem(), settings()).run(2, Model())

def draw():
    figure, axes = make_panels(1, 1, 3.0)
    assert axes[0, 0].xaxis.label.get_fontsize() == 8.5
    draw_legends(axes)
    return figure

make_saver(draw)(pathlib.Path(__file__).with_name("figure.png"))
after = state()
print(*(name for name in before if before[name] != after[name]))
"""


def test_what_others_have_set_stays(tmp_path: Path) -> None:
    pytest.importorskip("optuna")
    pytest.importorskip("gymnasium")
    (script := tmp_path / "script.py").write_text(SCRIPT)
    assert fresh(script).stdout.split() == []
    assert list(
        (tmp_path / "__pycache__").glob("script.own*.nbi")
    )  # where numba keeps what others compile
