"""The page of a diagnosis in a real browser: nothing in its console, no request, plots that zoom together."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from elid_cli.cli import main
from tests.system.browser.chromium import Browser, browser

pytestmark = pytest.mark.skipif(browser() is None, reason="no chromium on this machine")
LOG = str(Path(__file__).parents[3] / "sample_logs" / "planar2_stribeck.h5")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the page of a diagnosis that tries few effects."""
    path = tmp_path_factory.mktemp("page") / "page.html"
    line = ["diagnose", LOG, "--robot", "planar2", "--only", "stribeck", "--quiet", "--report", str(path)]
    assert main(line) == 0
    return path


@pytest.fixture(scope="module")
def seen(page: Path) -> Iterator[Browser]:
    with Browser() as running:
        yield running


@pytest.mark.parametrize(("width", "dark"), [(1280, False), (1280, True), (400, False)])
def test_the_console_is_empty_and_nothing_is_fetched(seen: Browser, page: Path, width: int, dark: bool) -> None:
    seen.open(page, width, dark=dark)
    assert seen.run("document.querySelectorAll('.plot canvas').length") >= 2
    assert seen.said == []
    assert seen.requested == []


def test_a_drag_zooms_every_plot_and_a_button_shows_the_whole_log(seen: Browser, page: Path) -> None:
    seen.open(page)
    seen.run("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert seen.run("document.querySelectorAll('.plot canvas').length") >= 6
    seen.run("document.querySelector('.u-over').scrollIntoView({block: 'center'})")
    left, top, width, height = seen.run(
        "(b => [b.left, b.top, b.width, b.height])(document.querySelector('.u-over').getBoundingClientRect())"
    )
    seen.drag(left + 0.25 * width, left + 0.5 * width, top + 0.5 * height)
    first, last = map(float, seen.run("document.documentElement.dataset.range").split())
    assert 2.0 < first < 4.0 < last < 8.0
    seen.run("document.querySelector('[data-do=all]').click()")
    first, last = map(float, seen.run("document.documentElement.dataset.range").split())
    assert first < 0.5
    assert last > 11.0
    assert seen.said == []


def test_a_keyboard_can_zoom_and_hide_the_residual_before(seen: Browser, page: Path) -> None:
    seen.open(page)
    seen.run("document.querySelector('[data-do=in]').focus()")
    assert seen.run("document.activeElement.dataset.do") == "in"
    seen.run("document.activeElement.click()")
    first, last = map(float, seen.run("document.documentElement.dataset.range").split())
    assert last - first < 7.0
    rows = "[...document.querySelectorAll('.u-series')]"
    shown = f"{rows}.filter(r => /before/.test(r.textContent) && !r.matches('.u-off')).length"
    before = seen.run(shown)
    assert before > 0
    seen.run("document.querySelector('[data-do=before]').click()")
    assert seen.run(shown) == 0


def test_a_telephone_cuts_nothing(seen: Browser, page: Path) -> None:
    seen.open(page, 400)
    seen.run("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert seen.run("document.documentElement.scrollWidth") <= 400
    cut = "[...document.querySelectorAll('.scroll')].filter(s => s.scrollWidth > s.clientWidth + 1).length"
    assert seen.run(cut) == 0


def test_a_screen_reader_finds_headings_heads_and_pictures_named(seen: Browser, page: Path) -> None:
    seen.open(page)
    assert seen.run("document.querySelectorAll('h1').length") == 1
    levels = seen.run("[...document.querySelectorAll('h1,h2,h3')].map(h => +h.tagName[1])")
    assert all(b <= a + 1 for a, b in pairwise(levels))
    assert seen.run("[...document.querySelectorAll('main th')].every(h => h.scope || h.closest('.uplot'))")
    assert seen.run("[...document.querySelectorAll('svg.panel')].every(s => s.getAttribute('aria-label'))")
    assert seen.run("[...document.querySelectorAll('table:not(.u-legend)')].every(t => t.getAttribute('aria-label'))")


def test_dark_reaches_the_figures(seen: Browser, page: Path) -> None:
    ground = "getComputedStyle(document.querySelector('.paper')).backgroundColor"
    seen.open(page)
    light = seen.run(ground)
    seen.open(page, dark=True)
    assert seen.run(ground) != light
    line = "getComputedStyle(document.querySelector('svg.panel path[stroke*=line]')).stroke"
    assert seen.run(line) not in ("", "none", "rgb(226, 226, 224)")


def test_it_prints_on_few_pages(seen: Browser, page: Path) -> None:
    seen.open(page)
    printed = seen.printed()
    assert printed.startswith(b"%PDF")
    assert 1 <= printed.count(b"/Type /Page\n") + printed.count(b"/Type /Page ") <= 10
