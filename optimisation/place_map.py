"""Places for an absorber, with reach, gap and expected level by the linear structure.

For a mass m_a at a place with mode shapes phi_p the receptances G_pf (from the force), G_pp and
G_ep (to the place of the level) give, as in `optimisation.bounds`, the design rule's gap, the free
amplitude and the limit that no device in a gap can beat:

    kappa = m_a Omega^2 G_pp,   gap = f min |G_pf|/|kappa| pi/4,   reach = max |f G_pf| / gap,
    q_e = f A + B r,   |r| <= 4 g0/pi,
    A = G_ef + G_ep m_a Omega^2 G_pf/(1 - kappa),   B = G_ep m_a Omega^2/(1 - kappa).

No runs are made here. `optimisation.place_advice` simulates the few best places.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import ParameterError, finite, instance, require, table_of
from impact_env.modes import ModalModel, Structure, mode_shapes
from impact_env.parameters import DEFAULT_MASS_RATIO, Beam
from impact_env.plain_files import read_plain
from impact_env.plain_structures import read_structure_nodes, read_structure_shapes
from impact_env.structures.matrix_files import FREEDOM_NAMES, read_coordinates
from impact_env.structures.universal import require_global_directions
from optimisation.bounds import NEAR
from optimisation.gap_advice import expected_factor
from optimisation.mounting import model_with_absorber_at, with_response_point
from optimisation.sweep_range import LEAST_GAP, usable_force, usable_mass_ratio

Array = NDArray[np.float64]
BEAM_PLACES = 40  # evenly over a beam's length
FREQUENCY_POINTS = 321  # of a range
PEAK_POINTS = 61  # further frequencies around a resonance
PEAK_WIDTH = 3.0  # damping ratios to either side of it
LEAST_START = 0.5  # of the resonance with the mass stuck: as in `optimisation.bounds.near_range`
PLACES_A_CHUNK = 250  # places at a time
# gaps tried for several resonances together: from the first times the narrowest to the second times
# the widest of their own
GAP_SPAN = (0.4, 1.6)
GAP_POINTS = 41
# The level at the best gap of one resonance is about 1/(1 + SHARE_SLOPE reach) of that without
# absorber: a fit to the simulated structures of docs/gap_method.md, from 0.8 to 1.3 times their
# levels.
SHARE_SLOPE = 0.9
CLIFF = 2.5  # exponent of the level over a gap that is too narrow
NODAL = ("universal", "nastran", "ansys", "matrices")  # tables of files with shapes at all nodes


@dataclass(frozen=True, eq=False)
class Places:
    """Possible places of an absorber.

    Attributes
    ----------
    structure : Beam or ModalModel
        The structure, with the places of force and level.
    model : ModalModel
        Its modes, with the place of the level as in `optimisation.mounting.with_response_point`.
    names : tuple of str
        Name of each place (P,): fraction of a beam's length, or the number of a node, of a row of
        the matrices or of a place of a modal model.
    kind : str
        Kind of the names: "of the length", "node", "row" or "place".
    shapes : array
        Mode shapes (P, N_m) at the places in 1/sqrt(kg).
    points : array or None
        Coordinates (P, 3) in m; None if the structure has none.
    """

    structure: Structure
    model: ModalModel
    names: tuple[str, ...]
    kind: str
    shapes: Array
    points: Array | None = None

    def __len__(self) -> int:
        return len(self.names)

    def model_at(self, k: int) -> ModalModel:
        """Return the modal model with the absorber at place ``k``.

        The place of the level is unchanged.
        """
        if isinstance(self.structure, Beam):
            return model_with_absorber_at(self.structure, float(self.names[k]))
        own = self.shapes[k]
        level = self.model.level_shape
        return replace(
            self.model,
            tip_shape=own,
            absorber_shapes=None,
            response_shape=None if np.array_equal(own, level) else level,
        )

    def word(self, k: int) -> str:
        """Return a place in words."""
        if isinstance(self.structure, Beam):
            return f"{self.names[k]} of the length"
        return f"{self.kind} {self.names[k]}"

    def subset(self, wanted: Sequence[float]) -> "Places":
        """Return the places with these names.

        Raises ParameterError for a place that does not exist. A beam has a place for every fraction
        of its length.
        """
        if isinstance(self.structure, Beam):
            beam = self.structure
            shares = [replace(beam, absorber_position=x).absorber_position for x in wanted]
            return _beam_places(beam, self.model, sorted(set(shares)))
        numbers = [float(name) for name in self.names]
        some = ", ".join(self.names[:12]) + (" ..." if len(self) > 12 else "")
        for x in wanted:
            require(x in numbers, "position", x, f"a {self.kind} of the structure: {some}")
        rows = sorted({numbers.index(x) for x in wanted})
        return replace(
            self,
            names=tuple(self.names[k] for k in rows),
            shapes=self.shapes[rows],
            points=None if self.points is None else self.points[rows],
        )


def find_places(structure: Structure, file: Path | None = None) -> Places:
    """Return the places for an absorber on a structure.

    On a beam these are `BEAM_PLACES` over its length. A modal model has its own; where a ``file``
    with nodes lists one place only, they are all its nodes in the direction of that place.

    Parameters
    ----------
    structure : Beam or ModalModel
        The structure with force, level, and an absorber's place.
    file : path, optional
        The structure file (docs/scenes.md) that it was read from, for the coordinates and shapes of
        nodes.

    Returns
    -------
    Places

    """
    structure = with_response_point(instance("structure", structure, Beam | ModalModel))
    model = model_with_absorber_at(structure)
    if isinstance(structure, Beam):
        every = np.linspace(0, 1, BEAM_PLACES + 1).round(12).tolist()
        free = [
            x for x, row in zip(every, mode_shapes(structure, every), strict=True) if np.any(row)
        ]
        return _beam_places(structure, model, [x for x in free if x > 0])
    nodal = None if file is None else _nodal_places(structure, model, file)
    if nodal is not None:
        return nodal
    names = tuple(str(k + 1) for k in range(len(structure.places)))
    return Places(structure, model, names, "place", structure.places)


def _beam_places(beam: Beam, model: ModalModel, shares: Sequence[float]) -> Places:
    points = np.zeros((len(shares), 3))
    points[:, 0] = beam.length * np.array(shares)
    names = tuple(f"{x:.12g}" for x in shares)
    return Places(beam, model, names, "of the length", mode_shapes(beam, shares), points)


def _nodal_places(structure: ModalModel, model: ModalModel, file: Path) -> Places | None:
    """Return the places of a file with nodes, or None for a file without nodes.

    They are the places that the file lists if it lists several, else all nodes.
    """
    plain = read_plain(file)
    kind = next((name for name in NODAL if name in plain), None)
    if kind is None:
        return None
    listed_absorber = plain[kind]["absorber"]
    listed = (
        list(listed_absorber) if isinstance(listed_absorber, list | tuple) else [listed_absorber]
    )
    every = read_structure_shapes(file.parent, plain)
    index = {freedom: k for k, freedom in enumerate(every.freedoms)}
    rows = [_row_of(place, index) for place in listed]
    points = _points(file, plain, kind, every.freedoms)
    # the model turns each mode so that its absorber moves up
    turned = np.where(rows[0][1] * every.shapes[:, rows[0][0]] < 0, -1.0, 1.0)
    if len(rows) == 1:
        sign = rows[0][1]
        rows = [(k, sign) for k in _alike(rows[0][0], every.freedoms, points)]
        if kind == "universal":
            try:
                used = {str(every.freedoms[k][0]): every.freedoms[k][0] for k, _ in rows}
                require_global_directions(file.parent / plain[kind]["file"], used)
            except ParameterError:
                return None
    shapes = np.array([sign * turned * every.shapes[:, k] for k, sign in rows])
    numbers = tuple(str(every.freedoms[k][0]) for k, _ in rows)
    is_row = every.freedoms[rows[0][0]][1] == 0
    own = None if points is None else points[[k for k, _ in rows]]
    if len(set(numbers)) < len(numbers):  # two directions of a node are listed
        numbers = tuple(str(k + 1) for k in range(len(rows)))
        return Places(structure, model, numbers, "place", shapes, own)
    return Places(structure, model, numbers, "row" if is_row else "node", shapes, own)


def _row_of(place: Any, index: Mapping[tuple[int, int], int]) -> tuple[int, float]:
    """Return the column of the shapes at a place of a file, and the sign of its direction."""
    if not isinstance(place, Mapping):
        return int(place), 1.0
    direction = str(place["direction"])
    axis = 1 + FREEDOM_NAMES.index(direction.lstrip("+-"))
    return index[int(place["node"]), axis], -1.0 if direction.startswith("-") else 1.0


def _points(
    file: Path, plain: Mapping[str, Any], kind: str, freedoms: Sequence[tuple[int, int]]
) -> Array | None:
    """Return the coordinates (n, 3) in m of the freedoms of a file; None where it has none."""
    if kind == "matrices":
        name = plain[kind].get("coordinates")
        return None if name is None else read_coordinates(file.parent / name, len(freedoms))
    try:
        nodes = read_structure_nodes(file.parent, plain)
    except ParameterError:  # a file of modes without the coordinates of its nodes
        return None
    if nodes is None:
        return None
    where = {int(node): point for node, point in zip(*nodes, strict=True)}
    if any(node not in where for node, _ in freedoms):
        return None
    return np.array([where[node] for node, _ in freedoms])


def _alike(row: int, freedoms: Sequence[tuple[int, int]], points: Array | None) -> list[int]:
    """Return the freedoms in the direction of one.

    Rows of matrices that name no nodes have none: the rows at one point are taken to be in one
    order at all points.
    """
    axis = freedoms[row][1]
    if axis != 0:
        return [k for k, (_, other) in enumerate(freedoms) if other == axis]
    if points is None:
        return [row]
    groups: dict[tuple[float, ...], list[int]] = {}
    for k, point in enumerate(points.round(9).tolist()):
        groups.setdefault(tuple(point), []).append(k)
    own = next(group for group in groups.values() if row in group)
    rank = own.index(row)
    return [group[rank] for group in groups.values() if len(group) == len(own)]


@dataclass(frozen=True, eq=False)
class PlaceMap:
    """Properties of an absorber of one mass at P places, under forces near R resonances.

    They follow from the linear structure.

    Attributes
    ----------
    mass_ratio : float
        Mass of the absorber over that of the structure.
    forces : dict
        Force in N by resonance, counted from 1.
    reach : array, (R, P)
        Free amplitude over the design rule's gap, for one resonance alone; it does not depend on
        the force. NaN if the mass is too large for the rule, 0 at a node.
    rule : array, (R, P)
        The design rule's gap in m for one resonance alone.
    gap : array, (P,)
        Expected best gap in m for all resonances together; NaN if not known.
    share : array, (P,)
        Expected level with this gap over that without absorber, at the worst resonance; 1 if not
        known.
    limit : array, (P,)
        Lower bound of this share for all devices of this mass in that gap, at the worst resonance.
    """

    mass_ratio: float
    forces: dict[int, float]
    reach: Array
    rule: Array
    gap: Array
    share: Array
    limit: Array


def map_places(places: Places, forces: Mapping[int, float], mass_ratio: float) -> PlaceMap:
    """Return the properties of each place for an absorber, from the linear structure.

    The absorber has a mass ratio. The forces are in N by resonance.

    Raises ParameterError for numbers out of range and for resonances that the structure lacks.

    Examples
    --------
    >>> from impact_env import Beam
    >>> found = map_places(find_places(Beam()), {1: 3.5}, DEFAULT_MASS_RATIO)
    >>> int(found.share.argmin()) + 1, round(float(found.reach[0, -1]), 2)
    (40, 4.47)
    """
    table = table_of(finite)("forces", forces)
    require(len(table) > 0, "forces", dict(table), "at least one resonance with its force in N")
    forces = {
        places.model.check_resonance(resonance): usable_force("force", force)
        for resonance, force in table.items()
    }
    mass = usable_mass_ratio("mass_ratio", mass_ratio) * places.model.beam_mass
    parts = [
        _map_chunk(places.model, places.shapes[start : start + PLACES_A_CHUNK], mass, forces)
        for start in range(0, len(places), PLACES_A_CHUNK)
    ]
    reach, rule, gap, share, limit = (
        np.concatenate(part, axis=-1) for part in zip(*parts, strict=True)
    )
    return PlaceMap(mass_ratio, forces, reach, rule, gap, share, limit)


def _map_chunk(
    model: ModalModel, shapes: Array, mass: float, forces: Mapping[int, float]
) -> tuple[Array, Array, Array, Array, Array]:
    """Return reach, rule (R, P), gap, share and limit (P,) of `PlaceMap` for some places."""
    reach = np.empty((len(forces), len(shapes)))
    rule = np.empty_like(reach)
    lines = []
    for k, (resonance, force) in enumerate(forces.items()):
        ranges, usable = _near_ranges(model, shapes, mass, resonance)
        rule[k], free, line = _linear_terms(model, shapes, mass, resonance, ranges)
        rule[k] *= force
        with np.errstate(divide="ignore", invalid="ignore"):
            reach[k] = np.where(rule[k] > 0, force * free / rule[k], 0.0)
        rule[k, ~usable] = np.nan
        reach[k, ~usable] = np.nan
        lines.append((force, *line))
    gap, share = expected_gap_and_share(rule, reach)
    limit = np.zeros(len(shapes))
    stroke = 4 * gap / np.pi
    for force, by_force, by_stroke, without in lines:
        lowest = np.max(force * by_force - by_stroke * stroke[:, None], axis=1)
        limit = np.fmax(limit, np.clip(lowest / (force * without), 0.0, 1.0))
    return reach, rule, gap, np.maximum(share, limit), limit


def _near_ranges(
    model: ModalModel, shapes: Array, mass: float, resonance: int
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the ends (P, 2) over omega_r of `optimisation.bounds.near_range`.

    The second result (P,) says whether the resonance with the stuck mass lies between them.
    """
    omega_r = model.resonance_omega(resonance)
    scaled = shapes / model.omega
    stuck = []
    for own in (DEFAULT_MASS_RATIO * model.beam_mass, mass):
        matrices = own * scaled[:, :, None] * scaled[:, None, :]
        matrices[:, np.arange(model.modes), np.arange(model.modes)] += model.omega**-2.0
        squares = np.linalg.eigvalsh(matrices)[:, ::-1]
        stuck.append(1 / np.sqrt(squares[:, resonance - 1]) / omega_r)
    usual = 1 - stuck[0]
    shift = 1 - stuck[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        low = np.maximum(LEAST_START * (1 - shift), 1 - (1 - NEAR[0]) * shift / usual)
    low = np.where(usual > 0, low, NEAR[0])
    usable = low <= stuck[1]
    low = np.where(usable, low, NEAR[0])
    return np.column_stack([low, np.full(len(shapes), NEAR[1])]), usable


def _linear_terms(
    model: ModalModel, shapes: Array, mass: float, resonance: int, ranges: Array
) -> tuple[Array, Array, tuple[Array, Array, float]]:
    """Return, for 1 N, the rule's gap and the free amplitude (P,) in m, and the terms of the limit.

    These are |A| (P, F) in m/N, |B| (P, F), and the largest amplitude in m/N without absorber at
    the place of the level.
    """
    omega_r = model.resonance_omega(resonance)
    damping = float(model.damping_ratio[resonance - 1])
    low = ranges[:, :1]
    high = ranges[:, 1:]
    ratios = low + (high - low) * np.linspace(0, 1, FREQUENCY_POINTS)
    near = 1 + damping * np.linspace(-PEAK_WIDTH, PEAK_WIDTH, PEAK_POINTS)
    peak = np.clip(np.broadcast_to(near, (len(shapes), PEAK_POINTS)), low, high)
    ratios = np.concatenate([ratios, peak], axis=1)
    omega = omega_r * ratios
    compliance = 1 / (
        model.omega**2
        - omega[..., None] ** 2
        + 2j * model.damping_ratio * model.omega * omega[..., None]
    )
    level = model.level_shape
    from_force = np.einsum("pfn,pn,n->pf", compliance, shapes, model.one_phase_force_shape)
    own = np.einsum("pfn,pn,pn->pf", compliance, shapes, shapes)
    to_level = np.einsum("pfn,pn,n->pf", compliance, shapes, level)
    free_level = compliance @ (model.one_phase_force_shape * level)
    inertia = mass * omega**2
    kappa = inertia * own
    with np.errstate(divide="ignore", invalid="ignore"):
        gaps = np.abs(from_force) / np.abs(kappa) * np.pi / 4
    # at a node the mass does nothing, in any gap
    rule = np.where(np.all(kappa == 0, axis=1), 0.0, np.max(gaps, axis=1))
    free = np.max(np.abs(from_force), axis=1)
    by_force = np.abs(free_level + to_level * inertia * from_force / (1 - kappa))
    by_stroke = np.abs(to_level * inertia / (1 - kappa))
    without = float(np.max(np.abs(free_level)))
    return rule, free, (by_force, by_stroke, without)


def expected_gap_and_share(rule: Array, reach: Array) -> tuple[Array, Array]:
    """Return the gap (P,) in m for all resonances together, and the expected level (P,).

    The level is that of the worst resonance over the level without absorber. ``rule`` (R, P) in m
    and ``reach`` (R, P) are those of single resonances. Near one resonance the level is lowest at
    the gap at which searches start; it is proportional to wider gaps and rises steeply at narrower
    gaps.
    """
    usable = np.isfinite(reach) & np.isfinite(rule) & (reach > 0)
    factor = np.vectorize(expected_factor, otypes=[float])(np.where(usable, reach, 1.0))
    best = np.where(usable, factor * rule, np.nan)
    lowest = np.where(usable, 1 / (1 + SHARE_SLOPE * np.where(usable, reach, 0.0)), 1.0)
    if len(rule) == 1:
        return best[0], lowest[0]
    known = np.all(usable, axis=0)
    ends = np.where(known, best, 1.0)
    gaps = np.geomspace(
        GAP_SPAN[0] * ends.min(axis=0), GAP_SPAN[1] * ends.max(axis=0), GAP_POINTS, axis=1
    )
    over = gaps[None] / ends[..., None]
    shares = lowest[..., None] * np.where(over >= 1, over, over**-CLIFF)
    worst = np.minimum(shares, 1.0).max(axis=0)
    at = np.argmin(worst, axis=1)
    chosen = np.arange(len(at))
    return (
        np.where(known, gaps[chosen, at], np.nan),
        np.where(known, worst[chosen, at], 1.0),
    )


def shortlist(places: Places, place_map: PlaceMap, number: int) -> list[int]:
    """Return the places to simulate, the most promising first.

    Their mode shapes differ by a twentieth or more.
    """
    rows = [resonance - 1 for resonance in place_map.forces]
    shapes = places.shapes[:, rows]
    chosen: list[int] = []
    for k in np.argsort(place_map.share, kind="stable").tolist():
        if not (np.isfinite(place_map.gap[k]) and place_map.gap[k] >= LEAST_GAP):
            continue
        size = float(np.linalg.norm(shapes[k]))
        if all(np.linalg.norm(shapes[k] - shapes[j]) > DISTINCT * size for j in chosen):
            chosen.append(k)
        if len(chosen) == number:
            break
    return chosen


DISTINCT = 0.05  # of the mode shapes at the resonances asked
