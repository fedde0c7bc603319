"""Figures and pages: nothing the eye would see is lost, the same input gives the same bytes, all of it offline."""

from __future__ import annotations

import base64
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from elid_cli.errors import UsageError
from elid_cli.estimation.comparison import Estimate, SavedResult, compare
from elid_cli.estimation.identify import identify
from elid_cli.estimation.refined_robot import refined_robot, representative
from elid_cli.estimation.result import Identification
from elid_cli.estimation.sampling.sets import sample
from elid_cli.estimation.trend.trends import trend
from elid_cli.estimation.validation.prediction import validate
from elid_cli.experiment.excitation import ExciteOptions, excite
from elid_cli.experiment.replay import replay
from elid_cli.experiment.simulation import SimulationOptions, simulate
from elid_cli.model.base_parameters import find_base
from elid_cli.model.regressor import Regressor
from elid_cli.report import formats
from elid_cli.report.answers.identification import identification_report
from elid_cli.report.figures import figures_of, kinds, panels_of, picture
from elid_cli.report.figures.build import (
    comparison_figures,
    identification_figures,
    log_figures,
    replay_figures,
    sampling_figures,
    trend_figures,
    validation_figures,
    with_figures,
)
from elid_cli.report.figures.drawing import (
    CYCLE,
    PALETTE,
    Drawing,
    Line,
    Panel,
    Spans,
    Words,
    decades,
    tick_texts,
    ticks,
)
from elid_cli.report.figures.input import FigureInput
from elid_cli.report.figures.joint_views import joint_views, organised
from elid_cli.report.figures.paint import bands, cloud, envelope, thinned
from elid_cli.report.figures.plots import replayed
from elid_cli.report.figures.plots.spring import spring_views
from elid_cli.report.figures.svg import panels
from elid_cli.report.figures.timeline import packed
from elid_cli.report.tree import Figure, Report, cell_text
from elid_cli.robot.robot import Array, EffectSpec, Robot
from elid_cli.signals.recording import Recording, Segment
from elid_cli.signals.signals import prepare


@pytest.fixture(scope="module")
def refined(found: Identification) -> Robot:
    standard = representative(found.base, found.base.transform @ found.standard, found.robot.reference())
    return refined_robot(found.robot, standard, ())


@pytest.fixture(scope="module")
def report(found: Identification, refined: Robot, planar: Robot, noisy: Recording) -> Report:
    named = replace(noisy, files=("a & b <1>.csv",), sha256=("0",))
    figures = identification_figures(found, refined, prepare(noisy, planar))
    made = with_figures(identification_report(found, named, "planar2"), figures)
    return replace(made, invocation="elid identify 'a & b <1>.csv' --robot planar2")


@pytest.fixture(scope="module")
def page(report: Report) -> str:
    return formats.render(report, "html", formats.Style())


EFFECT = Figure("effect1", "an effect", "effect", {
    "effect": "hysteresis", "joint": "joint1", "rows": "motor", "unit": "N·m", "variable": "deflection (mrad)",
    "values": np.linspace(-1, 1, 300), "rising": np.arange(300) % 2 == 0, "without": np.linspace(-1, 1, 300) ** 3,
    "with_it": np.zeros(300), "error_without": 0.3, "error_with": 0.01,
})  # fmt: skip


RESPONSE = Figure("response_joint1", "a frequency response", "response", {
    "frequency": np.linspace(1, 40, 300), "elastic": np.linspace(0.1, 2, 300), "rigid": np.full(300, 0.2),
    "seen": np.array([3.0, 8.0]), "measured": np.array([0.2, 0.4]), "rigid_to": 3.0, "antiresonance": 10.0,
    "resonance": 14.0, "unit": "rad/s² per N·m",
})  # fmt: skip


