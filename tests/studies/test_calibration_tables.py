"""Tables of the studies of calibrate are correct.

They have coverage, refusals, and a comparison of inference methods.
"""

from typing import Any

import numpy as np
import pytest

from optimisation.cli.common import BadInput
from studies.cli import check_calibration as coverage
from studies.cli import check_plan as plans
from studies.cli import compare_inference as comparison


def test_quantiles_of_weighted_draws_are_those_of_repeated_draws() -> None:
    generator = np.random.default_rng(0)
    values = generator.standard_normal(400)
    weights = generator.integers(0, 4, 400)
    repeated = np.repeat(values, weights)
    shares = [0.05, 0.5, 0.95]
    own = comparison.weighted_quantiles(values, weights.astype(float), shares)
    assert own == pytest.approx(np.quantile(repeated, shares), abs=0.05)
    halved = comparison.weighted_quantiles(values, (values > 0).astype(float), shares)
    assert halved == pytest.approx(np.quantile(values[values > 0], shares), abs=0.05)


def test_methods_are_counted_by_their_intervals() -> None:
    def row(number: int, shift: float) -> dict[str, Any]:
        truth = np.full(3, 0.5)
        return {
            "method": comparison.ABC,
            "sweeps": comparison.SWEEPS,
            "simulated": 400 + number,
            "number": number,
            "truth": truth.tolist(),
            "low": (truth + shift - 0.1).tolist(),
            "median": (truth + shift).tolist(),
            "high": (truth + shift + 0.1).tolist(),
            "method_seconds": 2.0,
        }

    (own,) = comparison.method_rows([row(k, 0.0 if k < 6 else 0.2) for k in range(8)])
    assert own["truths"] == 8
    # 18 of 24: Wilson's interval by its formula with z = 1.96
    z = 1.959964
    centre = (18 + z**2 / 2) / (24 + z**2)
    half = z / (24 + z**2) * np.sqrt(18 * 6 / 24 + z**2 / 4)
    assert own["inside"] == f"75 ({100 * (centre - half):.0f} to {100 * (centre + half):.0f})"
    assert own["width"] == "20.0 / 20.0 / 20.0"
    assert own["error"] == "5.0 / 5.0 / 5.0"  # 0.2 in two of eight
    assert own["score"] == pytest.approx(100 * (0.2 + 20 * 0.1 / 4))  # 0.1 outside in two of eight
    assert own["sweeps"] == f"{256 + 403.5:.0f}"


def test_refusals_are_counted_where_the_check_was_made() -> None:
    names = ["restitution", "friction_limit", "gap"]
    rows = [
        {
            "rig": coverage.RIGS[0].name,
            "kind": coverage.FREE_FRICTION,
            "number": k,
            "names": names,
            "rank": [0.5, 0.0, 0.99],
            "low": [0.4, low, 0.2],
            "probability": probability,
        }
        for k, (probability, low) in enumerate([(None, 0.0), (0.01, 0.01), (0.5, 0.1), (0.9, 0.0)])
    ]
    (own,) = coverage.kind_rows(rows)
    assert (own["truths"], own["checked"]) == (4, 3)
    assert own["refused"] == pytest.approx(100 / 3)
    assert own["inside"] == "100 / 75 / 0"  # three of four intervals of the friction limit reach 0


def test_a_package_that_is_not_installed_is_one_message() -> None:
    with pytest.raises(BadInput, match=r"needs no_such_package.*pip install no_such_package"):
        comparison.import_method("no_such_package.inference")


def test_each_number_of_truths_is_the_beginning_of_a_larger_study() -> None:
    small, large = (
        list(coverage.list_cases(coverage.CalibrationSettings(truths, 1))) for truths in (3, 5)
    )
    assert [case for case in large if case in small] == small
    methods = comparison.list_cases(comparison.ComparisonSettings(11))
    assert {number for _, _, number in methods} == set(range(11))
    kinds = coverage.list_cases(coverage.CalibrationSettings(1, 3, 2))
    assert sum(kind == "drift" for _, kind, _ in kinds) == 3
    assert sum(kind == coverage.COMPLIANT for _, kind, _ in kinds) == 2 * 2  # on two rigs


def test_widths_are_compared_by_the_way_in_which_forces_are_chosen() -> None:
    def row(way: str, factors: list[float], width: float, number: int) -> dict[str, Any]:
        return {
            "number": number,
            "way": way,
            "factors": factors,
            "truth": [0.5, 0.5, 0.5],
            "low": [0.5 - width / 2, 0.45, 0.5],
            "high": [0.5 + width / 2, 0.45 + width, 0.5 + width],
            "correlation": 0.1 * number,
        }

    rows = [row(plans.ONE, [1.0], width, k) for k, width in enumerate((0.2, 0.4, 0.6))]
    rows += [row(plans.SPACED, [0.35, 2.8], 0.04, k) for k in range(3)]
    one, spaced = plans.way_rows(rows)
    assert (one["sweeps"], spaced["sweeps"], one["truths"]) == (1, 2, 3)
    assert one["each"] == "40.0 / 40.0 / 40.0"
    assert one["together"] == f"40.0 +- {20 / np.sqrt(3):.1f}"
    assert one["inside"] == "100"
    assert spaced["inside"] == f"{100 * 2 / 3:.0f}"  # 0.45 to 0.49 misses 0.5
    (force,) = plans.force_rows(rows)
    assert (force["force"], force["correlation"]) == (plans.FORCE, pytest.approx(0.1))
    assert (force["low"], force["high"]) == (0.0, pytest.approx(0.2))
