"""Reports as pages. On a phone, in the dark, plots from near, by their contents."""

import re

import pytest
from browsing import browser  # noqa: F401 – a fixture

import truepose as tp
from truepose.calibration import review
from truepose.calibration.causes.hypothesis import Case
from truepose.commands import calibration_figures
from truepose.simulation.simulated_log import simulate_log

MOST = 1_500_000  #: bytes of a report


@pytest.fixture(scope="module")
def report(h4, tmp_path_factory):
    """Return the page of a calibration with many sensors."""
    robot = h4.with_sensors("theta", "z_telemeter", "elbow1", "elbow2")
    q_e = simulate_log(robot, robot.sample(1), poses=40).q_e
    log = tp.logs.of(robot, dict(zip(robot.readings, q_e.T, strict=True)))
    assessment = review.assess(Case(robot.expected(), log))
    path = tmp_path_factory.mktemp("report") / "report.html"
    text = calibration_figures.page(assessment, "log.csv", "student")
    path.write_text(text, encoding="utf-8")
    return path


def test_the_contents_list_every_section(report):
    page = report.read_text(encoding="utf-8")
    sections = dict(re.findall(r'<h2 id="([^"]+)">(.*?)</h2>', page))
    listed = dict(re.findall(r'<li><a href="#([^"]+)">(.*?)</a></li>', page))
    assert listed == sections and len(listed) >= 4
    assert page.count("<h2") == len(sections)


def test_a_report_is_one_file_and_no_large_one(report):
    page = report.read_text(encoding="utf-8")
    assert len(page.encode()) < MOST
    assert not re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', page)


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_a_browser_shows_it_narrow_and_in_the_dark(report, browser, width, scheme):  # noqa: F811
    seen, wrong = (
        browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme),
        [],
    )
    seen.on("pageerror", lambda error: wrong.append(str(error)))
    seen.goto(report.as_uri())
    assert seen.evaluate("document.scrollingElement.scrollWidth") <= width
    paper = seen.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (max(map(int, re.findall(r"\d+", paper)[:3])) < 100) == (scheme == "dark")
    names = seen.locator("td:first-child")
    assert names.first.evaluate("e => getComputedStyle(e).position") == "sticky"
    if width < 600:  # a table that is wider than the screen keeps its rows' names
        wide = seen.locator(".scroll").nth(2)
        wide.evaluate("e => e.scrollLeft = 200")
        name = wide.locator("td:first-child").first.bounding_box()
        assert name["x"] == pytest.approx(wide.bounding_box()["x"], abs=1)
    assert not wrong
    seen.close()


def test_a_browser_shows_a_figure_whole_and_zooms_it(report, browser):  # noqa: F811
    seen = browser.new_page(viewport={"width": 1280, "height": 800})
    seen.goto(report.as_uri())
    figure = seen.locator("figure").first
    image, frame = figure.locator("img"), figure.locator(".zoom").bounding_box()
    before = image.bounding_box()
    assert before["width"] == pytest.approx(frame["width"], abs=1)
    assert before["height"] == pytest.approx(frame["height"], abs=1)
    figure.get_by_role("button", name="nearer").click()
    wide = "document.querySelector('figure img').getBoundingClientRect().width"
    seen.wait_for_function(f"{wide} > {1.2 * before['width']}")
    figure.get_by_role("button", name="whole").click()
    seen.wait_for_function(f"Math.abs({wide} - {before['width']}) < 1")
    seen.close()
