"""The explorer's server computes correct values and refuses wrong requests.

The tests need no browser. They include the addresses to which the server responds.
"""

import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import done
from places import EXAMPLES

pytest.importorskip("starlette")
pytest.importorskip("httpx2")
from starlette.testclient import TestClient, WebSocketTestSession
from starlette.websockets import WebSocketDisconnect

from impact_env import (
    Beam,
    Drive,
    Record,
    load_structure,
    modal_model,
    performance_curve,
    simulate,
)
from impact_env.checks import ParameterError
from impact_env.curve import CurveCase
from impact_env.drive import FrequencySchedule, constant_frequency
from impact_env.ensemble import Lane
from impact_env.frequency import find_steady_start
from impact_env.plain import to_scene
from impact_env.plain_loads import to_loads
from impact_env.sectors import linear_sector_response
from impact_env.structures.cyclic import BladedDisk, ring_of_masses
from optimisation.calibration.posterior import Posterior
from optimisation.cli.group import imported
from optimisation.disks import DiskRun, disk_schedule
from optimisation.explore.advice import recommend_values
from optimisation.explore.disk_controls import disk_of
from optimisation.explore.examples import make_measured_example
from optimisation.explore.server import (
    MOST_BYTES,
    MOST_TABS,
    make_app,
    make_work,
    names_of,
    open_socket,
    page_address,
)
from optimisation.explore.settings import (
    RefusedValues,
    commands_of,
    controls,
    parse_controls,
    replace_numbers,
    scene_file,
    scene_of,
    sweep_range_of,
)
from optimisation.explore.verdict import judge_level
from optimisation.explore.waiting import Kernels
from optimisation.explore.work import Work
from optimisation.frequency_levels import frequency_curve
from optimisation.measures import prediction_interval, read
from optimisation.sweep_range import find_sweep_range
from optimisation.tuned import den_hartog

HOST = "127.0.0.1:8651"
OWN = {"host": HOST, "origin": f"http://{HOST}"}
VALUES = {"modes": 3, "friction": 0.1, "members": 2}
BEAM = Beam()


@pytest.fixture(scope="module", autouse=True)
def few() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("optimisation.explore.work.FORCES", 8)
        patch.setattr(
            "optimisation.explore.advice.smallest_amplitude",
            lambda model, mass_ratio, resonance, *_range: den_hartog(model, mass_ratio, resonance),
        )
        yield


@pytest.fixture(scope="module")
def client() -> Iterator[TestClient]:
    with TestClient(
        make_app(BEAM, "the paper's beam", names_of("127.0.0.1")), base_url=f"http://{HOST}"
    ) as client:
        yield client


def until(session: WebSocketTestSession, *kinds: str) -> list[dict[str, Any]]:
    """Return the messages up to the first of some kinds."""
    messages = []
    while not messages or messages[-1]["type"] not in kinds:
        messages.append(json.loads(session.receive_text()))
    return messages


def test_the_page_brings_all_that_it_needs(client: TestClient) -> None:
    page = client.get("/")
    assert page.status_code == 200
    assert "default-src 'none'" in page.headers["content-security-policy"]
    for name in (
        "main.js",
        "address.js",
        "charts.js",
        "controls.js",
        "figure.js",
        "format.js",
        "motion.js",
        "verdict.js",
        "uplot.js",
        "uplot.css",
        "style.css",
        "icon.svg",
        "uplot-LICENSE.txt",
    ):
        answer = client.get(f"/assets/{name}")
        assert answer.status_code == 200
        foreign = answer.text.replace("http://www.w3.org/2000/svg", "").replace(
            "ws://${location.host}", ""
        )
        assert "://" not in foreign.replace("https://github.com/leeoniya/uPlot", ""), name
    assert client.get("/assets/../server.py").status_code == 404
    explained = client.get("/help").text
    assert "://" not in explained
    table = client.get("/controls").json()
    assert {control["name"] for control in table["controls"]} >= {
        "force",
        "gap",
        "restitution",
        "modes",
        "members",
    }
    assert all(
        control["low"] <= control["value"] <= control["high"] or control["zero"]
        for control in table["controls"]
    )
    for row in table["numbers"]:
        assert row["about"].endswith(".")
        assert f'id="{row["key"]}"' in explained


