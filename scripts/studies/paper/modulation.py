"""Cause of the weaker modulation with many modes, beyond the paper.

With many modes, impacts remove energy from the resonant mode for good.

An impact changes the velocity of each mode by its share of one impulse. Most of the energy of the
off-resonant modes is dissipated before the next impact, so that for the resonant mode the impact
has losses. With G_n = 1/m_a + sum of phi_i^2 over n modes the impulse is (1 + e) gamma/G_n; a beam
of one mode has the same impulse with the restitution

    e_1 = (1 + e) G_1/G_n - 1.

So n modes without losses should be modulated as one mode with e_1 is: that is tested here. Below 0
the absorber stays behind the tip and is struck again.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from impact_env import (
    Beam,
    Drive,
    Record,
    RigidWalls,
    Scene,
    beam_scene,
    constant_frequency,
    impact_absorber,
    simulate,
)
from impact_env.energy import mechanical_energy
from impact_env.ensemble import Lane, draw_members
from impact_env.frequency import tip_response
from impact_env.periodic.stationary import cut_window
from studies.paper.claim import Claim, format_interval, make_claim
from studies.paper.curve import FULL_RECORD, compute_exponent
from studies.paper.frame import (
    SMALL,
    STYLES,
    PaperFigure,
    PaperSettings,
    Size,
    draw_legends,
    draw_line,
    make_panels,
    measure_groups,
    shorten_table,
)
from studies.study import Array, CsvTable, Json, Steps, not_none

LABEL = "modulation"
Case = tuple[Scene, Json, float]  # a scene, columns of its row, and the force in N
FORCE = 1.5  # N, the paper's for the strongly modulated response
SETTLING_PERIODS = 200  # pseudo periods before the window
# quantiles of the periods' peaks that the depth is taken between: a largest peak would grow with
# the window
ENDS = (
    0.05,
    0.95,
)

# modes, and forces over that at which the first impacts come
BEGUN = (1, 3, 10)
ABOVE = (1.01, 1.03, 1.1, 1.3)
MOST_FOLLOWED = 14  # modes up to which a tangent vector is followed
FAST = 4  # modes from which on most of what an impact scatters is gone before the next


def compute_equivalent_restitution(scene: Scene, restitution: float = 1.0) -> float:
    """Return the equivalent restitution e_1 (see the module) of a scene with an absorber.

    Below 0 the absorber is struck again at once.
    """
    compliances = 1 / not_none(scene.absorber_mass) + np.cumsum(scene.model.tip_shape**2)
    return float((1 + restitution) * compliances[0] / compliances[-1] - 1)


def measure_exchange(lane: Lane, periods: int) -> dict[str, float]:
    """Return depth of the modulation, level, impacts a period, and shares of the energy.

    They are those of a window of ``periods`` after the lane's own run, at the frequency and phase
    of its end.
    """
    scene = lane.scene
    settled = lane.drive
    omega = float(settled.schedule.omegas[-1])
    start = simulate(scene, settled, record=Record(events=True)).final_state
    drive = settled.followed_by(constant_frequency(omega, 1.0, periods))
    response = simulate(scene, drive, initial=start, record=FULL_RECORD)
    history = response.recorded.history
    loss = response.recorded.energy
    energy = mechanical_energy(scene, history)
    lost = float(np.sum(loss.modal_loss)) + loss.impact_loss
    taken = lost - float(loss.modal_loss[0])
    return {
        "depth": compute_depth(cut_window(scene, response, omega).peaks),
        "rms_m": float(np.sqrt(np.mean(history.tip_displacement**2))),
        "impacts": response.impact_count / periods,
        "absorber": float(np.mean(energy.absorber_share)),
        "absorber_most": float(np.quantile(energy.absorber_share, ENDS[1])),
        "taken": taken / lost,
        "a_period": taken / periods / float(np.mean(energy.modal[:, 0])),
    }


def compute_depth(peaks: Array) -> float:
    """Return the depth (a - b)/(a + b) of the modulation.

    a and b are the 95 and 5 % quantiles of the periods' largest |q_tip|, (M,).
    """
    low, high = np.quantile(peaks, ENDS)
    return float((high - low) / (high + low))


def _measure(settings: PaperSettings, size: Size, earlier: Json) -> Steps:
    many = [beam_scene(Beam(modes=n), impact_absorber()) for n in size.modes]
    equivalents = [max(compute_equivalent_restitution(scene), 0.0) for scene in many]
    same, one = (
        [beam_scene(Beam(modes=1), impact_absorber(restitution=e)) for e in each]
        for each in (equivalents, size.restitutions)
    )
    followed: list[Case] = [
        (scene, {}, FORCE) for scene in many if scene.model.modes <= MOST_FOLLOWED
    ]  # from the paper's own phase
    begun: list[Case] = [
        (scene, {"over": over}, over * _filling(scene))
        for scene in many
        if scene.model.modes in BEGUN
        for over in ABOVE
    ]
    groups = {
        "modes": partial(_rows, settings, size, many, equivalents),
        "equivalent": partial(_rows, settings, size, same, equivalents),
        "one mode": partial(_rows, settings, size, one, size.restitutions),
        "exponents": partial(_exponents, settings, "exponents", size.periods, followed),
        "begins": partial(_exponents, settings, "begins", size.periods // 2, begun),
    }
    return measure_groups(groups, earlier)


def _filling(scene: Scene) -> float:
    """Return the force in N at which the free tip fills the gap."""
    return RigidWalls.gap / float(
        np.abs(tip_response(scene.model, None, np.array([scene.model.resonance_omega(1)])))[0]
    )


def _exponents(settings: PaperSettings, name: str, periods: int, cases: list[Case]) -> list[Json]:
    """Return the largest Lyapunov exponent of scenes under forces in N.

    A force may also be given as "over", its ratio to the force at which the tip without absorber
    reaches the gap.
    """
    lanes = [
        Lane(
            scene,
            Drive(force, constant_frequency(scene.model.resonance_omega(1), 1.0, SETTLING_PERIODS)),
        )
        for scene, _, force in cases
    ]
    result = settings.each(f"{LABEL}: {name}", lanes, partial(compute_exponent, periods=periods))
    return [
        {
            "modes": scene.model.modes,
            **(over and {**over, "force_n": force}),
            "exponent": list(exponent),
        }
        for (scene, over, force), exponent in zip(cases, result, strict=True)
    ]


def _rows(
    settings: PaperSettings, size: Size, scenes: list[Scene], restitutions: Sequence[float]
) -> list[Json]:
    """Return a row for each scene with statistics of its members.

    They are medians, 5 and 95 %, and the nominal member.
    """
    members = draw_members(size.members, settings.seed)
    lanes = []
    for scene in scenes:
        schedule = constant_frequency(scene.model.resonance_omega(1), 1.0, SETTLING_PERIODS)
        lanes += [Lane(scene, drive) for drive in members.drives(FORCE, schedule)]
    result = settings.each(LABEL, lanes, partial(measure_exchange, periods=size.periods))
    rows = []
    for k, (scene, restitution) in enumerate(zip(scenes, restitutions, strict=True)):
        own = result[k * len(members) : (k + 1) * len(members)]
        values = {
            name: [float(x) for x in np.quantile([one[name] for one in own], (0.5, *ENDS))]
            + [own[0][name]]
            for name in own[0]
        }
        rows.append({"modes": scene.model.modes, "restitution": restitution, **values})
    return rows


def _table(values: Json) -> CsvTable:
    """Return all numbers of modes beside one mode with the equivalent restitution."""
    header = (
        "modes",
        "$e_1$",
        "depth",
        "one mode with $e_1$",
        "taken from mode 1, %",
        "one mode with $e_1$",
        "absorber's energy, %",
        "impacts a period",
        "largest exponent a period (95 %)",
    )
    body = []
    exponents = {row["modes"]: format_interval(*row["exponent"]) for row in values["exponents"]}
    for row, other in zip(values["modes"], values["equivalent"], strict=True):
        cells = (
            _interval(row["depth"]),
            _interval(other["depth"]),
            *(_interval(one["taken"], 100, 0) for one in (row, other)),
        )
        last = (
            _interval(row["absorber"], 100, 0),
            _interval(row["impacts"]),
            exponents.get(row["modes"], ""),
        )
        body.append((f"{row['modes']}", f"{row['restitution']:.2f}", *cells, *last))
    return CsvTable(f"{LABEL}_modes", header, body)


def _begun(values: Json) -> str:
    """Say how the exponent begins above the first impacts."""
    text = []
    for modes in dict.fromkeys(row["modes"] for row in values["begins"]):
        own = [
            format_interval(*row["exponent"]) for row in values["begins"] if row["modes"] == modes
        ]
        text.append(f"{', '.join(own)} with {modes} mode{'s' if modes > 1 else ''}")
    shares = ", ".join(
        f"{over:g}" for over in dict.fromkeys(row["over"] for row in values["begins"])
    )
    return (
        f"How it begins: at {shares} times the force at which the free tip fills the gap the "
        f"largest exponent is {'; '.join(text)}."
    )


def _interval(result: list[float], scale: float = 1.0, digits: int = 2) -> str:
    return format_interval(*result[:3], form=f"{{:.{digits}f}}", factor=scale)


def _worst(values: Json) -> tuple[Json, Json]:
    """Return the pair of rows whose depths of modulation differ most.

    A pair has a model of many modes and a model of one mode with the equivalent restitution.
    """
    return max(
        zip(values["modes"], values["equivalent"], strict=True),
        key=lambda pair: abs(pair[0]["depth"][0] - pair[1]["depth"][0]),
    )


def _compared(values: Json) -> str:
    """Return a text on how many modes and one mode with the equivalent restitution differ.

    It gives the differences of all cases, and of those with fast scattering.
    """
    row, other = _worst(values)
    result = []
    for few in (1, FAST):
        some = [
            pair
            for pair in zip(values["modes"], values["equivalent"], strict=True)
            if pair[0] is not row and pair[0]["modes"] >= few
        ]
        depths, shares = (
            max(abs(one[name][0] - same[name][0]) for one, same in some)
            for name in ("depth", "taken")
        )
        level = max(abs(one["rms_m"][0] / same["rms_m"][0] - 1) for one, same in some)
        result.append(
            f"the depths by {depths:.2f} at most, the shares taken by {100 * shares:.0f} "
            f"points, the levels by {100 * level:.0f} %"
        )
    return (
        f"They differ most at {row['modes']} modes, whose $e_1$ is "
        f"{other['restitution']:.3f}: the depths are {_interval(row['depth'])} and "
        f"{_interval(other['depth'])}, and one mode has {_interval(other['impacts'])} impacts "
        f"a period. Else {result[0]}, and from {FAST} modes on "
        f"{result[1]}."
    )


def _answer(values: Json) -> str:
    """Return a sentence on the cause of the weaker modulation, and its limits."""
    row, other = _worst(values)
    return (
        "What makes the modulation less obvious: energy that impacts scatter for good; one "
        "mode with a restitution that takes as much has nearly "
        f"the same depth, except at {row['modes']} modes, {row['depth'][0]:.2f} against "
        f"{other['depth'][0]:.2f}."
    )


def _claims(values: Json) -> list[Claim]:
    """Return the paper's statements on the modulation over the number of modes."""
    few, many = (values["modes"][k] for k in (0, -1))
    text_values = {
        "few": _interval(few["depth"]),
        "fewest": few["modes"],
        "many": _interval(many["depth"]),
        "most": many["modes"],
    }
    depth = np.array(many["depth"][1:3]) / few["depth"][0]
    return [
        make_claim(LABEL, "modulation_fades", many["depth"][2] < few["depth"][1], **text_values),
        make_claim(
            LABEL,
            "modulation_insensitive",
            depth,
            level=many["rms_m"][0] / few["rms_m"][0],
            **text_values,
        ),
    ]