def every_kind(report: Report, planar: Robot, found: Identification) -> dict[str, Figure]:
    trajectory = excite(planar, ExciteOptions(duration=8.0, rounds=1, starts=1))
    log = simulate(planar, SimulationOptions(duration=3.0, rate=250.0))
    results = [SavedResult(f, "planar2", {"K1": Estimate(v, 1.0, "N·m/rad")}, {"joint1": v / 1e6})
               for f, v in (("a.json", 3000.0), ("b.json", 3010.0))]  # fmt: skip
    third = replace(results[0], parameters={"K1": Estimate(3005.0, 1.0, "N·m/rad")})
    others = (*figures_of(FigureInput(excitation=trajectory)), *log_figures(log, planar),
              *comparison_figures(compare(results)),
              *trend_figures(trend([*results, third])), *sampling_figures(sample([found], 20)),
              *replay_figures(replay(planar, log)), EFFECT, RESPONSE)  # fmt: skip
    return {figure.kind: figure for figure in (*others, *report.figures)}


def test_every_kind_of_figure_is_drawn(report: Report, planar: Robot, found: Identification) -> None:
    figures = every_kind(report, planar, found)
    assert set(figures) == set(kinds())
    for figure in figures.values():
        assert b"</svg>" in picture(figure, "svg")
        assert picture(figure, "png").startswith(b"\x89PNG")


def test_the_same_figure_gives_the_same_bytes_and_no_date(report: Report) -> None:
    for key in ("classification", "coverage"):
        figure = next(f for f in report.figures if f.key == key)
        for suffix in ("svg", "png"):
            first = picture(figure, suffix)
            assert first == picture(figure, suffix)
            assert b"dc:date" not in first
    assert first.startswith(b"\x89PNG")


def test_a_residual_is_drawn_as_far_as_the_scale_of_what_was_used_reaches() -> None:
    t, used = np.linspace(0.0, 1.0, 5), np.array([True, True, False, False, True])
    parts = [{"name": "", "residual": np.array([1.0, -2.0, 9.0, 2.0, 1.0]), "before": None, "floor": None}]
    data = {"unit": "N·m", "t": t, "measured": t, "used": used, "residuals": parts}
    panel = panels_of(Figure("torque", "", "torque", data)).panels[1]
    (line,) = [mark for mark in panel.marks if isinstance(mark, Line)]
    assert panel.ylim == (-2.3, 2.3), "nothing that was used leaves the panel"
    assert np.isnan(line.y).tolist() == [False, False, True, False, False]


def test_a_log_is_drawn_with_its_gaps_and_with_what_was_interpolated(planar: Robot) -> None:
    log = simulate(planar, SimulationOptions(duration=1.0, rate=100.0))
    cut = (Segment(0, 40), Segment(40, log.t.size))
    t = np.concatenate([log.t[:40], log.t[40:] + 0.5])
    broken = replace(log, t=t, segments=cut, bridged=(("tau", 0, t[[10, 11, 60]]),))
    position, _, torque, _ = panels_of(log_figures(broken, planar)[0]).panels
    (gap,) = [mark for mark in position.marks if isinstance(mark, Spans)]
    assert gap.pairs == [(pytest.approx(t[39]), pytest.approx(t[40]))]
    (_, mended) = [mark for mark in torque.marks if isinstance(mark, Spans)]
    spans = [(0.095, 0.115), (t[60] - 0.005, t[60] + 0.005)]
    assert mended.pairs == [pytest.approx(span) for span in spans]
    assert all(np.isnan(mark.y[40]) for mark in position.marks if isinstance(mark, Line)), "no line leads across a gap"


def test_what_is_written_beside_the_longest_bar_has_room_and_the_unit_of_its_joint() -> None:
    cases = [("error", {"rail": 0.07, "elbow": 16.0}), ("error of the other robot", {"rail": 3.5, "elbow": 24.0})]
    units = {"rail": "mm", "elbow": "mrad"}
    data = {"cases": cases, "unit": "mrad or mm", "units": units}
    drawn = panels_of(Figure("errors", "", "errors", data))
    (panel,) = drawn.panels
    texts = [mark.texts for mark in panel.marks if isinstance(mark, Words)]
    assert [[text.strip() for text in some] for some in texts] == [["1: 0.07 mm", "1: 16 mrad"],
                                                                   ["2: 3.5 mm", "2: 24 mrad"]]  # fmt: skip
    (narrow,) = panels(drawn, "")
    width = float(re.search(r'viewBox="0 0 (\d+)', narrow).group(1))  # type: ignore[union-attr]
    place = float(re.search(r'<text x="([\d.]+)"[^>]*>\W*2: 24 mrad', narrow).group(1))  # type: ignore[union-attr]
    assert place + 6.1 * len("2: 24 mrad") < width