@pytest.mark.parametrize(
    "headers",
    [
        {"host": "evil.example:8651"},
        {"host": "192.168.1.20:8651"},
        {"host": "127.0.0.1.evil.example:8651"},
        {"host": "evil.example@127.0.0.1:8651"},
        {"host": HOST, "origin": "http://evil.example"},
        {"host": HOST, "origin": "http://127.0.0.1:9"},
        {"host": HOST},
    ],
    ids=[
        "rebound name",
        "other address",
        "longer name",
        "user",
        "foreign page",
        "other port",
        "no page",
    ],
)
def test_others_are_refused(client: TestClient, headers: dict[str, str]) -> None:
    for address in ("/", "/controls"):
        assert (client.get(address, headers=headers).status_code == 403) == (
            headers != {"host": HOST}
        )  # a socket needs an origin
    with pytest.raises(WebSocketDisconnect), client.websocket_connect("/socket", headers=headers):
        pass


@pytest.mark.parametrize(
    ("listens", "host"),
    [
        ("127.0.0.1", "localhost:9000"),
        ("127.0.0.1", "[::1]:9000"),
        ("0.0.0.0", "192.168.1.20:8651"),
        ("0.0.0.0", "127.0.0.1:9000"),
        ("::", "[fe80::1]:8651"),
        ("::", "192.168.1.20"),
        ("0.0.0.0", f"{socket.gethostname()}:8651"),
        ("192.168.1.20", "192.168.1.20:8651"),
        ("0.0.0.0", "proxy.example"),
    ],
)
def test_a_page_answers_to_every_address_that_leads_to_it(listens: str, host: str) -> None:
    """The server responds under every address that leads to it.

    These are addresses through a tunnel or a container with other ports, all addresses, and an
    allowed name.
    """
    app = make_app(BEAM, "the paper's beam", names_of(listens, "proxy.example"))
    headers = {"host": host, "origin": f"http://{host}"}
    with TestClient(app, base_url=f"http://{HOST}") as client:
        assert client.get("/", headers=headers).status_code == 200
        with client.websocket_connect("/socket", headers=headers):
            pass
        strange = {"host": "evil.example:8651", "origin": "http://evil.example:8651"}
        assert client.get("/", headers=strange).status_code == 403
        with (
            pytest.raises(WebSocketDisconnect),
            client.websocket_connect("/socket", headers=strange),
        ):
            pass


def test_all_addresses_are_bound_and_the_page_is_named_by_one_that_a_browser_takes() -> None:
    with open_socket("0.0.0.0", 0) as listening:
        port = listening.getsockname()[1]
        assert page_address(listening) == f"http://127.0.0.1:{port}/"
        with pytest.raises(ParameterError, match=f"--port = {port} is not allowed"):
            open_socket("0.0.0.0", port)


@pytest.mark.parametrize(
    ("address", "page"),
    [
        (("::", 8651, 0, 0), "http://[::1]:8651/"),
        (("::1", 8651, 0, 0), "http://[::1]:8651/"),
        (("fe80::2", 80, 0, 3), "http://[fe80::2]:80/"),
        (("192.168.1.20", 8651), "http://192.168.1.20:8651/"),
    ],
)
def test_a_page_of_another_address_family_is_named_in_brackets(
    address: tuple[object, ...], page: str
) -> None:
    class Listening:
        """A socket that listens at an address."""

        def getsockname(self) -> tuple[object, ...]:
            return address

    assert page_address(Listening()) == page


