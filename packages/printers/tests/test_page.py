"""The page without installation, page/, in headless Chromium against Python.

Skipped where Chromium, clang-22 or its wasm libraries are not installed.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from browsing import browser  # noqa: F401 – a fixture
from compiling import for_wasm, told, wheels_eigen

import truepose as tp
from truepose.calibration import CalibrationOptions
from truepose_printers.library import answer
from truepose_printers.robot_json import to_json

PACKAGE = Path(__file__).parents[1]
PRINTERS = PACKAGE / "tests/data"
WITHIN = 1e-9
pytestmark = for_wasm


@pytest.fixture(scope="module")
def file() -> Path:
    """Return the page, as its target makes it."""
    eigen = wheels_eigen() / "include" / "eigen3"
    told("make", "-C", PACKAGE / "page", f"EIGEN={eigen}", f"PYTHON={sys.executable}")
    return PACKAGE.parents[1] / "build/page/truepose.html"


class Opened:
    """The page in a tab, with all that went wrong there."""

    def __init__(self, browser, file, **options):  # noqa: F811
        self.tab = browser.new_page(**options)
        self.wrong: list[str] = []
        self.tab.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.tab.on("console", lambda said: self.wrong.append(said.text))
        self.tab.on(
            "request", lambda of: of.url.startswith(("file:", "blob:")) or self.wrong.append(of.url)
        )
        self.tab.goto(file.as_uri())
        self.tab.evaluate("truepose.ready")

    def drop(self, name: str, text: str | bytes) -> str:
        """Hand a file to the page; return the text of its result."""
        cards = self.tab.locator("#results > article")
        before = cards.count()
        data = text if isinstance(text, bytes) else text.encode()
        self.tab.set_input_files("#file", {"name": name, "mimeType": "text/plain", "buffer": data})
        cards.nth(before).wait_for()
        return cards.first.inner_text()

    def width(self) -> int:
        """Return how wide the page is, pixels."""
        return self.tab.evaluate("document.documentElement.scrollWidth")


@pytest.fixture
def opened(browser, file):  # noqa: F811
    """Return the page, which must end without an error and without a request."""
    page = Opened(browser, file)
    yield page
    assert page.wrong == []
    page.tab.close()


def test_the_page_is_small_and_may_load_nothing(file):
    text = file.read_text(encoding="utf-8")
    assert len(text.encode()) < 1_500_000
    assert "default-src 'none'" in text and "innerHTML" not in text
    assert "Nothing leaves this computer" in text


@pytest.mark.parametrize("name", ["h4", "delta", "stewart", "neck"])
def test_a_robot_from_json_moves_and_settles_as_in_python(name, opened):
    robot = tp.load(name).at_highest_level
    opened.drop("robot.json", to_json(robot))
    box, rng = robot.spec.workspace, np.random.default_rng(3)
    poses = rng.uniform(box.minimum, box.maximum, (5, robot.n))
    poses = robot.home + 0.5 * (poses - robot.home)
    asked = opened.tab.evaluate(
        "poses => { const { start } = truepose.bench; return poses.map((x) => "
        "[start.ikm(x), start.readings(x), start.fkm(start.ikm(x), x)]); }",
        poses.tolist(),
    )
    q, q_e, x = (np.array(part) for part in zip(*asked, strict=True))
    np.testing.assert_allclose(q, robot.ikm(poses), rtol=0, atol=WITHIN)
    np.testing.assert_allclose(q_e, robot.extended_positions(poses), rtol=0, atol=WITHIN)
    np.testing.assert_allclose(x, poses, rtol=0, atol=WITHIN)


@pytest.mark.parametrize("law", ["joint", "tej", "estimated"])
def test_an_h4_with_a_short_rod_settles_as_in_python(law, opened):
    robot = tp.load("h4").with_file(conditions=None)  # of which the page knows nothing
    robot = robot.with_sensors("theta", "z_telemeter").at_highest_level
    true = robot.replace({"chain3.rod": robot.parameters["chain3.rod"].value - 0.003})
    desired = [0.05, 0.02, -0.41, 0.1]
    x = opened.tab.evaluate(
        "([x, law]) => truepose.bench.start.settle(truepose.bench.truth, x, law).x", [desired, law]
    )
    np.testing.assert_allclose(x, tp.steady_state(robot, true, desired, law), rtol=0, atol=WITHIN)


def test_the_page_calibrates_a_broken_h4_as_python_does(opened):
    opened.tab.get_by_role("button", name="Simulate a log and calibrate").click()
    rows, fit = opened.tab.evaluate("[truepose.bench.lastFit.rows, truepose.bench.lastFit.fit]")
    robot = tp.load("h4").with_sensors("theta", "z_telemeter")
    same = tp.calibrate(robot, np.array(rows), options=CalibrationOptions(cause="ignore"))
    assert fit["used"] == 40
    for found in fit["parameters"]:
        expected = same.parameters[found["name"]]
        assert abs(found["value"] - expected.value) < WITHIN, found
        assert abs(found["sigma"] - expected.sigma) < WITHIN, found
    np.testing.assert_allclose(fit["poses"], same.x, rtol=0, atol=WITHIN)
    assert "rms before" in opened.tab.locator("#robot").inner_text()


def test_a_log_and_a_robot_as_commands_write_them_are_calibrated_as_in_python(opened, tmp_path):
    for command in (
        ["simulate-log", "h4", "-o", "log.csv"],
        ["export", "json", "h4", "-o", "h4.json"],
    ):
        told(sys.executable, "-m", "truepose", *command, cwd=tmp_path)
    h4 = tp.load("h4")
    opened.drop("h4.json", (tmp_path / "h4.json").read_bytes())
    assert "rows used" in opened.drop("log.csv", (tmp_path / "log.csv").read_bytes())
    same = tp.calibrate(
        h4, tp.logs.read(h4, str(tmp_path / "log.csv")), options=CalibrationOptions(cause="ignore")
    )
    for found in opened.tab.evaluate("truepose.bench.lastFit.fit.parameters"):
        assert abs(found["value"] - same.parameters[found["name"]].value) < WITHIN, found


REAL = PRINTERS / "phnxdrgn536.cfg"
SESSION = """\
echo: M665 L345.000000 R162.500000 H418.500000 A0.0 B0.3 C-0.2 X0.1 Y-0.1 Z0.0
M666 X0.0 Y-0.2 Z-0.4
"""
SESSION += "".join(
    f"Recv: Bed X: {x:.3f} Y: {y:.3f} Z: {0.002 * x - 0.001 * y + 0.02 * np.sin(5 * k):.4f}\n"
    for k, x, y in ((k, 8 * k * np.cos(2 * k), 8 * k * np.sin(2 * k)) for k in range(13))
)


def log_of(text: str, lines: int) -> str:
    """Return klippy.log with a configuration, the saved part included, among lines with markup."""
    main, saved = text.split("#*# <", 1)
    kept = (line[4:] for line in saved.splitlines()[1:] if line.startswith("#*# "))
    told = "Stats 1.0: <img src=x onerror=alert(1)> heater_bed: target=60 temp=60.0 pwm=0.123\n"
    body = main + "\n".join(line for line in kept if "DO NOT EDIT" not in line)
    start = "Start printer at Thu Jan  8 03:18:32 2026\n===== Config file =====\n"
    return told * lines + start + body + "\n=======================\n" + told * lines


def real(name: str) -> str:
    """Return a real printer's file."""
    return (PRINTERS / f"{name}.cfg").read_text(encoding="utf-8")


