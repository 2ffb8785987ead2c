"""Which files of tests run at every save, which together, and which start first: by the processor's time with compiled kernels
(``scripts/test -n 0 --cpu FILE``)."""

import sys
from pathlib import Path

# some of every kind that say much in little time; what takes long in them is marked slow
QUICK = (
    "kernels/test_agreement.py",
    "kernels/test_check.py",
    "kernels/test_energies.py",
    "kernels/test_exact_compliant.py",
    "kernels/test_exact_rigid.py",
    "kernels/test_linear.py",
    "kernels/test_moreau.py",
    "kernels/test_properties.py",
    "kernels/test_records.py",
    "kernels/test_runge_kutta.py",
    "kernels/test_several.py",
    "simulator/test_bad_input.py",
    "simulator/test_controlled.py",
    "simulator/test_ensemble.py",
    "simulator/test_model.py",
    "simulator/test_frequency.py",
    "simulator/test_plain.py",
    "simulator/test_structure.py",
    "periodic/test_continuation.py",
    "periodic/test_periodic_closed_form.py",
    "periodic/test_periodic_orbits.py",
    "periodic/test_published_orbits.py",
    "periodic/test_switching.py",
    "environments/test_environments.py",
    "environments/test_evaluation.py",
    "environments/test_lanes.py",
    "environments/test_passages.py",
    "environments/test_refusals.py",
    "environments/test_scores.py",
    "design/test_bounds.py",
    "design/test_designs.py",
    "design/test_evaluate_arrays.py",
    "design/test_objectives.py",
    "design/test_structure_design.py",
    "studies/test_study_pattern.py",
    "commands/test_bad_input.py",
    "commands/test_compare_absorbers.py",
    "commands/test_orbits_script.py",
    "commands/test_sweep_script.py",
    "house/test_docs.py",
)

# all of them in runs one after the other: what a process has compiled and imported stays in its memory
PARTS = (
    "tests/kernels/test_[a-l]*.py",
    "tests/kernels/test_[m-z]*.py",
    "tests/simulator tests/periodic",
    "tests/design tests/house",
    "tests/environments",
    "tests/studies tests/commands",
)

# by their time and, from nothing, by what they compile: two neighbours take other kinds of scenes, since both processes would compile the same one
LONGEST_FIRST = (
    "kernels/test_loads.py",
    "simulator/test_controlled.py",
    "environments/test_active.py",
    "design/test_load_gap.py",
    "commands/test_explore.py",
    "commands/test_structure_commands.py",
    "design/test_advice.py",
    "kernels/test_exact_rigid.py",
    "kernels/test_plain_python.py",
    "kernels/test_one_result.py",
    "kernels/test_exact_compliant.py",
    "kernels/test_several.py",
    "commands/test_clear_errors.py",
    "environments/test_training.py",
    "kernels/test_runge_kutta.py",
    "environments/test_suite.py",
    "kernels/test_kernel_cache.py",
    "kernels/test_search_truth.py",
    "simulator/test_stop_and_passes.py",
    "periodic/test_bifurcation_curves.py",
    "simulator/test_places.py",
    "simulator/test_first_use.py",
    "design/test_cluster.py",
    "house/test_extras.py",
    "kernels/test_dense_motion.py",
    "periodic/test_harmonic_balance.py",
    "design/test_study.py",
    "commands/test_explore_browser.py",
    "studies/test_stability_report.py",
    "studies/test_benchmark_scripts.py",
    "commands/test_frequency_scripts.py",
    "kernels/test_regimes.py",
    "commands/test_command.py",
    "commands/test_interrupted.py",
    "kernels/test_verification.py",
)

# lean on the arithmetic of BLAS or torch: .ci/run runs them as on two older processors, too
_LEANING = {
    "environments": "suite training",
    "kernels": "regimes linear exact_rigid",
    "periodic": "periodic_orbits shooting switching",
    "simulator": "model frequency structure",
    "design": "tuned",
}
LEANING = tuple(f"{folder}/test_{name}.py" for folder, names in _LEANING.items() for name in names.split())

# tests marked plain run last, by kernels in plain Python: to compile these kinds of scenes takes longer than their few events
TESTS = Path(__file__).parents[1]


def parts() -> list[str]:
    """Whether kernels are compiled, and what pytest is told, a line for each of `PARTS` and for tests marked plain."""
    plain = [str(path) for path in sorted(TESTS.glob("*/test_*.py")) if "pytest.mark.plain" in path.read_text()]
    return [*(f"NUMBA_DISABLE_JIT=0 --kernels=compiled {part}" for part in PARTS), f"NUMBA_DISABLE_JIT=1 --kernels=plain {' '.join(plain)}"]


if __name__ == "__main__":
    print("\n".join(LEANING if sys.argv[1:] == ["leaning"] else parts()))