def test_what_is_drawn_is_what_the_library_computes(client: TestClient) -> None:
    with client.websocket_connect("/socket", headers=OWN) as session:
        session.send_text(json.dumps({"number": 1, "values": VALUES}))
        messages = until(session, "done", "failed", "refused")
    assert messages[-1]["type"] == "done"
    assert {message["number"] for message in messages} == {1}
    taken = messages[0]
    scene = to_scene(taken["scene"])
    kinds = [message["type"] for message in messages if message["type"] != "compiling"]
    curves = [message for message in messages if message["type"] == "curve"]
    assert curves[-1]["complete"]
    assert not curves[-1]["rough"]
    settings = {"steady_start": True, "limits": find_sweep_range(scene.model, 0.02)}
    wanted = performance_curve(scene, curves[-1]["force"], members=2, **settings)
    assert curves[-1]["both"] == wanted.median.tolist()
    (card,) = (message for message in messages if message["type"] == "card")
    here = performance_curve(scene, [card["force"]], members=2, **settings)
    assert (card["force"], card["level"], card["band"]) == (
        3.5,
        here.median[0],
        list(prediction_interval(here.combined[0])),
    )
    assert card["without"] == pytest.approx(
        performance_curve(to_scene({"beam": {"modes": 3}}), [3.5], members=1, **settings).median[0],
        rel=1e-12,
    )
    (sweep,) = (message for message in messages if message["type"] == "sweep")
    drive = Drive(3.5, CurveCase(scene, [3.5], limits=settings["limits"]).schedules()[0])
    start = find_steady_start(scene, drive)
    record = Record(events=True, series=True)
    run = simulate(scene, drive, initial=start, record=record)
    assert (sweep["level"], sweep["at"], sweep["impacts"]) == (
        run.level.value,
        run.level.time,
        run.impact_count,
    )
    speed = np.abs(run.impacts.relative_velocity)
    time = run.drive.schedule.times[-1]
    assert (card["largest_speed"], card["impacts_a_second"]) == pytest.approx(
        (speed.max(), run.impact_count / time), rel=1e-12
    )
    assert card["power"] == pytest.approx(run.impacts.energy_lost.sum() / time, rel=1e-12)
    ratio = here.lanes.frequency_ratio.max()
    assert card["acceleration"] == pytest.approx(
        np.sqrt(2) * card["level"] * (ratio * scene.model.omega[0]) ** 2, rel=1e-12
    )
    assert max(x for x in sweep["high"] if x is not None) == pytest.approx(
        run.history.tip_displacement.max(), rel=1e-5
    )
    levels = [message for message in messages if message["type"] == "response"][-1]["levels"]
    lanes = [
        Lane(scene, Drive(3.5, schedule), steady_start=True)
        for schedule in CurveCase(scene, [3.5], limits=settings["limits"]).schedules()
    ]
    own_levels = frequency_curve("", lanes, settings["limits"]).level
    assert np.array(levels["with"], dtype=float) == pytest.approx(own_levels, rel=1e-5, nan_ok=True)
    (whole,) = (message for message in messages if message["type"] == "whole_run")
    rows = np.searchsorted(run.history.time, np.array(whole["time"]) - 1e-6)
    assert np.array(whole["absorbers"])[:, 0] == pytest.approx(
        run.history.absorber_displacement[rows], rel=1e-3, abs=1e-12
    )
    assert whole["time"][-1] == pytest.approx(time, rel=1e-3)
    assert {message["which"] for message in messages if message["type"] == "line"} == {
        "none",
        "limit",
        "friction",
        "tuned",
    }
    assert (
        kinds.index("response")
        < kinds.index("curve")
        < kinds.index("sweep")
        < kinds.index("card")
        < kinds.index("done")
    )


def run_commands(taken: dict[str, Any], folder: Path) -> list[dict[str, Any]]:
    """Run the exported commands in a folder with the exported files.

    Return their results. Figures are not drawn.
    """
    (folder / "scene.json").write_text(json.dumps(taken["scene"]))
    for name, load in taken["loads"].items():
        (folder / name).write_text(json.dumps(load))
    results = []
    for command in taken["commands"]:
        words = command.removeprefix("impact-absorber sweep ").split()
        plot = words.index("--plot")
        done(imported("sweep"), *words[:plot], *words[plot + 2 :])
        results.append(json.loads((folder / words[-1]).read_text()))
    return results


