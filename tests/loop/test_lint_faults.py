"""What lint reports is a fault: the program that the documentation names shows it."""

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from mjbench.loop.lint_rules import RULES

ROOT = Path(__file__).parents[2]
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
    command = r"^\| (MJB\d+) .*`python docs/examples/lint_faults.py (MJB\d+)`"
    rows = re.findall(command, _page(), re.MULTILINE)
    assert rows == [(code, code) for code in codes]


def test_stored_views_are_one_state(faults: ModuleType) -> None:
    assert faults.stored_view() == "different states in 100 steps: 1 views, 100 copies"


@pytest.mark.parametrize("code", ["MJB002", "MJB003", "MJB005", "MJB006"])
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


def _page() -> str:
    return (ROOT / "docs/lint.md").read_text()
