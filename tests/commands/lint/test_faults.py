"""What lint reports is a fault: the program that the documentation names shows it."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from mjbench.commands.lint.rules import RULES

ROOT = Path(__file__).parents[3]
PROGRAM = ROOT / "docs/examples/lint_faults.py"


@pytest.fixture(scope="module")
def faults() -> ModuleType:
    spec = importlib.util.spec_from_file_location("lint_faults", PROGRAM)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_every_rule_has_a_fault_that_the_documentation_runs(faults: ModuleType) -> None:
    codes = [rule.code for rule in RULES]
    assert list(faults.FAULTS) == codes
    page = (ROOT / "docs/lint.md").read_text()
    assert f"`python docs/examples/lint_faults.py {codes[0]}`" in page


def test_stored_views_are_one_state(faults: ModuleType) -> None:
    assert faults.stored_view() == "different states in 100 steps: 1 views, 100 copies"


TIMED = [
    *("MJB002", "MJB003", "MJB005", "MJB006", "MJB007", "MJB010", "MJB011", "MJB014", "MJB017"),
    *("MJB018", "MJB019", "MJB020", "MJB023"),
]


@pytest.mark.parametrize("code", TIMED)
def test_what_to_write_instead_computes_the_same(
    faults: ModuleType, code: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The functions assert it; their times belong to the reader's machine."""
    calls = []

    def ns(call, number: int = 1) -> float:
        calls.append(call())
        return 1.0

    monkeypatch.setattr(faults, "_ns", ns)
    assert faults.FAULTS[code]()
    assert len(calls) >= 2


def test_halves_of_runge_kutta_are_steps_of_euler(faults: ModuleType) -> None:
    assert "by halves, as by Euler" in faults.halves_of_runge_kutta()


def test_a_row_of_two_moments_is_late_by_a_step(faults: ModuleType) -> None:
    shown = faults.row_of_two_moments()
    apart = re.search(r"([\d.]+) mm apart", shown)
    assert apart is not None and float(apart[1]) > 1
    assert shown.endswith("0 with mj_kinematics, 0 with qpos of before the step")


def test_an_observation_that_is_a_view_moves_the_box(faults: ModuleType) -> None:
    heights = re.findall(r"[\d.]+(?= with)", faults.written_view())
    assert len(heights) == 2
    assert float(heights[0]) > 100 * float(heights[1]) > 10


def test_threads_that_share_an_mjdata_are_a_fault(faults: ModuleType) -> None:
    """What happens differs from run to run; that each MjData of its own is right does not."""
    assert faults.shared_data().endswith("with one MjData, 1 state with four")


def test_a_new_renderer_draws_the_same_or_needs_opengl(
    faults: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(faults, "_ns", lambda call, number: float(call() is not None))
    assert re.match("needs OpenGL|ms a frame", faults.new_renderer())


def test_each_new_function_is_compiled_or_jax_is_missing(
    faults: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    if importlib.util.find_spec("jax") is None:
        pytest.skip("jax is not installed")
    # in a process of its own: where JAX was imported, a fork warns
    command = [sys.executable, str(PROGRAM), "MJB013"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith("4 of new lambdas, 1 of one function")
    monkeypatch.setitem(sys.modules, "jax", None)
    assert faults.new_jitted_function() == "needs jax: pip install jax"


def test_a_replaced_state_is_the_one_put_on_the_device_or_mjx_is_missing(
    faults: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco.mjx", None)
    monkeypatch.delattr("mujoco.mjx", raising=False)
    assert faults.new_device_copy().startswith("needs mujoco-mjx")
    if importlib.util.find_spec("jax") is None:
        pytest.skip("jax is not installed")
    command = [sys.executable, str(PROGRAM), "MJB022"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "to replace" in done.stdout


def test_a_viewer_is_synced_or_needs_a_screen(faults: ModuleType) -> None:
    assert re.match("ns a step|needs a screen", faults.synced_viewer())