@pytest.mark.parametrize(
    "values",
    [
        {"direction": "down", "members": 1, "mass_ratio": 0.02},
        {"direction": "both", "members": 3, "mass_ratio": 0.08},
        {"direction": "both", "members": 2, "load": "unbalance", "concept": "tuned"},
    ],
    ids=["down", "both ways", "files of loads"],
)
def test_the_commands_give_the_cards_numbers(
    values: dict[str, Any],
    client: TestClient,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    """The exported commands give the level and impacts of the page's card.

    The range of the sweeps is that of other commands for absorbers of this mass.
    """
    with client.websocket_connect("/socket", headers=OWN) as session:
        session.send_text(json.dumps({"number": 1, "values": VALUES | values}))
        messages = until(session, "card", "failed")
    taken = messages[0]
    card = messages[-1]
    monkeypatch.chdir(tmp_path)
    results = run_commands(taken, tmp_path)
    levels = [result["response_level_m"] for result in results]
    assert len(levels) == (2 if values["direction"] == "both" else 1)
    assert card["level"] == pytest.approx(float(np.median(np.max(levels, axis=0))), rel=1e-12)
    (sweep,) = (message for message in messages if message["type"] == "sweep")
    assert (results[0]["response_level_m"][0], results[0]["impacts"]) == (
        sweep["level"],
        sweep["impacts"],
    )
    scene = to_scene(taken["scene"])
    low, high = find_sweep_range(scene.model, values.get("mass_ratio", 0.02))
    assert (max(sweep["ratio"]), min(sweep["ratio"])) == pytest.approx((high, low), abs=0.001)


def test_two_absorbers_are_swept_over_the_range_of_both_places() -> None:
    values = parse_controls(
        {"modes": 3, "concept": "two", "mass_ratio": 0.05, "resonance": 2}, BEAM
    )
    ranges = [
        find_sweep_range(modal_model(Beam(modes=3, absorber_position=place)), 0.05, 2)
        for place in (1.0, 0.6)
    ]
    low, high = zip(*ranges, strict=True)
    assert sweep_range_of(values, BEAM) == (min(low), max(high))


@pytest.mark.parametrize(
    ("sent", "control", "message"),
    [
        (
            {"number": 2, "values": {"gap": -1}},
            "gap",
            "Gap to either wall = -1000 mm is not allowed: 0.02 to 50 mm",
        ),
        ({"number": 2, "values": {"modes": 10**9}}, "modes", "from 1 to 40"),
        ({"number": 2, "values": {"members": 2.5}}, "members", "whole number"),
        ({"number": 2, "values": {"force": None}}, "force", "no number; allowed is 0.035 to 105 N"),
        ({"number": 2, "values": {"force": 10**400}}, "force", "is not allowed: 0.035 to 105 N"),
        ({"number": 2, "values": {"mass_ratio": 0.5}}, "mass_ratio", "Mass = 50 % of"),
        ({"number": 2, "structure": "moon", "values": {}}, "", "not one of own, disk, arm"),
        ({"number": 2, "values": {"modes": 2, "resonance": 3}}, "resonance", "1 to 2"),
        ({"number": 2, "values": {"concept": "rubber"}}, "concept", "one of"),
        ({"number": 2, "values": {"surprise": 1}}, "", "surprise is not allowed"),
        ({"number": 2, "values": [1]}, "", "a table of the page's controls"),
        ({"number": "2", "values": {}}, "", "a message is a table"),
        *(
            (text, "", "")
            for text in (
                "",
                "{",
                "NaN",
                "[" * 8000,
                '{"number": 1e999}',
                '{"number": 3, "values": {"gap": NaN}}',
            )
        ),
    ],
)
def test_bad_values_are_refused_at_their_control(
    client: TestClient, sent: Any, control: str, message: str
) -> None:
    with client.websocket_connect("/socket", headers=OWN) as session:
        session.send_text(sent if isinstance(sent, str) else json.dumps(sent))
        (answer,) = until(session, "refused", "taken")
    assert answer["type"] == "refused"
    assert not message or message in answer["errors"][control]


def test_messages_and_tabs_are_limited(client: TestClient) -> None:
    with client.websocket_connect("/socket", headers=OWN) as session:
        session.send_text("x" * (MOST_BYTES + 1))
        with pytest.raises(WebSocketDisconnect) as closed:
            session.receive_text()
        assert closed.value.code == 1009
    with ExitStack() as tabs:
        for _ in range(MOST_TABS):
            tabs.enter_context(client.websocket_connect("/socket", headers=OWN))
        with (
            pytest.raises(WebSocketDisconnect) as closed,
            client.websocket_connect("/socket", headers=OWN) as session,
        ):
            session.receive_text()
        assert closed.value.code == 1013


def test_a_newer_setting_ends_the_work_on_an_older_one(client: TestClient) -> None:
    with client.websocket_connect("/socket", headers=OWN) as session:
        for number in range(1, 6):
            session.send_text(
                json.dumps(
                    {
                        "number": number,
                        "values": VALUES | {"members": 64, "gap": 1e-3 * (1 + number / 100)},
                    }
                )
            )
        session.send_text(json.dumps({"number": 6, "values": VALUES}))
        messages = until(session, "done", "failed")
    numbers = [
        message["number"] for message in messages if message["type"] not in ("taken", "compiling")
    ]
    assert numbers == sorted(numbers)
    assert numbers[-1] == 6
    assert not [
        m
        for m in messages
        if m["number"] < 6 and (m["type"] in ("card", "line") or m.get("branches"))
    ]


def test_a_moved_force_keeps_the_curve() -> None:
    kernels = Kernels()
    known = dict[Any, Any]()
    first = list(Work(parse_controls(VALUES, BEAM), BEAM, kernels).messages(known))
    again = list(Work(parse_controls(VALUES | {"force": 3.0}, BEAM), BEAM, kernels).messages(known))
    last = [[m for m in messages if m["type"] == "curve"][-1] for messages in (first, again)]
    assert last[0] == last[1]
    assert len([m for m in again if m["type"] == "curve"]) < len(
        [m for m in first if m["type"] == "curve"]
    )
    assert next(m for m in again if m["type"] == "sweep")["force"] == 3.0


@pytest.mark.parametrize("concept", ["friction", "tuned", "none"])
def test_each_concept_is_drawn(concept: str) -> None:
    values = parse_controls({"modes": 3, "members": 1, "concept": concept}, BEAM)
    messages = list(Work(values, BEAM, Kernels()).messages({}))
    assert json.loads(json.dumps(messages, allow_nan=False)) == messages
    assert {m["type"] for m in messages} - {"compiling", "line"} == {
        "curve",
        "sweep",
        "motion",
        "whole_run",
        "card",
        "response",
        "done",
    }


def test_another_load_is_that_of_its_file(client: TestClient) -> None:
    with client.websocket_connect("/socket", headers=OWN) as session:
        values = {"modes": 3, "members": 3, "concept": "tuned", "load": "random"}
        session.send_text(json.dumps({"number": 1, "values": values}))
        messages = until(session, "done", "failed", "refused")
    assert messages[-1]["type"] == "done"
    taken = messages[0]
    scene = to_scene(taken["scene"])
    (command,) = taken["commands"]
    assert "--load load.json" in command
    loads = to_loads(taken["loads"]["load.json"], scene.model.resonance_omega(1))
    run = simulate(scene, loads, record=Record(events=True, series=True, samples_per_period=64))
    latest = {message["type"]: message for message in messages}
    assert latest["sweep"]["level"] == pytest.approx(read(run), rel=1e-12)
    low, high = latest["card"]["band"]
    assert low <= latest["card"]["level"] <= high
    assert high > 1.001 * low  # members have records of their own
    curve = [message for message in messages if message["type"] == "curve"][-1]
    assert (
        np.ptp(np.array(curve["both"]) / curve["force"]) < 1e-9 * curve["both"][-1]
    )  # a linear scene


def card_of(values: dict[str, Any]) -> dict[str, Any]:
    """Return the card of a setting on the paper's beam; nothing of it may be a problem."""
    work = Work(parse_controls(VALUES | values, BEAM), BEAM, Kernels())
    messages = list(work.messages({}))
    assert not [message for message in messages if message["type"] == "problem"]
    return next(message for message in messages if message["type"] == "card")


def test_a_cavity_in_which_nothing_can_be_gained_has_a_card() -> None:
    """The limit of a gap of 0.02 mm at 3.5 N lies above the level of the sweep without absorber."""
    card = card_of({"gap": 2e-5, "members": 1})
    assert card["limit"] > card["without"]
    assert card["share"] is None
    assert card["verdict"]["grade"] == "poor"


def test_no_absorber_is_compared_with_the_same_records() -> None:
    card = card_of({"concept": "none", "load": "random", "members": 3})
    assert card["level"] == card["without"]
    assert card["verdict"]["grade"] == "neutral"


def test_a_part_that_cannot_be_computed_leaves_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_self: Work, _case: CurveCase) -> Iterator[dict[str, Any]]:
        raise ParameterError("no number")
        yield {}

    monkeypatch.setattr(Work, "card", refuse)
    values = parse_controls({"modes": 3, "members": 1, "concept": "tuned"}, BEAM)
    messages = list(Work(values, BEAM, Kernels()).messages({}))
    assert {"type": "problem", "what": "card", "error": "no number"} in messages
    assert messages[-1] == {"type": "done"}
    assert [message for message in messages if message["type"] == "line"]


