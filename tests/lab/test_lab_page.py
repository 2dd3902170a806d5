"""The lab in a browser: what it shows is what MuJoCo computed, for everybody, without a network."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from commands import ROOT
from headless_browser import emulate, requested, resize, violations

from mjbench.errors import MachineError

STEPS = 200
BUTTONS = ("play", "step", "end", "restart", "grow", "measure", "theme")
# What the lab holds, for a look from the console: the lists, read now.
READ = """
const { recording } = lab.fall;
return { live: recording.live, viewed: recording.viewed, copied: recording.copied };
"""
# The points of a trace that is drawn, as rows of x and y in CSS pixels.
DRAWN = """
const line = document.querySelector(`#${arguments[0]} polyline.${arguments[1]}`);
return line.getAttribute("points").split(" ").map((pair) => pair.split(",").map(Number));
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("jinja2")
    from benchmarks.studies import lab

    try:
        package = lab.find_package(lab.INSTALLED)
    except MachineError as error:
        pytest.skip(str(error))
    path = tmp_path_factory.mktemp("lab") / "mujoco-lab.html"
    path.write_text(lab.render(package))
    return path


@pytest.fixture
def open_page(browser: Any, page: Path) -> Callable[..., Any]:
    """Return what opens the page, still unless asked for another, and waits for MuJoCo."""
    from selenium.webdriver.support.wait import WebDriverWait

    def open_page(*, ready: str = "window.lab", **media: str) -> Any:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        emulate(browser, **{"prefers_reduced_motion": "reduce", **media})
        browser.get_log("browser")
        browser.get_log("performance")
        browser.get(page.as_uri())
        WebDriverWait(browser, 60).until(lambda b: b.execute_script(f"return !!({ready})"))
        return browser

    return open_page


@pytest.fixture
def opened(open_page: Callable[..., Any]) -> Any:
    return open_page()


def click(browser: Any, *names: str) -> None:
    for name in names:
        browser.find_element("id", name).click()


def text(browser: Any, name: str) -> str:
    return str(browser.find_element("id", name).text)


def press(browser: Any, keys: str) -> None:
    browser.find_element("tag name", "body").send_keys(keys)


def measure(browser: Any) -> None:
    """Measure, and wait for the end: the button changes only when the user's file is read."""
    from selenium.webdriver.support.wait import WebDriverWait

    click(browser, "measure")
    WebDriverWait(browser, 120).until(
        lambda b: text(b, "conditions") and text(b, "measure") == "Measure"
    )


def test_it_opens_from_a_file_without_errors_and_asks_the_network_for_nothing(opened: Any) -> None:
    click(opened, "end", "grow", "ball")
    assert opened.get_log("browser") == []
    assert text(opened, "failure") == ""
    urls = requested(opened)
    assert urls
    assert all(url.startswith(("file:", "data:", "blob:")) for url in urls)


def test_every_view_shows_the_live_value_at_all_times_and_the_copies_keep_theirs(
    opened: Any,
) -> None:
    copies: list[float] = []
    for step in range(1, STEPS + 1):
        opened.execute_script("lab.fall.advance(1)")
        lists = opened.execute_script(READ)
        assert lists["viewed"] == [lists["live"]] * step
        assert lists["copied"] == [*copies, lists["live"]]
        copies = lists["copied"]
    assert np.ptp(copies) == pytest.approx(0.2269, abs=5e-5)