def test_no_line_of_a_replay_leads_from_one_stretch_to_the_next() -> None:
    t = np.concatenate([0.1 * np.arange(5), 2.0 + 0.1 * np.arange(5)])
    moved = np.ones((10, 1))
    robot = SimpleNamespace(joints=[SimpleNamespace(name="j", units=("rad",))])
    one = SimpleNamespace(t=t, measured=moved, simulated=1.1 * moved, robot=robot)
    (figure,) = replayed.figures(cast("FigureInput", SimpleNamespace(replays=(one, one), replay_labels=("a", "b"))))
    lines = [mark for panel in panels_of(figure).panels for mark in panel.marks if isinstance(mark, Line)]
    assert len(lines) == 4
    for line in lines:
        assert np.flatnonzero(np.isnan(line.y)).tolist() == [4]


def test_what_colour_alone_would_tell_is_told_otherwise_too() -> None:
    held_out = panels(Drawing([Panel([Spans([(0.2, 0.4)], "green", strip=True)], xlim=(0.0, 1.0))]), "")[0]
    assert held_out.count('fill="var(--green)"') == 2, "a strip below besides the shade"
    cases = [(name, {"joint1": 0.01}) for name in ("a.h5", "b.h5", "c.h5")]
    drawn = panels_of(Figure("errors", "", "errors", {"cases": cases}))
    assert [label for mark in drawn.legend() if (label := getattr(mark, "label", ""))] == [
        "1: a.h5",
        "2: b.h5",
        "3: c.h5",
    ]


def test_colours_differ_in_grey_or_in_dashes() -> None:
    def lightness(color: str) -> float:
        red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
        return 0.299 * red + 0.587 * green + 0.114 * blue

    assert abs(lightness(PALETTE["blue"]) - lightness(PALETTE["orange"])) > 20
    assert len({dash for _, dash in CYCLE}) == len(CYCLE)


def test_a_page_and_a_file_know_the_same_colours(page: str) -> None:
    for name in PALETTE:
        assert f"--{name}:" in page


def test_the_envelope_keeps_every_extreme_and_every_gap() -> None:
    generator = np.random.default_rng(0)
    values = generator.standard_normal(200_000)
    values[123_456], values[77] = 50.0, -60.0
    values[90_000:90_010] = np.nan
    t, thin = envelope(np.arange(200_000.0), values, 500)
    assert len(t) <= 1510
    assert np.nanmax(thin) == 50.0
    assert np.nanmin(thin) == -60.0
    assert np.isnan(thin).any()
    assert np.all(np.diff(t) > 0)
    for first in range(0, 200_000, 20_000):
        inside = (t >= first) & (t < first + 20_000)
        block = values[first : first + 20_000]
        assert np.nanmax(thin[inside]) == np.nanmax(block)


def test_a_short_line_is_drawn_as_it_is() -> None:
    t, values = np.arange(100.0), np.sin(np.arange(100.0))
    assert envelope(t, values)[1] is values


def test_a_cloud_keeps_one_point_of_every_occupied_cell() -> None:
    generator = np.random.default_rng(1)
    x, y = generator.standard_normal((2, 100_000))
    kept = cloud(x, y, (50, 50), 10_000)
    assert len(kept) < 2500
    assert len(cloud(x, y, (50, 50), 300)) == 300

    def cells(index: Array) -> set[tuple[int, int]]:
        places = [np.minimum((v[index] - v.min()) / np.ptp(v) * 50, 49).astype(int) for v in (x, y)]
        return set(zip(*(p.tolist() for p in places), strict=True))

    assert cells(kept) == cells(np.arange(100_000))