@pytest.mark.parametrize(
    ("concept", "level", "numbers", "grade", "words"),
    [
        (
            "impact",
            0.2,
            {"impacts_a_period": 1.2, "gap": 1.0, "rule_gap": 0.7},
            "good",
            "1.2 times",
        ),
        ("impact", 0.2, {"impacts_a_period": 1.2, "gap": 1.0, "rule_gap": 1.0}, "good", "too much"),
        (
            "impact",
            0.7,
            {"impacts_a_period": 2.0, "gap": 1.0, "rule_gap": 2.0},
            "fair",
            "too strong",
        ),
        ("impact", 0.95, {"impacts_a_period": 0.0, "gap": 1.0, "rule_gap": 0.1}, "poor", "hardly"),
        ("impact", 0.95, {"impacts_a_period": 0.3, "gap": 1.0, "rule_gap": 0.3}, "poor", "wide"),
        ("friction", 0.6, {}, "fair", "friction limit"),
        ("tuned", 1.3, {}, "poor", "tunes"),
        ("none", 1.0, {}, "neutral", "alone"),
    ],
)
def test_the_verdict_has_a_grade_and_a_reason(
    concept: str, level: float, numbers: dict[str, float], grade: str, words: str
) -> None:
    verdict = judge_level(concept, level, 1.0, (0.9 * level, 1.1 * level), numbers)
    assert verdict.grade == grade
    assert words in verdict.sentence
    if concept != "none":
        assert verdict.headline == f"{100 * level:.0f} % of no absorber"
        assert verdict.band == f"90 % of runs between {90 * level:.0f} and {110 * level:.0f} %"


