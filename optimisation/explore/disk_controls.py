"""The controls of a bladed disk on the explorer's page, and the disk that they describe."""

from dataclasses import replace

import numpy as np

from impact_env.checks import ParameterError
from impact_env.parameters import (
    DEFAULT_MASS_RATIO,
    RigidWalls,
    SlidingAbsorber,
    friction_damper,
    impact_absorber,
)
from impact_env.structures.cyclic import BladedDisk
from optimisation.disks import find_excited_resonance
from optimisation.explore.control import Control, ControlValues

DISK_CONCEPTS = {
    "impact": "impact absorber in each sector",
    "friction": "friction damper in each sector",
    "none": "no absorber",
}
GAP_SHARE = 0.2  # of the amplitude without absorber: the gap at which a page begins
DISK_FORCE = 1.0  # N on each sector, where the disk says nothing
MOST_MISTUNED = 0.1  # standard deviation of the sectors' frequencies


def find_disk_amplitude(disk: BladedDisk) -> float:
    """Return the approximate resonance amplitude in m of a tuned disk without absorbers.

    It is that at the excited resonance for 1 N on each sector.
    """
    tuned = disk.tuned().with_absorbers(())
    mode = find_excited_resonance(tuned) - 1
    model = tuned.model
    damping = max(float(model.damping_ratio[mode]), 1e-6)
    force = abs(complex(model.force_pattern[mode]))
    shape = float(np.max(np.abs(tuned.response_shapes[:, mode])))
    # of a pair of modes both answer
    return force * shape / (2 * damping * float(model.omega[mode]) ** 2)


def disk_controls(disk: BladedDisk) -> tuple[Control, ...]:
    """Return the controls of a disk, in the order of the page."""
    own = disk.absorbers[0] if isinstance(disk.absorbers, tuple) and disk.absorbers else None
    force = DISK_FORCE if disk.amplitude is None else disk.amplitude
    gap = float(f"{GAP_SHARE * force * find_disk_amplitude(disk):.2g}")
    restitution = 0.7
    friction = 0.0
    mass_ratio = DEFAULT_MASS_RATIO
    if own is not None:
        mass_ratio = own.mass_ratio
        friction = 0.0 if own.friction is None else own.friction.limit
        if isinstance(own.walls, RigidWalls):
            gap = own.walls.gap
            if isinstance(own.walls.restitution, int | float):
                restitution = float(own.walls.restitution)
    large = max(friction, force)
    table = (
        Control(
            "force",
            "Force on each sector",
            force / 100,
            force * 30,
            force,
            "N",
            log=True,
            loads=("force",),
            group="load",
            about="Amplitude of the harmonic force on each sector.",
        ),
        Control(
            "engine_order",
            "Engine order",
            0,
            disk.ring.sectors // 2,
            disk.engine_order,
            whole=True,
            group="load",
            about=(
                "Periods of the travelling force around the disk; it excites as many nodal "
                "diameters."
            ),
        ),
        Control(
            "gap",
            "Gap to either wall",
            gap / 50,
            gap * 50,
            gap,
            "mm",
            1e3,
            log=True,
            concepts=("impact",),
            about="Distance from the middle of the cavity to either wall: half of the free travel.",
        ),
        Control("restitution", "Restitution", 0.0, 1.0, restitution, concepts=("impact",)),
        Control(
            "friction",
            "Friction limit",
            large * 1e-4,
            large * 10,
            friction,
            "N",
            log=True,
            zero=True,
            concepts=("impact",),
            about="Largest dry friction force between a mass and its sector.",
        ),
        Control(
            "damper_friction",
            "Friction limit",
            large * 1e-4,
            large * 10,
            large / 10,
            "N",
            log=True,
            concepts=("friction",),
            about="Largest dry friction force between a mass and its sector.",
        ),
        Control(
            "mass_ratio",
            "Mass",
            1e-3,
            0.2,
            mass_ratio,
            "% of the sector's",
            100,
            log=True,
            concepts=("impact", "friction"),
            about="Mass of each absorber.",
        ),
        Control(
            "mistuning",
            "Mistuning of the sectors",
            1e-4,
            MOST_MISTUNED,
            disk.ring.mistuning.frequency,
            "%",
            100,
            log=True,
            zero=True,
            group="structure",
            about="Standard deviation of the sectors' frequencies; the worst sector counts.",
        ),
    )
    return tuple(control for control in table if control.low < control.high)


def disk_of(values: ControlValues, disk: BladedDisk) -> BladedDisk:
    """Return the disk with the page's engine order, mistuning and absorbers.

    Raises ParameterError if they cannot be combined.
    """
    order = int(values.numbers.get("engine_order", disk.engine_order))
    mistuning = replace(disk.ring.mistuning, frequency=values["mistuning"])
    own = replace(
        disk,
        ring=replace(disk.ring, mistuning=mistuning),
        engine_order=order,
        amplitude=values["force"],
    )
    return own.with_absorbers(disk_absorber_of(values) or ())


def disk_absorber_of(values: ControlValues) -> SlidingAbsorber | None:
    """Return the absorber of each sector."""
    mass = values["mass_ratio"]
    if values.concept == "none":
        return None
    if values.concept == "friction":
        return friction_damper(values["damper_friction"], mass)
    absorber = impact_absorber(values["gap"], values["restitution"], values["friction"], mass)
    if not isinstance(absorber, SlidingAbsorber):
        raise ParameterError("an absorber of a disk slides")
    return absorber