def test_bands_hold_the_mean_and_ninety_percent() -> None:
    generator = np.random.default_rng(2)
    x = generator.uniform(-1, 1, 50_000)
    centre, mean, low, high, extreme = bands(x, 3 * x + generator.standard_normal(50_000), 20)
    assert np.allclose(mean, 3 * centre, atol=0.15)
    assert np.allclose(high - low, 3.29, atol=0.4)
    assert np.all(extreme[0] <= low)


def test_the_residual_drawn_is_the_error_reported(refined: Robot, planar: Robot, noisy: Recording) -> None:
    signals = prepare(noisy, planar)
    judged = validate(refined, signals)
    for view in joint_views(judged, signals):
        rms = float(np.sqrt(np.mean(view.residual[view.used] ** 2)))
        assert rms == pytest.approx(judged.error[view.joint].rms, rel=1e-3)


def test_the_spring_curve_has_the_slope_of_the_spring(refined: Robot, planar: Robot, noisy: Recording) -> None:
    signals = prepare(noisy, planar)
    for view, K in zip(spring_views(validate(refined, signals), signals), (3000.0, 1800.0), strict=True):
        fine = np.isfinite(view.deflection)
        assert np.polyfit(view.deflection[fine], view.transmitted[fine], 1)[0] == pytest.approx(K, rel=0.05)


def test_hysteresis_shows_as_two_branches_and_the_model_follows_them(planar: Robot) -> None:
    effect = EffectSpec("hysteresis", "joint2", {"torque": 4.0, "distance": 0.001})
    robot = replace(planar, effects=(effect,))
    log = simulate(robot, SimulationOptions(duration=5.0, rate=250.0, seed=2))
    signals = prepare(log, robot)
    view = spring_views(validate(robot, signals), signals)[1]
    gap = view.transmitted - view.stiffness * view.deflection
    inside = np.isfinite(gap)
    branches = [float(np.mean(gap[inside & side])) for side in (view.rising, ~view.rising)]
    assert abs(branches[0] - branches[1]) > 1.0
    assert np.nanstd(view.transmitted - view.modelled) < 0.2 * np.nanstd(gap)


def test_what_follows_a_variable_is_told_from_what_does_not() -> None:
    generator = np.random.default_rng(3)
    x = generator.uniform(-1, 1, 5000)
    assert organised(np.sin(4 * x), x) > 0.9
    assert organised(generator.standard_normal(5000), x) < 0.05


class Checker(HTMLParser):
    """Collects identifiers and outside addresses, and checks that what opens closes."""

    VOID = ("meta", "img", "link", "br", "hr")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.outside: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in self.VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("src", "href", "xlink:href") and not (value or "").startswith(("#", "data:")):
                self.outside.append(value or "")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_is_well_formed_and_needs_nothing_from_outside(page: str) -> None:
    checker = Checker()
    checker.feed(page)
    assert checker.open == []
    assert checker.outside == []
    assert len(checker.ids) == len(set(checker.ids))
    assert "@import" not in page
    assert not re.search(r"url\((?!#)", page)


def test_every_reference_inside_the_page_has_its_target(page: str) -> None:
    checker = Checker()
    checker.feed(page)
    wanted = set(re.findall(r'href="#([^"]+)"', page)) | set(re.findall(r"url\(#([^)]+)\)", page))
    assert wanted <= set(checker.ids)


def test_names_are_escaped_and_the_command_is_whole(page: str) -> None:
    assert "a &amp; b &lt;1&gt;.csv" in page
    assert "<1>" not in page
    assert "--robot planar2" in page


def test_the_answers_come_first_and_every_figure_is_there(page: str, report: Report) -> None:
    assert page.index("class=answers") < page.index("class=lights") < page.index("<figure")
    assert page.index("Evidence") < page.index(">Parameters<") < page.index(">Everything else<")
    assert page.count("<figure") == len(report.figures) >= 8
    for row in report.section("base_parameters").rows:  # type: ignore[union-attr]
        assert cell_text(row[0]) in page