def test_advice_for_two_absorbers_is_better_than_the_rule(monkeypatch: pytest.MonkeyPatch) -> None:
    """The recommended gaps of two absorbers give a lower level than the design rule.

    The level is that of the API's performance curve. With the rule both absorbers have its gap.
    """
    monkeypatch.setattr("optimisation.explore.advice.GAP_STEPS", range(-1, 6, 2))
    values = parse_controls(VALUES | {"concept": "two", "members": 1}, BEAM)
    work = Work(values, BEAM, Kernels())
    reports = list[tuple[int, int]]()
    advised = recommend_values(
        values, BEAM, work.alone, work.stop, lambda done, total: reports.append((done, total))
    )
    assert reports[-1] == (8, 8)
    rule = work.rule(values.intensity)
    levels = [
        performance_curve(
            scene_of(replace_numbers(values, gaps), BEAM),
            [values.intensity],
            members=1,
            limits=work.limits,
            steady_start=True,
        ).median[0]
        for gaps in (advised.values, {"gap": rule, "second_gap": rule})
    ]
    assert levels[0] < 0.9 * levels[1]


def test_other_structures_have_their_own_controls(client: TestClient) -> None:
    table = client.get("/controls").json()
    assert list(table["structures"]) == ["own", "disk", "arm"]
    assert {example["structure"] for example in table["examples"]} <= set(table["structures"])
    arm = client.get("/controls?structure=arm").json()
    assert arm["key"] == "arm"
    assert client.get("/controls?structure=moon").status_code == 404
    with client.websocket_connect("/socket", headers=OWN) as session:
        session.send_text(json.dumps({"number": 1, "structure": "arm", "values": {}}))
        (taken,) = until(session, "taken", "refused")
    assert to_scene(taken["scene"]).model.beam_mass == pytest.approx(arm["beam_mass_kg"])