def test_the_copies_are_the_values_that_python_records(opened: Any) -> None:
    click(opened, "end")
    model = mujoco.MjModel.from_xml_path(str(ROOT / "models/cartpole.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    expected = []
    for _ in range(STEPS):
        mujoco.mj_step(model, data)
        expected.append(data.site("pole_tip").xpos[0])
    copied = opened.execute_script(READ)["copied"]
    assert copied == pytest.approx(expected, abs=1e-9)


def test_the_drawn_traces_are_those_of_the_lists(opened: Any) -> None:
    opened.execute_script("lab.fall.advance(150)")
    lists = opened.execute_script(READ)
    views, copies = (
        np.array(opened.execute_script(DRAWN, "lists", n)) for n in ("views", "copies")
    )
    readings = np.array(opened.execute_script(DRAWN, "readings", "reading"))
    assert len(views) == len(copies) == len(readings) == 150
    assert np.ptp(views[:, 1]) == 0
    assert views[-1].tolist() == copies[-1].tolist()
    assert np.array_equal(copies, readings)
    # metres are pixels times one factor, which the axis has: from 0 to 0.4
    factor = (copies[0, 1] - copies[-1, 1]) / (lists["copied"][-1] - lists["copied"][0])
    drawn = lists["copied"][0] + (copies[0, 1] - copies[:, 1]) / factor
    assert drawn == pytest.approx(lists["copied"], abs=1e-4)
    rows = opened.find_elements("css selector", "#entries tbody tr")
    live, first = f"{lists['live']:.4f}", f"{lists['copied'][0]:.4f}"
    assert rows[0].text == f"views 150 {live} {live} 0.0000"
    assert rows[1].text == f"copies 150 {first} {live} {np.ptp(lists['copied']):.4f}"


def test_the_end_shows_both_ranges_and_restart_begins_anew(opened: Any) -> None:
    click(opened, "end")
    assert text(opened, "entries").endswith("0.3165 0.2269")
    assert "200 of 200" in text(opened, "time")
    label = opened.find_element("id", "lists").get_attribute("aria-label")
    assert "stored copies, from 0.0896 m to 0.3165 m" in label
    click(opened, "restart")
    assert opened.execute_script(READ)["viewed"] == []
    assert text(opened, "live") == "0.0896 m"


def test_it_plays_by_itself_unless_motion_is_to_be_reduced(open_page: Callable[..., Any]) -> None:
    still = open_page()
    assert still.execute_script(READ)["viewed"] == []
    assert text(still, "play") == "Play"
    moving = open_page(prefers_reduced_motion="no-preference")
    assert moving.execute_script(
        "return lab.fall.playback.isPlaying || lab.fall.recording.isComplete"
    )


def test_a_view_dies_when_the_heap_grows_and_a_copy_does_not(opened: Any) -> None:
    click(opened, "grow")
    from selenium.webdriver.support.wait import WebDriverWait

    WebDriverWait(opened, 60).until(lambda b: b.find_elements("css selector", "#growth tbody tr"))
    rows = opened.find_elements("css selector", "#growth tbody tr")
    assert [row.text for row in rows] == [
        "stored view length 3, x 0.3165 m length 0, x undefined",
        "stored copy length 3, x 0.3165 m length 3, x 0.3165 m",
    ]
    assert "the heap grew from" in text(opened, "growth-summary")


def test_with_a_ball_before_the_robot_the_index_means_the_ball_and_the_name_the_cart(
    opened: Any,
) -> None:
    read = "const { data, slider } = lab.naming.robot; return [data.qpos[0], slider.qpos[0]]"
    assert opened.execute_script(read) == [0.3, 0.3]
    assert text(opened, "outcome").startswith("Right")
    click(opened, "ball")
    assert opened.execute_script(read) == [0.3, 0.0]
    assert text(opened, "outcome") == "Wrong: ball x changes, and the cart stays where it is."
    assert len(opened.find_elements("css selector", "#qpos li")) == 9
    click(opened, "by-name")
    assert opened.execute_script(read) == [-0.4, 0.3]
    assert text(opened, "outcome") == "Right: the cart moves."
    click(opened, "ball")
    assert opened.execute_script(read) == [0.3, 0.3]


def test_keys_do_what_buttons_do_until_they_are_turned_off(opened: Any) -> None:
    press(opened, "sss")
    assert len(opened.execute_script(READ)["viewed"]) == 3
    press(opened, "e")
    assert len(opened.execute_script(READ)["viewed"]) == STEPS
    press(opened, "r")
    assert opened.execute_script(READ)["viewed"] == []
    press(opened, "bn")
    assert opened.find_element("id", "ball").is_selected()
    assert opened.find_element("id", "by-name").is_selected()
    press(opened, " ")
    assert text(opened, "play") == "Pause"
    press(opened, " ")
    assert text(opened, "play") == "Play"
    press(opened, "d")
    assert opened.find_element("id", "theme").get_attribute("aria-pressed") == "true"
    click(opened, "shortcuts")
    steps = len(opened.execute_script(READ)["viewed"])
    press(opened, "s")
    assert len(opened.execute_script(READ)["viewed"]) == steps


def test_the_tab_key_reaches_every_control_and_shows_where_it_is(opened: Any) -> None:
    from selenium.webdriver import ActionChains, Keys

    controls = opened.execute_script(
        "return [...document.querySelectorAll('button, input, select')].map((each) => each.id)"
    )
    reached = []
    for _ in range(len(controls) + 1):
        ActionChains(opened).send_keys(Keys.TAB).perform()
        name, outline = opened.execute_script(
            "const focused = document.activeElement;"
            "return [focused.id, getComputedStyle(focused).outlineStyle]"
        )
        assert name == "" or outline == "solid", name
        reached.append(name)
    # of radio buttons, arrows reach the other
    assert {*controls} - {*reached} == {"by-name"}
    assert {*BUTTONS} <= {*reached}


def test_what_is_announced_is_said_once_and_not_at_every_frame(opened: Any) -> None:
    click(opened, "play")
    assert text(opened, "play") == "Pause"
    said = "return document.getElementById('announcement').textContent"
    assert opened.execute_script(said) == ""
    click(opened, "end")
    assert "Stored views: all 0.3165 m, range 0.0000 m." in opened.execute_script(said)


def test_the_browser_is_measured(opened: Any, tmp_path: Path) -> None:
    """One model, and one of the user's own that has an error."""
    opened.execute_script("lab.measuring.models = lab.measuring.models.slice(0, 1)")
    own = tmp_path / "broken.xml"
    own.write_text("<mujoco><worldbody><oops/></worldbody></mujoco>")
    opened.find_element("id", "own").send_keys(str(own))
    measure(opened)
    rows = [row.text for row in opened.find_elements("css selector", ".speeds tbody tr")]
    assert [row.split()[0] for row in rows] == ["cartpole"]
    conditions = text(opened, "conditions")
    assert "Contacts of a step: cartpole 0.0." in conditions
    assert "The median of 20 blocks of about " in conditions
    assert text(opened, "refused").startswith("broken.xml: MuJoCo cannot load this model: ")
    assert "unrecognized element" in text(opened, "refused")
    assert opened.get_log("browser") == []


def test_a_measurement_can_be_cancelled(opened: Any) -> None:
    click(opened, "measure")
    assert text(opened, "measure") == "Cancel"
    click(opened, "measure")
    assert text(opened, "measure") == "Measure"
    assert text(opened, "conditions") == "Cancelled."


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        ("delete globalThis.WebAssembly", "This browser has no WebAssembly. It needs Chrome"),
        ("delete globalThis.DecompressionStream", "This browser is too old. It needs Chrome"),
        (
            "WebAssembly.instantiate = async () => { throw new RangeError('out of memory') }",
            "MuJoCo cannot start: out of memory",
        ),
    ],
    ids=["no WebAssembly", "an old browser", "out of memory"],
)
def test_what_fails_is_on_the_page(
    browser: Any, open_page: Callable[..., Any], broken: str, message: str
) -> None:
    command = "Page.addScriptToEvaluateOnNewDocument"
    script = browser.execute_cdp_cmd(command, {"source": broken})
    try:
        opened = open_page(ready="!document.getElementById('failure').hidden")
        assert text(opened, "failure").startswith(message)
        assert opened.find_element("id", "failure").get_attribute("role") == "alert"
    finally:
        browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)