NAMED = (1, 2, 3, 4, 5, 7, 10, 12)  # numbers of modes that stand beside their points


def _draw(values: Json) -> Figure:
    """Draw depth and energies over the number of modes, and the depth over the restitution.

    The results are compared with those of one mode with the equivalent restitution.
    """
    figure, axes = make_panels(1, 3, 2.9)
    depth, energy, over = axes[0]
    many = values["modes"]
    other = values["equivalent"]
    one = values["one mode"]
    modes, restitutions = ([row[name] for row in many] for name in ("modes", "restitution"))
    for rows, style, label in (
        (many, STYLES[0], "$N_m$ modes, $e$ = 1"),
        (other, STYLES[1], "one mode, $e_1$"),
    ):
        middle, low, high, nominal = _columns(rows, "depth")
        draw_line(depth, modes, middle, style, label, band=(low, high), nominal=nominal)
    draw_line(energy, modes, 100 * _columns(many, "taken")[0], STYLES[0], "taken, $N_m$ modes")
    draw_line(energy, modes, 100 * _columns(other, "taken")[0], STYLES[1], "taken, one mode, $e_1$")
    draw_line(energy, modes, 100 * _columns(many, "absorber")[0], STYLES[2], "in the absorber")
    for panel in (depth, energy):
        panel.set(xscale="log", xlabel="modes $N_m$")
        panel.set_xticks(
            modes, [f"{n}" if n in (1, 2, 3, 5, 10, 20, 30) else "" for n in modes], minor=False
        )
        panel.minorticks_off()
    middle, low, high, _ = _columns(one, "depth")
    draw_line(
        over,
        [row["restitution"] for row in one],
        middle,
        STYLES[1],
        "one mode over $e$",
        band=(low, high),
    )
    draw_line(over, restitutions, _columns(many, "depth")[0], STYLES[0], marked=False)
    over.lines[-1].set(ls="", marker=STYLES[0].marker, label="$N_m$ modes at their $e_1$")
    for e in dict.fromkeys(restitutions):
        own = [row for row in many if row["restitution"] == e]  # several that are set to 0
        last = own[-1]["modes"]
        height = max(row["depth"][0] for row in own)
        text, offset = (
            (f"{own[0]['modes']} to {last}", (-6, 13))
            if len(own) > 1
            else (f"{last}" if last in NAMED else "", (3, -9))
        )
        over.annotate(
            text,
            (e, height),
            xytext=offset,
            textcoords="offset points",
            fontsize=SMALL,
            color="0.35",
        )
    depth.set(ylabel="depth of the modulation", ylim=(0, 0.95))
    energy.set(ylabel="share in %", ylim=(0, 125), yticks=range(0, 101, 20))
    over.set(
        xlabel="restitution of one mode, $e_1$",
        ylabel="depth of the modulation",
        xlim=(None, 1.09),
        ylim=(0, None),
    )
    depth.legend(loc="upper right")
    over.legend(loc="lower right", fontsize=SMALL)
    draw_legends(axes)
    return figure


def _columns(rows: list[Json], name: str) -> Array:
    """Return median, 5 and 95 % and the nominal member of all rows, (4, rows)."""
    return np.array([row[name] for row in rows]).T


FIGURE = PaperFigure(
    LABEL,
    "what makes the modulation less obvious",
    measure=_measure,
    draw=_draw,
    claims=_claims,
    answer=_answer,
    describe=lambda values: (
        f"{shorten_table(_table(values))}\n\n{_compared(values)}\n\n{_begun(values)}"
    ),
    tables=lambda values: (_table(values),),
    sizes=(  # restitutions of one mode; pseudo periods of the window
        Size(
            modes=(1, 2, 3, 4, 5, 7, 10, 11, 12, 13, 14, 15, 20, 30),
            restitutions=np.unique([*np.linspace(0, 1, 11), *np.linspace(0.02, 0.18, 9)])
            .round(2)
            .tolist(),
            periods=1000,
            members=8,
        ),
        Size(
            modes=(1, 3, 10, 20), restitutions=(0.0, 0.25, 0.5, 0.75, 1.0), periods=300, members=3
        ),
    ),
)