TEXTS = {path.stem: real(path.stem) for path in sorted(PRINTERS.glob("*.cfg"))} | {
    "session of Marlin": SESSION,
    "session of G33": (PRINTERS / "marlin-session.txt").read_text(encoding="utf-8"),
    "klippy.log": log_of(real("phnxdrgn536"), 100),
    "with includes": "[include macros.cfg]\n" + real("phnxdrgn536"),
    "truncated": real("phnxdrgn536")[:900],
}


def require_same(one, other, place=""):
    """Compare two JSON values, numbers in mm and degrees to 1e-9 m."""
    if isinstance(one, dict):
        assert one.keys() == other.keys(), place
        for key, value in one.items():
            require_same(value, other[key], f"{place}.{key}")
    elif isinstance(one, list):
        assert len(one) == len(other), place
        for k, value in enumerate(one):
            require_same(value, other[k], f"{place}[{k}]")
    elif isinstance(one, int | float):
        assert one == pytest.approx(other, rel=WITHIN, abs=1e3 * WITHIN), place
    else:
        assert one == other, place


@pytest.mark.parametrize("name", TEXTS)
def test_a_printers_answer_has_all_numbers_of_python(name, opened):
    text = TEXTS[name]
    found = opened.tab.evaluate("text => truepose.printerAnswer(text, [0, 0, 5])", text)
    require_same(found, answer(text, [0, 0, 5]))


def test_a_log_of_ten_megabytes_is_read_and_its_markup_stays_text(opened):
    text = log_of(real("phnxdrgn536"), 65_000)
    assert len(text) > 1e7
    assert "endstop_a" in opened.drop("klippy.log", text)
    assert opened.tab.locator("#results img").count() == 0


def test_several_files_at_once_have_a_result_each(opened):
    names = ("danorder-v400", "fzechert")
    opened.tab.set_input_files("#file", [PRINTERS / f"{name}.cfg" for name in names])
    cards = opened.tab.locator("#results > article")
    cards.nth(1).wait_for()
    assert [card.split("\n")[0] for card in cards.all_inner_texts()] == [
        f"{name}.cfg" for name in reversed(names)
    ]
    hidden = [card.count("not recommended") for card in cards.all_inner_texts()]
    assert hidden == [1, 0]  # to keep the file's parameters is the decision on fzechert.cfg


