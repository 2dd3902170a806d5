"""What the tests share: a small model that starts in contact, and its workload."""

import gc
import os
import signal
from collections.abc import Iterator
from typing import Any

import mujoco
import pytest
from commands import TESTS
from example_models import CONTACT_XML
from headless_browser import session
from hypothesis import settings

from mjbench.comparison import step_costs
from mjbench.host import neighbours
from mjbench.simulation import workload

# The same examples in every run: a test that passed does not fail by chance.
settings.register_profile("mjbench", derandomize=True, deadline=None)
settings.load_profile("mjbench")


def pytest_configure(config: pytest.Config) -> None:
    """Time nothing unless asked to, and take signals; `pytest` runs every benchmark once."""
    if not (config.getoption("benchmark_only") or config.getoption("benchmark_enable")):
        config.option.benchmark_disable = True
    _take_signals()


def _take_signals() -> None:
    """Have signals end this process, which a background job ignores and a command handles."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.fixture(scope="session", autouse=True)
def _no_traces(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Keep tests out of sight of other mjbench on this machine, and out of the user's tables."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(neighbours.FOLDER_VARIABLE, str(tmp_path_factory.mktemp("measuring")))
        costs = tmp_path_factory.mktemp("step_costs") / "costs.json"
        patch.setenv(step_costs.FILE_VARIABLE, str(costs))
        yield


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    yield from session()


@pytest.fixture(scope="session")
def model() -> Any:
    return mujoco.MjModel.from_xml_string(CONTACT_XML)


@pytest.fixture
def small(model: Any) -> workload.Workload:
    return workload.make(model, nbatch=5, nstep=12, hold=3, seed=1)


@pytest.fixture
def without_warp(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide Warp from child processes of MJX, which would take seconds to import it."""
    folders = (str(TESTS / "without_warp"), os.environ.get("PYTHONPATH", ""))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, folders)))


@pytest.fixture
def contact_file(tmp_path: Any) -> str:
    path = tmp_path / "contact.xml"
    path.write_text(CONTACT_XML)
    return str(path)


def pytest_runtest_teardown() -> None:
    """Undo what usually ends with its process: disabled garbage collection, handlers of signals."""
    gc.enable()
    _take_signals()
