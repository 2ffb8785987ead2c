"""The explorer's page works in a real browser without network.

The tests cover drawing, sliders, refused values and saved files.
"""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from places import ROOT

pytest.importorskip("starlette")
playwright = pytest.importorskip(
    "playwright.sync_api", reason="no Playwright here: the explorer's page is not looked at"
)

from impact_env import performance_curve
from impact_env.plain import to_scene
from optimisation.sweep_range import find_sweep_range

BROWSER = next(
    (
        path
        for name in ("chromium", "chromium-browser", "google-chrome")
        if (path := shutil.which(name))
    ),
    None,
)
pytestmark = pytest.mark.skipif(
    BROWSER is None, reason="no Chromium here: the explorer's page is not looked at"
)
FAST = "#modes=1&friction=0.1&members=1"
TWO_MEMBERS = FAST.replace("members=1", "members=2")
WAIT = 120_000  # ms, for kernels that are compiled on the way
WATCH = """
window.order = {};
new MutationObserver(() => {
  for (const [name, value] of Object.entries(document.documentElement.dataset)) {
    const all = name.startsWith("shown") ? (window.order[name] ??= []) : [Number(value)];
    if (all.at(-1) !== Number(value)) all.push(Number(value));
  }
}).observe(document, { attributes: true, subtree: true });
"""


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    code = "from optimisation.cli.start import main; main()"
    words = [sys.executable, "-c", code, "explore", "--port", "0", "--no-browser"]
    with subprocess.Popen(
        words, env=os.environ | {"PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE, text=True
    ) as process:
        yield process.stdout.readline().split()[0]
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as player:
        browser = player.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def page(browser: Any, address: str, request: pytest.FixtureRequest) -> Iterator[Any]:
    """Yield a page that reaches only the server, and check that no error occurs in it.

    The fixture's parameter is the setting.
    """
    wrong: list[str] = []
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.add_init_script(WATCH)
    page.route(
        "**/*",
        lambda route: (
            route.continue_()
            if route.request.url.startswith(address)
            else wrong.append(route.request.url) or route.abort()
        ),
    )
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on(
        "console", lambda message: wrong.append(message.text) if message.type == "error" else None
    )
    page.goto(address + getattr(request, "param", FAST))
    yield page
    assert wrong == []
    page.close()


def finished(page: Any, number: int | None = None) -> int:
    """Wait until a setting's numbers and its curve of all members are drawn.

    By default it is the newest setting. Return its number.
    """
    page.wait_for_selector("html[data-asked]", state="attached", timeout=WAIT)
    end = time.monotonic() + WAIT / 1000
    while True:
        condition = (
            int(page.evaluate("document.documentElement.dataset.asked"))
            if number is None
            else number
        )
        if page.locator(f'html[data-showncard="{condition}"][data-whole="{condition}"]').count():
            break
        assert time.monotonic() < end, page.evaluate(
            "[document.querySelector('#status').textContent, {...document.documentElement.dataset}]"
        )
        page.wait_for_timeout(100)
    return condition


def saved(page: Any, label: str, kind: str) -> Path:
    with page.expect_download() as download:
        page.get_by_label(label).select_option(kind)
    return Path(download.value.path())


@pytest.mark.same_bits
@pytest.mark.parametrize("page", [TWO_MEMBERS], indirect=True)
def test_numbers_are_those_of_the_library_and_files_are_whole(page: Any) -> None:
    finished(page)
    rows = list(csv.reader(saved(page, "Save the curve as", "CSV").read_text().splitlines()))
    drawn = {
        float(force): float(level) for name, force, level in rows[1:] if name == "impact absorber"
    }
    page.get_by_text("Save", exact=True).first.click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Scene file").click()
    scene = to_scene(json.loads(Path(download.value.path()).read_text()))
    forces = sorted(drawn)
    settings = {"limits": find_sweep_range(scene.model, 0.02), "steady_start": True}
    wanted = performance_curve(scene, forces, members=2, **settings)
    assert [drawn[force] for force in forces] == pytest.approx(
        (1e3 * wanted.median).tolist(), rel=1e-15
    )
    assert len(drawn) == 24
    assert saved(page, "Save the sweep as", "PNG").read_bytes().startswith(b"\x89PNG")
    with page.expect_download() as download:
        page.get_by_role("button", name="Card as HTML").click()
    level, without = (
        performance_curve(one, [3.5], members=members, **settings).median[0]
        for one, members in ((scene, 2), (replace(scene, absorber=None), 1))
    )
    assert f"{1e3 * level:.4g} mm" in Path(download.value.path()).read_text()
    assert page.locator("#headline").inner_text() == f"{100 * level / without:.0f} % of no absorber"
    page.locator("#card summary").click()
    assert page.locator("[data-number=level]").inner_text() == f"{1e3 * level:.4g} mm"


def test_settings_move_are_undone_and_refused_in_words(page: Any) -> None:
    """Settings change, are undone, and wrong values are refused with a message.

    The gap is set by arrow keys, by a page key, and by text with a comma and with a unit. Back is
    tested as well.
    """
    finished(page)
    before = saved(page, "Save the curve as", "CSV").read_text()
    gap = page.locator("#n-gap")
    slider = page.get_by_label("Gap to either wall, mm")
    slider.focus()
    for _ in range(12):
        page.keyboard.press("ArrowRight")
        time.sleep(0.02)
    finished(page)
    assert saved(page, "Save the curve as", "CSV").read_text() != before
    order = page.evaluate("window.order")
    assert all(numbers == sorted(numbers) for numbers in order.values())
    assert order["showncurve"][-1] == int(page.evaluate("document.documentElement.dataset.asked"))
    moved = gap.input_value()
    page.wait_for_timeout(1600)  # later changes are a step of their own
    for _ in range(3):
        page.keyboard.press("PageUp")
    assert 1.3 < float(gap.input_value()) / float(moved) < 2
    page.get_by_role("button", name="Undo").click()
    playwright.expect(gap).to_have_value(moved)
    page.go_forward()
    playwright.expect(gap).not_to_have_value(moved)
    for text, value in (("1,5", "1.5"), ("0.05 in", "1.27")):
        gap.fill(text)
        gap.press("Enter")
        assert gap.input_value() == value
    address = page.url
    for text, words in (
        ("900", "= 900 mm is not allowed: 0.02 to 50 mm"),
        ("abc", "is no number; an example: 1 mm"),
    ):
        gap.fill(text)
        gap.press("Enter")
        playwright.expect(page.locator("#e-gap")).to_contain_text(words)
        assert page.get_by_role("alert").first.is_visible()
        assert gap.get_attribute("aria-invalid") == "true"
        assert text not in page.url
    page.goto(address)
    page.reload()
    finished(page)
    assert (gap.input_value(), page.locator("#e-gap").inner_text()) == ("1.27", "")
    page.goto("about:blank")
    page.goto(address.replace("gap=", "gap=x"))
    page.wait_for_selector("#problem:not([hidden])")
    assert "no number" in page.locator("#problem").inner_text()


def test_two_tabs_have_their_own_settings_and_advice_says_what_it_changes(
    page: Any, browser: Any, address: str
) -> None:
    other = browser.new_page()
    other.goto(address + FAST)
    other.select_option("#concept", "tuned")
    for tab, concept in ((page, "impact"), (other, "tuned")):
        finished(tab)
        assert f"{concept} absorber" in tab.locator("#card .note").inner_text()
    other.close()
    page.locator("#n-force").fill("2")
    page.locator("#n-force").press("Enter")
    finished(page)
    page.get_by_role("button", name="Recommended").click()
    page.wait_for_selector("#why:not(:empty)", timeout=WAIT)
    words = page.locator("#why").inner_text()
    assert "design rule" in words
    gap, friction = (
        float(page.locator(f"#n-{name}").input_value()) for name in ("gap", "friction")
    )
    assert gap != 1
    assert f"Gap to either wall 1 → {gap:.4g} mm; Friction limit 0.1 → {friction:.4g} N" in words


SIZES = ((1280, 800, "light"), (1920, 1080, "dark"), (800, 900, "light"), (390, 844, "dark"))
ZOOMED = (640, 400, "light")  # 1280 pixels at 200 %
NAMELESS = """[...document.querySelectorAll('input, select, button, canvas, progress')].filter(
  (e) => !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length)
    && e.closest('.plot') === null).map((e) => e.outerHTML)"""
OUTSIDE = """[...document.querySelectorAll('.panel:not(#card)')].filter((p) => [...p.querySelectorAll('.uplot, dl, canvas, .legend, .bar *')]
  .some((e) => e.offsetParent && (e.getBoundingClientRect().bottom > p.getBoundingClientRect().bottom + 1
    || e.getBoundingClientRect().right > p.getBoundingClientRect().right + 1))).map((p) => p.id)"""


def test_it_fits_at_all_sizes_and_a_pinned_curve_stays(page: Any) -> None:
    """The page fits at five sizes, and a pinned curve stays visible.

    Nothing is cut off, also with a second curve and with the values at the pointer in the legend.
    """
    finished(page)
    page.get_by_role("button", name="Pin this curve").click()
    force = page.locator("#n-force")
    force.fill("100")
    force.press("Enter")
    finished(page)
    assert "Force 3.5 → 100 N" in page.locator("#comparison").inner_text()
    rows = saved(page, "Save the curve as", "CSV").read_text().splitlines()
    assert sum(row.startswith("pinned,") for row in rows) == 24
    for width, height, colours in (*SIZES, ZOOMED):
        page.set_viewport_size({"width": width, "height": height})
        page.emulate_media(color_scheme=colours)
        page.wait_for_timeout(200)
        page.locator("#curve .u-over").hover()
        size = page.evaluate(
            "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
        )
        assert size[0] <= width
        assert size[1] <= height or width <= 900
        assert page.evaluate(OUTSIDE) == []
        legend = page.locator("#curve .entry").all_inner_texts()
        assert re.fullmatch(r"impact absorber [\d.]+", legend[1]), legend
        assert page.locator("#status").bounding_box()["width"] > 100
        dark = int(re.findall(r"\d+", page.evaluate(BACKGROUND))[0]) < 128
        assert dark == (colours == "dark")
    assert page.evaluate(NAMELESS) == []
    page.get_by_role("button", name="Controls").focus()
    page.keyboard.press("Enter")
    for part in ("#curve .plot", "#controls"):
        assert page.locator(part).bounding_box()["height"] > 60
        assert page.locator(part).is_visible()
    page.keyboard.press("Escape")
    assert page.locator("#controls").is_hidden()


BACKGROUND = "getComputedStyle(document.body).backgroundColor"
