"""Chromium without a window, for the pages that mjbench writes."""

import importlib.resources
import json
import shutil
from collections.abc import Iterator
from typing import Any

import pytest

# Under which it starts in a container, and asks the network for nothing.
FLAGS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
)


def session() -> Iterator[Any]:
    """Yield a driver that notes console messages and requests; skip where there is none."""
    webdriver = pytest.importorskip("selenium.webdriver")
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not (chromium and driver):
        pytest.skip("needs chromium and chromedriver")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in FLAGS:
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    browser = webdriver.Chrome(options, webdriver.ChromeService(driver))
    yield browser
    browser.quit()


def emulate(browser: Any, **media: str) -> None:
    """Have the browser prefer something, such as `prefers_color_scheme="dark"`; else nothing."""
    features = [{"name": name.replace("_", "-"), "value": media[name]} for name in media]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})


def resize(browser: Any, width: int, height: int = 800) -> None:
    """Give the browser the screen of a phone."""
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def requested(browser: Any) -> list[str]:
    """Return the addresses that the page asked for since the last call."""
    sent = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    return [
        event["params"]["request"]["url"]
        for event in sent
        if event["method"] == "Network.requestWillBeSent"
    ]


def violations(browser: Any) -> list[tuple[str, str]]:
    """Return what axe finds in the page: the rule, and an element that breaks it."""
    package = pytest.importorskip("axe_core_python")
    script = importlib.resources.files(package).joinpath("axe.min.js").read_text()
    browser.execute_script(script)
    result = browser.execute_async_script("axe.run().then(arguments[arguments.length - 1])")
    return [
        (violation["id"], violation["nodes"][0]["html"][:200]) for violation in result["violations"]
    ]
