"""Trigonometric polynomials: roots against companion matrices, windows and hysteresis against dense quadrature."""

import numpy as np
import pytest

from impact_env.periodic.contact import elastic_coulomb
from impact_env.periodic.trigonometric import basis, derivative, largest, negative, roots, share, values, window

Array = np.ndarray


def _rows(seed: int, h: int, count: int = 4) -> Array:
    return np.random.default_rng(seed).normal(size=(count, 2 * h + 1)) / (1 + np.append(0, np.tile(np.arange(h), 2)))


def _companion_roots(row: Array) -> Array:
    h = (len(row) - 1) // 2
    half = (row[1 : h + 1] - 1j * row[h + 1 :]) / 2
    z = np.roots(np.concatenate([half[::-1], [row[0]], np.conj(half)]))
    return np.sort(np.angle(z[np.abs(np.abs(z) - 1) < 1e-8]) % (2 * np.pi))


@pytest.mark.parametrize("h", [1, 2, 7, 20, 45])
def test_roots_are_those_of_the_companion_matrix(h: int) -> None:
    rows = _rows(h, h)
    for row, found in zip(rows, roots(rows), strict=True):
        assert found == pytest.approx(_companion_roots(row), abs=1e-10)


@pytest.mark.parametrize("depth", [1e-2, 1e-5, 1e-9, 1e-12])
def test_two_roots_close_to_one_another_are_not_missed(depth: float) -> None:
    """Cos(5 (angle - 0.3)) + 1 - depth dips below zero by depth: five pairs of roots that come arbitrarily close."""
    row = np.zeros(2 * 20 + 1)
    row[0], row[5], row[25] = 1 - depth, np.cos(1.5), np.sin(1.5)
    (found,) = roots(row[None])
    half = np.arccos(1 - depth) / 5
    middle = 0.3 + np.pi / 5 * np.arange(1, 10, 2)
    assert found == pytest.approx(np.sort(np.concatenate([middle - half, middle + half]) % (2 * np.pi)), abs=max(1e-12, 1e-15 / half))
    row[0] = 1 + depth
    assert len(roots(row[None])[0]) == 0


def test_derivative_extremes_and_single_values() -> None:
    (row,) = _rows(3, 9, 1)
    angle = np.linspace(0, 2 * np.pi, 100001)
    value, slope = values(row[None], np.zeros(len(angle), dtype=int), angle)
    assert largest(row) == (pytest.approx(value.min(), abs=1e-7), pytest.approx(value.max(), abs=1e-7))
    assert values(derivative(row)[None], np.zeros(len(angle), dtype=int), angle)[0] == pytest.approx(slope, abs=1e-12)
    assert basis(1.234, 9) @ row == pytest.approx(values(row[None], np.array([0]), np.array([1.234]))[0][0], abs=1e-14)


def _dense(row: Array, points: int = 400000) -> tuple[Array, Array]:
    angle = (np.arange(points) + 0.5) * 2 * np.pi / points
    return angle, values(row[None], np.zeros(points, dtype=int), angle)[0]


def _coefficients(angle: Array, x: Array, h: int) -> Array:
    cosine = [2 * np.mean(x * np.cos(k * angle)) for k in range(1, h + 1)]
    return np.array([np.mean(x), *cosine, *(2 * np.mean(x * np.sin(k * angle)) for k in range(1, h + 1))])


def test_window_is_the_closed_form_of_a_cut_polynomial() -> None:
    h = 6
    for row in _rows(11, h, 3):
        intervals = negative(row, roots(row[None])[0])
        angle, x = _dense(row)
        matrix = window(intervals, h)
        assert matrix @ row == pytest.approx(_coefficients(angle, np.minimum(x, 0), h), abs=1e-8)
        assert share(intervals, h) == pytest.approx(matrix[:, 0], abs=1e-15)
    whole, nothing = np.array([[0.0, 2 * np.pi]]), np.empty((0, 2))
    assert window(whole, h) == pytest.approx(np.eye(2 * h + 1), abs=1e-14)
    assert np.all(window(nothing, h) == 0)


def _jenkins(x: Array, limit: float, stiffness: float) -> Array:
    """A Jenkins element gone through sample by sample, three times round."""
    force, last, out = 0.0, x[-1], np.empty(len(x))
    for _ in range(3):
        for i, now in enumerate(x):
            force = min(limit, max(-limit, force - stiffness * (now - last)))
            last, out[i] = now, force
    return out


@pytest.mark.parametrize(("limit", "stiffness"), [(0.3, 1.0), (1.2, 2.0), (0.05, 4.0)])
def test_elastic_coulomb_is_what_a_slider_does(limit: float, stiffness: float) -> None:
    h = 5
    for row in _rows(5, h, 3):
        angle, x = _dense(row, 100000)
        found = elastic_coulomb(row, limit, stiffness)
        assert found.force == pytest.approx(_coefficients(angle, _jenkins(x, limit, stiffness), h), abs=2e-4 * limit)


def test_elastic_coulomb_sticks_without_slip() -> None:
    (row,) = _rows(2, 4, 1)
    found = elastic_coulomb(row, 1e3, 2.0)
    assert found.force[1:] == pytest.approx(-2 * row[1:])
    assert found.force[0] == 0
