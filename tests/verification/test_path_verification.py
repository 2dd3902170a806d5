"""A wrong path is found, and the step after which it first shows."""

from typing import Any

import mujoco
import pytest

from mjbench import paths
from mjbench.simulation import models, reference_run, workload
from mjbench.simulation.workload import Product
from mjbench.status import Status
from mjbench.verification.path_verification import FurtherCases, verify
from mjbench.verification.plan import Variant
from mjbench.verification.reference_case import ReferenceCase

NOTHING_FURTHER = FurtherCases(None, {})


@pytest.fixture(scope="module")
def case(model: Any) -> ReferenceCase:
    return ReferenceCase.create(
        *reference_run.observe_healthy(workload.make(model, nbatch=6, nstep=40))
    )


@pytest.fixture(scope="module")
def humanoid() -> ReferenceCase:
    model = models.load(models.resolve("humanoid"))
    return ReferenceCase.create(
        *reference_run.observe_healthy(workload.make(model, nbatch=4, nstep=8))
    )


@pytest.fixture(scope="module")
def further_humanoid(humanoid: ReferenceCase) -> FurtherCases:
    return FurtherCases.create(humanoid, step_s=3e-5)


@pytest.mark.parametrize(
    ("name", "step"),
    [("OneStepFewer", 1), ("ControlShifted", 2), ("LastUnstepped", 1), ("LateError", 30)],
)
def test_the_first_step_that_differs_is_named(case: ReferenceCase, name: str, step: int) -> None:
    report, prepared = verify(3, Variant(f"wrong_paths:{name}", {}), case, NOTHING_FURTHER)
    assert prepared is None
    assert (report.position, report.status, report.agrees) == (3, Status.DISAGREES, False)
    assert f"after step {step}:" in report.agreement


def test_a_right_path_agrees_and_may_be_timed(case: ReferenceCase) -> None:
    report, prepared = verify(0, Variant("wrong_paths:Right", {}), case, NOTHING_FURTHER)
    assert isinstance(prepared, paths.Prepared)
    assert (report.status, report.agrees) == (Status.OK, True)
    assert report.agreement == "bit-identical, sensor data not compared"


def test_a_lost_warm_start_shows_on_the_case_in_contact_alone() -> None:
    cartpole = models.load(models.resolve("cartpole"))
    no_contact = ReferenceCase.create(*reference_run.observe_healthy(workload.make(cartpole, 3, 5)))
    in_contact = ReferenceCase.in_contact(hold=1, seed=0)
    variant = Variant("wrong_paths:ColdWarmStart", {})
    assert verify(0, variant, no_contact, NOTHING_FURTHER)[0].agrees is True
    report, _ = verify(0, variant, no_contact, FurtherCases(in_contact, {}))
    assert report.agrees is False
    assert "cube_table" in report.agreement