def test_dark_follows_the_system_and_the_button(open_page: Callable[..., Any]) -> None:
    read = "return getComputedStyle(document.body).backgroundColor"
    light = open_page().execute_script(read)
    dark_page = open_page(prefers_color_scheme="dark")
    dark = dark_page.execute_script(read)
    assert dark != light
    click(dark_page, "theme")
    assert dark_page.execute_script(read) == light
    click(dark_page, "theme")
    assert dark_page.execute_script(read) == dark


@pytest.mark.parametrize("width", [320, 1280])
def test_nothing_is_wider_than_the_screen_and_controls_fit_a_finger(
    opened: Any, width: int
) -> None:
    resize(opened, width)
    click(opened, "end", "grow", "ball")
    assert opened.execute_script("return document.documentElement.scrollWidth") <= width
    small = opened.execute_script(
        "const controls = 'button, select, label:has(input), input:not(label *)';"
        "return [...document.querySelectorAll(controls)]"
        ".filter((each) => each.getBoundingClientRect().height < 44).map((each) => each.outerHTML)"
    )
    assert small == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_fault(open_page: Callable[..., Any], scheme: str) -> None:
    opened = open_page(prefers_color_scheme=scheme)
    click(opened, "end", "grow", "ball")
    assert violations(opened) == []
