"""A wrong path is found, and the step after which it first shows."""

from typing import Any

import pytest
import wrong_paths

from mjbench import paths
from mjbench.comparison.plan import Variant
from mjbench.comparison.verification import ReferenceCase, verify
from mjbench.simulation import work, workload
from mjbench.status import Status


@pytest.fixture(scope="module")
def case(model: Any) -> ReferenceCase:
    return ReferenceCase.create(*work.observe_healthy(workload.make(model, nbatch=6, nstep=40)))


@pytest.mark.parametrize(
    ("name", "step"),
    [("OneStepFewer", 1), ("ControlShifted", 2), ("LastUnstepped", 1), ("LateError", 30)],
)
def test_the_first_step_that_differs_is_named(case: ReferenceCase, name: str, step: int) -> None:
    report, prepared = verify(3, Variant(f"wrong_paths:{name}", {}), case, None)
    assert prepared is None
    assert (report.index, report.status, report.agrees) == (3, Status.DISAGREES, False)
    assert f"after step {step}:" in report.agreement


def test_a_right_path_agrees_and_may_be_timed(case: ReferenceCase) -> None:
    report, prepared = verify(0, Variant("wrong_paths:Right", {}), case, None)
    assert isinstance(prepared, paths.Prepared)
    assert (report.status, report.agrees, report.agreement) == (Status.OK, True, "bit-identical")


def test_a_lost_warm_start_shows_on_the_case_in_contact_alone() -> None:
    from mjbench.simulation import models

    cartpole = models.load(models.resolve("cartpole"))
    no_contact = ReferenceCase.create(*work.observe_healthy(workload.make(cartpole, 3, 5)))
    in_contact = ReferenceCase.in_contact(hold=1, seed=0)
    variant = Variant("wrong_paths:ColdWarmStart", {})
    assert verify(0, variant, no_contact, None)[0].agrees is True
    report, _ = verify(0, variant, no_contact, in_contact)
    assert report.agrees is False
    assert "cube_table" in report.agreement


def test_a_path_that_raises_fails_by_itself(case: ReferenceCase) -> None:
    report, prepared = verify(0, Variant("wrong_paths:Raises", {}), case, None)
    assert prepared is None
    assert (report.status, report.detail) == (Status.FAILED, "RuntimeError: out of luck")
    assert wrong_paths.Raises.name == "wrong_paths:Raises"


@pytest.mark.parametrize(
    ("name", "detail"),
    [
        ("UnsuitedRaises", "RuntimeError: cannot tell"),
        ("PrepareInterrupts", "KeyboardInterrupt"),
        ("SnippetRaises", "LookupError: none"),
        ("MessageRaises", "UnprintableError"),
        ("NameIsNoText", "InputError: path wrong_paths:NameIsNoText: its name must be a str"),
    ],
)
def test_whatever_a_path_raises_costs_its_own_row(
    case: ReferenceCase, name: str, detail: str
) -> None:
    report, prepared = verify(0, Variant(f"wrong_paths:{name}", {}), case, None)
    assert prepared is None
    assert report.status == Status.FAILED
    assert report.detail.startswith(detail)
    assert "\n" not in report.detail


def test_a_reason_that_is_no_text_is_reported_as_text(case: ReferenceCase) -> None:
    report, _ = verify(0, Variant("wrong_paths:UnsuitedIsNoText", {}), case, None)
    assert (report.status, report.detail) == (Status.UNAVAILABLE, "7")