@pytest.mark.parametrize(
    ("name", "detail"),
    [
        ("Raises", "RuntimeError: out of luck"),
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
    report, prepared = verify(0, Variant(f"wrong_paths:{name}", {}), case, NOTHING_FURTHER)
    assert prepared is None
    assert report.status == Status.FAILED
    assert report.detail.startswith(detail)
    assert "\n" not in report.detail


def test_a_reason_that_is_no_text_is_reported_as_text(case: ReferenceCase) -> None:
    report, _ = verify(0, Variant("wrong_paths:UnsuitedIsNoText", {}), case, NOTHING_FURTHER)
    assert (report.status, report.detail) == (Status.UNAVAILABLE, "7")


def test_a_path_that_replays_its_first_result_differs_once_simulations_are_reordered(
    case: ReferenceCase,
) -> None:
    report, _ = verify(0, Variant("wrong_paths:Memo", {}), case, NOTHING_FURTHER)
    assert report.status == Status.DISAGREES
    assert "differs after step 1 once the simulations are reordered" in report.agreement


def test_a_replay_is_caught_where_the_user_asks_for_one_simulation() -> None:
    model = models.load(models.resolve("cartpole"))
    own = ReferenceCase.create(
        *reference_run.observe_healthy(workload.make(model, nbatch=1, nstep=8))
    )
    variant = Variant("wrong_paths:Memo", {})
    assert verify(0, variant, own, NOTHING_FURTHER)[0].agrees is True
    report, _ = verify(0, variant, own, FurtherCases.create(own, step_s=1e-6))
    assert report.agrees is False
    assert "once the simulations are reordered" in report.agreement


def test_a_difference_names_the_simulation_as_the_user_numbers_them(case: ReferenceCase) -> None:
    number = int(case.numbers[2])
    prepared = paths.find("wrong_paths:Right").prepare(case.workload, {}, case.resources)
    states = prepared.verified_states()
    states.values[2, 0] += 1.0
    difference = case.difference(states, prepared)
    assert difference.simulation == number


@pytest.mark.parametrize("name", ["NoSensors", "DropsXfrc", "WrongMiddle"])
def test_what_final_states_hide_is_caught_with_every_input_and_output(
    humanoid: ReferenceCase, further_humanoid: FurtherCases, name: str
) -> None:
    variant = Variant(f"wrong_paths:{name}", {})
    assert verify(0, variant, humanoid, NOTHING_FURTHER)[0].agrees is True
    report, prepared = verify(0, variant, humanoid, further_humanoid)
    assert prepared is None
    assert report.status == Status.DISAGREES
    assert " differs after step " in report.agreement
    assert report.agreement.endswith("with every input set")


def test_user_data_that_is_dropped_is_noticed() -> None:
    xml = (
        "<mujoco><size nuserdata='2'/><worldbody><body><joint/><geom size='.1'/></body></worldbody>"
        "</mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(xml)
    own = ReferenceCase.create(
        *reference_run.observe_healthy(workload.make(model, nbatch=3, nstep=4))
    )
    further = FurtherCases.create(own, step_s=1e-6)
    report, _ = verify(0, Variant("wrong_paths:DropsUserdata", {}), own, further)
    assert report.agreement.startswith("userdata[0] of simulation 0 differs after step 1")


def test_the_step_of_a_wrong_state_in_the_middle_is_named() -> None:
    model = models.load(models.resolve("cartpole"))
    own = workload.make(model, nbatch=3, nstep=10).returning(Product.TRAJECTORY)
    trajectories = ReferenceCase.create(*reference_run.observe_healthy(own))
    variant = Variant("wrong_paths:WrongMiddle", {})
    report, _ = verify(0, variant, trajectories, NOTHING_FURTHER)
    assert "of simulation 1 differs after step 3:" in report.agreement


@pytest.mark.parametrize("product", [Product.TRAJECTORY, Product.SENSORS])
def test_a_path_that_returns_less_than_it_says_fails(
    humanoid: ReferenceCase, product: Product
) -> None:
    own = humanoid.workload.returning(product)
    outputs = ReferenceCase.create(*reference_run.observe_healthy(own))
    variant = Variant("wrong_paths:ClaimsTrajectories", {})
    report, _ = verify(0, variant, outputs, NOTHING_FURTHER)
    assert report.status == Status.FAILED
    assert "returns no state of every step" in report.detail


def test_a_path_that_cannot_return_the_product_is_unavailable(humanoid: ReferenceCase) -> None:
    own = humanoid.workload.returning(Product.SENSORS)
    outputs = ReferenceCase.create(*reference_run.observe_healthy(own))
    report, _ = verify(0, Variant("wrong_paths:FinalOnly", {}), outputs, NOTHING_FURTHER)
    assert (report.status, report.agrees) == (Status.UNAVAILABLE, None)
    assert report.detail == "returns final, not sensors: --returns final compares it"


def test_a_path_whose_sensors_nobody_can_see_says_so(
    humanoid: ReferenceCase, further_humanoid: FurtherCases
) -> None:
    report, _ = verify(0, Variant("wrong_paths:FinalOnly", {}), humanoid, further_humanoid)
    assert report.status == Status.OK
    assert report.agreement.endswith("sensor data not compared")


def test_a_right_path_agrees_with_every_input_and_output(
    humanoid: ReferenceCase, further_humanoid: FurtherCases
) -> None:
    report, _ = verify(0, Variant("wrong_paths:Right", {}), humanoid, further_humanoid)
    assert report.agreement.startswith("bit-identical, also with every input set")


@pytest.mark.parametrize("source", ["first", "previous", "last"])
@pytest.mark.parametrize(
    ("name", "field"),
    [
        ("gripper", "eq_active"),
        ("gripper", "qfrc_applied"),
        ("gripper", "xfrc_applied"),
        ("muscle_arm", "act"),
        ("mocap", "mocap_pos"),
        ("mocap", "mocap_quat"),
        ("mocap", "userdata"),
    ],
)
def test_an_input_that_is_taken_from_another_simulation_is_refused(
    every_input_cases: dict[str, FurtherCases], name: str, field: str, source: str
) -> None:
    further = every_input_cases[name]
    variant = Variant("wrong_paths:CopiesInput", {"field": field, "source": source})
    (inputs_case,) = [case for p, case in further.inputs.items() if p == Product.SENSORS]
    report, _ = verify(0, variant, inputs_case, NOTHING_FURTHER)
    assert report.agrees is False, report


@pytest.fixture(scope="module")
def every_input_cases() -> dict[str, FurtherCases]:
    """Return the cases with every input set, of models that have them."""
    mocap = mujoco.MjModel.from_xml_string(
        "<mujoco><size nuserdata='2'/><worldbody><body name='hand' mocap='true' pos='0 0 1'/>"
        "<body name='held' pos='0 0 1'><freejoint/><geom size='.04'/></body></worldbody>"
        "<equality><weld body1='hand' body2='held'/></equality></mujoco>"
    )
    loaded = {name: models.load(models.resolve(name)) for name in ("gripper", "muscle_arm")}
    return {
        name: FurtherCases.create(
            ReferenceCase.create(*reference_run.observe_healthy(workload.make(model, 4, 8))), 1e-5
        )
        for name, model in {**loaded, "mocap": mocap}.items()
    }