def test_a_file_may_be_dropped_anywhere(opened):
    opened.tab.evaluate(
        "text => { const dataTransfer = new DataTransfer(), bubbles = true, cancelable = true; "
        "dataTransfer.items.add(new File([text], 'mine.cfg')); "
        "const drop = new DragEvent('drop', { dataTransfer, bubbles, cancelable }); "
        "document.body.dispatchEvent(drop); }",
        real("fzechert"),
    )
    opened.tab.get_by_role("article", name="mine.cfg").get_by_text("endstop_a").wait_for()


def test_the_new_configuration_is_saved_as_a_file(opened):
    used = real("danorder-v400")  # the estimate is a way there
    opened.drop("printer.cfg", used)
    with opened.tab.expect_download() as saved:
        opened.tab.get_by_text("Save the new printer.cfg").click()
    assert saved.value.suggested_filename == "printer-new.cfg"
    text = Path(saved.value.path()).read_text(encoding="utf-8")
    assert text == answer(used, [0, 0, 5])["config"]


BAD = {
    "empty": ("", "is empty"),
    "binary": (b"PK\x03\x04\x00\x00", "not a text file"),
    "truncated JSON": ('{"format": "written by truepose', "truncated"),
    "JSON of something else": ('{"a": 1}', "truepose export json"),
    "no printer": ("The quick brown fox\njumps\n", ""),
    "truncated configuration": (REAL.read_bytes()[:900], ""),
    "markup": ("[printer]\nkinematics: <img src=x onerror=alert(1)>\n", "<img src=x"),
    "log with an unknown column": ("q1,q2\n1,2\n", "no column q3"),
    "log with words": (
        "q1,q2,q3,q4,theta,z_telemeter\n0.4,0.4,0.4,0.4,<b>0</b>,0.4\n",
        "is no number",
    ),
    "log in degrees and mm": (
        "q1,q2,q3,q4,theta,z_telemeter\n" + "23.6,23.6,23.6,23.6,0,400\n" * 3,
        "are the readings in m and rad",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_answered_by_one_sentence_and_nothing_is_lost(case, opened):
    text, said = BAD[case]
    first = opened.drop("good.cfg", REAL.read_bytes())
    shown = opened.drop("bad.txt", text).replace("Remove", "").split("\n", 1)[1].strip()
    assert shown.startswith("bad.txt: ") and said in shown and "\n" not in shown
    assert opened.tab.locator("#results > article").nth(1).inner_text() == first
    assert opened.tab.locator("#results img, #results b").count() == 0
    opened.tab.get_by_role("button", name="Simulate a log and calibrate").click()
    assert "rms before" in opened.tab.locator("#robot").inner_text()


def test_everything_works_by_the_keyboard(opened):
    tab = opened.tab
    tab.get_by_label("x", exact=True).focus()
    tab.keyboard.press("ArrowRight")
    assert tab.evaluate("truepose.bench.desired[0]") == pytest.approx(0.001)
    tab.get_by_role("button", name="Simulate a log and calibrate").focus()
    tab.keyboard.press("Enter")
    assert "rms before" in tab.locator("#robot").inner_text()
    tab.get_by_text("Paste text instead").focus()
    tab.keyboard.press("Enter")
    tab.keyboard.press("Tab")
    tab.keyboard.insert_text(REAL.read_text(encoding="utf-8"))
    tab.keyboard.press("Tab")
    tab.keyboard.press("Enter")
    tab.locator("#results > article").first.wait_for()
    assert "endstop_a" in tab.locator("#results").inner_text()


def test_dragging_the_platform_moves_it_and_dragging_elsewhere_turns_the_view(opened):
    tab = opened.tab
    for at, moved in (("polygon.platform", True), (".view", False)):
        tab.locator(at).scroll_into_view_if_needed()
        box = tab.locator(at).bounding_box()
        begin = (box["x"] + (0.5 if moved else 0.05) * box["width"],
                 box["y"] + (0.5 if moved else 0.95) * box["height"])  # fmt: skip
        before = tab.evaluate("[[...truepose.bench.desired], truepose.bench.view.azimuth]")
        tab.mouse.move(*begin)
        tab.mouse.down()
        tab.mouse.move(begin[0] + 20, begin[1] - 10, steps=3)
        tab.mouse.up()
        after = tab.evaluate("[[...truepose.bench.desired], truepose.bench.view.azimuth]")
        assert (after[0] != before[0]) == moved and (after[1] != before[1]) != moved


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_phone_shows_all_of_it_without_scrolling_sideways(scheme, browser, file):  # noqa: F811
    phone = Opened(browser, file, viewport={"width": 390, "height": 844}, color_scheme=scheme)
    phone.drop("printer.cfg", REAL.read_bytes())
    phone.tab.get_by_role("button", name="Simulate a log and calibrate").click()
    assert phone.width() == 390
    shades = "(({ backgroundColor: b, color: c }) => [b, c])(getComputedStyle(document.body))"
    back, front = phone.tab.evaluate(shades)
    dark = [sum(map(int, shade[4:-1].split(","))) < 384 for shade in (back, front)]
    assert dark == [scheme == "dark", scheme == "light"]
    assert phone.wrong == []
    phone.tab.close()
