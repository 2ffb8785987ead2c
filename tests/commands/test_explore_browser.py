"""The explorer's page in a real browser, with the network off: what is drawn, what a slider does, what is refused, what is saved."""

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
FAST = "#modes=3&friction=0.1&members=2"
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
    """A page that reaches nothing but the server, in which nothing goes wrong; its parameter: width, height and colours."""
    wrong: list[str] = []
    width, height, colours = getattr(request, "param", (1280, 800, "light"))
    page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=colours)
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
    page.goto(address + FAST)
    yield page
    assert wrong == []
    page.close()


def finished(page: Any, number: int | None = None) -> int:
    """Wait until a setting's numbers and its curve of all members are drawn, by default the newest's, and return its number."""
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
    wanted = performance_curve(scene, forces, members=2)
    assert [drawn[force] for force in forces] == pytest.approx(
        (1e3 * wanted.median).tolist(), rel=1e-15
    )
    assert len(drawn) == 24
    assert saved(page, "Save the sweep as", "PNG").read_bytes().startswith(b"\x89PNG")
    with page.expect_download() as download:
        page.get_by_role("button", name="Card as HTML").click()
    assert (
        f"{1e3 * performance_curve(scene, [3.5], members=2).median[0]:.4g} mm"
        in Path(download.value.path()).read_text()
    )


def test_a_slider_moves_the_curve_without_remnants_and_a_bad_value_is_reported(page: Any) -> None:
    finished(page)
    before = saved(page, "Save the curve as", "CSV").read_text()
    slider = page.get_by_label("Gap to either wall, mm")
    slider.focus()
    for _ in range(30):
        page.keyboard.press("ArrowRight")
        time.sleep(0.02)
    finished(page)
    assert saved(page, "Save the curve as", "CSV").read_text() != before
    order = page.evaluate("window.order")
    assert all(numbers == sorted(numbers) for numbers in order.values())
    assert order["showncurve"][-1] == int(page.evaluate("document.documentElement.dataset.asked"))
    assert "gap=" in page.url
    page.reload()
    finished(page)
    assert float(page.locator("#n-gap").input_value()) > 1
    gap = page.locator("#n-gap")
    gap.fill("-1")
    gap.press("Enter")
    page.wait_for_selector("#e-gap:not(:empty)")
    assert "0.02 to 50 mm" in page.locator("#e-gap").inner_text()
    assert gap.get_attribute("aria-invalid") == "true"
    gap.fill("1.2")
    gap.press("Enter")
    finished(page)
    assert page.locator("#e-gap").inner_text() == ""


def test_two_tabs_have_their_own_settings_and_advice_sets_the_controls(
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
    assert "design rule" in page.locator("#why").inner_text()
    assert float(page.locator("#n-gap").input_value()) != 1


@pytest.mark.parametrize("page", [(1280, 800, "light"), (1920, 1080, "dark")], indirect=True)
def test_it_fits_and_everything_has_a_name(page: Any) -> None:
    finished(page)
    size = page.evaluate(
        "[document.documentElement.scrollWidth, document.documentElement.scrollHeight]"
    )
    width, height = page.viewport_size.values()
    assert size[0] <= width
    assert size[1] <= height
    nameless = """[...document.querySelectorAll('input, select, button, canvas, progress')].filter(
      (e) => !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length)
        && e.closest('.plot') === null).map((e) => e.outerHTML)"""
    assert page.evaluate(nameless) == []
    outside = """[...document.querySelectorAll('.panel')].filter((p) => [...p.querySelectorAll('.uplot, dl, canvas')].some(
      (e) => e.getBoundingClientRect().bottom > p.getBoundingClientRect().bottom + 1)).map((p) => p.id)"""
    assert page.evaluate(outside) == []
    dark = (
        int(re.findall(r"\d+", page.evaluate("getComputedStyle(document.body).backgroundColor"))[0])
        < 128
    )
    assert dark == (width == 1920)