def test_a_disks_level_is_that_of_its_worst_sector_and_of_its_commands(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The level of a disk is that of its worst sector and that of the exported commands.

    It is compared with the runs of `optimisation.disks` and with the closed form without absorbers.
    """
    monkeypatch.setattr("optimisation.explore.disk_work.FORCES", 3)
    ring = ring_of_masses(4, coupling=0.02, frequency=100.0, damping_ratio=0.02)
    disk = BladedDisk(ring, engine_order=1, amplitude=20.0)
    values = parse_controls({"mistuning": 0.02, "mass_ratio": 0.03}, disk)
    work = make_work(values, disk, Kernels())
    messages = list(work.messages({}))
    assert json.loads(json.dumps(messages, allow_nan=False)) == messages
    assert messages[-1] == {"type": "done"}
    latest = {message["type"]: message for message in messages}
    assert "problem" not in latest
    own = disk_of(values, disk)
    up = disk_schedule(own, values.resonance)
    down = FrequencySchedule(up.times, up.omegas[::-1], up.reference)
    levels = [
        DiskRun(own, Drive(20.0, schedule), steady_start=True).simulate().levels.worst
        for schedule in (up, down)
    ]
    assert latest["card"]["level"] == pytest.approx(max(levels), rel=1e-9)
    ratio = np.array(latest["response"]["ratio"])
    response = linear_sector_response(own.ring, ratio * up.reference, 1)
    assert np.array(latest["response"]["without"]) == pytest.approx(
        20.0 * np.max(np.abs(response), axis=-1),
        rel=5e-4,  # ratios have six digits
    )
    motion = latest["motion"]
    assert motion["ring"]
    assert len(motion["shapes"]) == len(motion["gaps"]) == len(motion["absorbers"][0]) == 4
    monkeypatch.chdir(tmp_path)
    commands = commands_of(values, disk)
    results = run_commands(
        {"scene": scene_file(values, disk), "loads": {}, "commands": commands}, tmp_path
    )
    worst = [result["worst_level_m"][0] for result in results]
    assert max(worst) == pytest.approx(latest["card"]["level"], rel=1e-9)


@pytest.mark.parametrize("kind", ["unbalance", "base"])
def test_a_loads_linear_response_is_what_a_run_settles_to(kind: str) -> None:
    work = Work(
        parse_controls({"modes": 3, "members": 1, "concept": "none", "load": kind}, BEAM),
        BEAM,
        Kernels(),
    )
    response = next(message for message in work.messages({}) if message["type"] == "response")
    k = int(np.argmin(np.abs(np.array(response["ratio"]) - 0.98)))
    schedule = constant_frequency(work.model.resonance_omega(1), response["ratio"][k], 400.0)
    settled = simulate(
        work.scene,
        work.loading.act(work.intensity, schedule),
        record=Record(series=True, samples_per_period=256),
    ).history
    late = settled.tip_displacement[settled.time > 0.9 * settled.time[-1]]
    assert np.max(np.abs(late)) == pytest.approx(response["without"][k], rel=1e-3)


def test_a_random_forces_spectrum_has_its_mean_square() -> None:
    work = Work(
        parse_controls({"modes": 3, "members": 1, "concept": "none", "load": "random"}, BEAM),
        BEAM,
        Kernels(),
    )
    latest = {message["type"]: message for message in work.messages({})}  # the last of each
    hertz = np.array(latest["response"]["run"][0]) * work.model.resonance_omega(1) / (2 * np.pi)
    density = np.array(latest["response"]["run"][1])
    assert np.trapezoid(density**2, hertz) == pytest.approx(latest["sweep"]["level"] ** 2, rel=0.02)
    ratio, without = (np.array(latest["response"][name]) for name in ("ratio", "without"))
    mean = np.trapezoid(without**2, ratio * work.model.resonance_omega(1) / (2 * np.pi))
    assert mean == pytest.approx(latest["sweep"]["level"] ** 2, rel=0.3)  # over all records


def test_a_structure_from_a_file_has_its_own_controls() -> None:
    frame = load_structure(EXAMPLES / "frame.toml")
    assert "modes" in {c.name for c in controls(BEAM)} - {c.name for c in controls(frame)}
    for values, name in (({"load": "base"}, "load"), ({"modes": 3}, "")):
        with pytest.raises(RefusedValues) as refusal:
            parse_controls(values, frame)
        assert name in refusal.value.errors
    assert scene_of(parse_controls({}, frame), frame).model.modes == frame.modes


def test_a_measured_device_is_an_example() -> None:
    """With the medians of its posterior, and its other values; the intervals are in its words."""
    draws = np.column_stack([np.linspace(1e-3, 2e-3, 101), np.linspace(0.4, 0.6, 101)])
    device = {"mass_ratio": 0.03, "friction_limit": 0.25, "gap": 1.5e-3, "restitution": 0.5}
    posterior = Posterior(("gap", "restitution"), draws, True, device)
    example = make_measured_example(posterior, BEAM)
    assert example.values == {
        "mass_ratio": 0.03,
        "gap": 1.5e-3,
        "restitution": 0.5,
        "friction": 0.25,
    }
    assert "gap 1.5 (1.05 to 1.95) mm, restitution 0.5 (0.41 to 0.59)" in example.about
    app = make_app(BEAM, "the paper's beam", names_of("127.0.0.1"), examples=(example,))
    with TestClient(app, base_url=f"http://{HOST}") as own:
        assert own.get("/controls").json()["examples"][0]["title"] == "Your measured device"
    with pytest.raises(ParameterError, match="on this structure: Gap to either wall"):
        make_measured_example(Posterior(("gap",), np.full((60, 1), 1e3)), BEAM)