def test_the_same_report_gives_the_same_page(report: Report, page: str) -> None:
    assert formats.render(report, "html", formats.Style()) == page


def test_a_page_needs_no_plotting_library(report: Report, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert "<figure" in formats.render(report, "html", formats.Style())


def test_every_still_figure_is_small(report: Report, planar: Robot, found: Identification) -> None:
    for figure in every_kind(report, planar, found).values():
        assert len("".join(panels(panels_of(figure), figure.title))) <= 50_000, figure.key


def test_a_missing_plotting_library_names_the_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UsageError) as caught:
        formats.check_drawing(tmp_path / "figures")
    assert "elid[plots]" in caught.value.hint
    formats.check_drawing(tmp_path / "figures", "svg")


def test_packed_values_come_back_as_they_were() -> None:
    values = np.sin(np.linspace(0.0, 9.0, 500)) - 3.0
    values[40] = np.nan
    told = packed(values)
    whole = np.frombuffer(base64.b64decode(told["data"]), "<i2").astype(float)
    assert whole[40] == -32768
    back = told["low"] + (whole + 32767) * told["step"]
    assert np.nanmax(np.abs(np.delete(back - values, 40))) <= told["step"]


def test_thinned_lines_keep_the_extremes_of_each_and_the_gaps() -> None:
    generator = np.random.default_rng(5)
    one, other = generator.standard_normal((2, 60_000))
    one[1234], other[40_000], other[50_000] = 30.0, -40.0, np.nan
    kept = thinned([one, other], 4000)
    assert len(kept) <= 5000
    assert {1234, 40_000, 50_000} <= set(kept.tolist())
    assert np.array_equal(thinned([one[:100]], 4000), np.arange(100))


@pytest.mark.parametrize(("low", "high"), [(-3.2, 7.9), (0.0, 1e-3), (1e5, 1.2e5), (-0.004, 0.001)])
def test_ticks_are_round_inside_and_told_apart(low: float, high: float) -> None:
    found = ticks(low, high)
    assert 3 <= len(found) <= 8
    assert low <= found[0] < found[-1] <= high
    texts = tick_texts(found)
    assert len(set(texts)) == len(texts)
    assert [float(text) for text in texts] == pytest.approx(found)


def test_ticks_of_a_logarithmic_scale_are_few_and_never_one() -> None:
    assert decades(0.08, 0.7) == [0.1, 0.2, 0.5]
    assert decades(0.5, 2e4) == [1.0, 10.0, 100.0, 1000.0, 10000.0]
    assert len(decades(1e-17, 2.0)) <= 7


def test_a_folder_of_figures_holds_one_file_each(report: Report, tmp_path: Path) -> None:
    some = replace(report, sections=tuple(s for s in report.sections if s.key in ("classification", "singular")))
    formats.draw(some, tmp_path / "figures")
    assert sorted(p.name for p in (tmp_path / "figures").iterdir()) == ["classification.png", "singular.png"]


def test_a_rigid_robot_gets_its_figures_too(planar: Robot) -> None:
    rigid = replace(planar, joints=tuple(replace(joint, transmission="rigid") for joint in planar.joints))
    log = simulate(rigid, SimulationOptions(duration=6.0, rate=250.0, seed=1))
    signals = prepare(log, rigid)
    assert find_base(Regressor(rigid)).count
    figures = validation_figures(validate(rigid, signals), signals)
    assert "spring" not in {figure.kind for figure in figures}
    assert len(identify(rigid, signals).estimate)
    assert all(picture(figure, "png") for figure in figures[:1])


def test_a_mean_is_not_drawn_across_a_gap() -> None:
    x = np.concatenate([np.linspace(-1.0, -0.8, 500), np.linspace(0.8, 1.0, 500)])
    centre, mean, *_ = bands(x, x)
    assert np.isnan(mean).sum() == 1
    assert abs(centre[np.isnan(mean)][0]) < 0.1
