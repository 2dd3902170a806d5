"""What could stand in place of a call is timed on the program's own model and states."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mjbench.program import replacements
from mjbench.program.recorded_models import RecordedModel
from mjbench.program.trials import Question, Trial

MODEL = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><body name='arm'><joint axis='0 1 0'/><geom size='.1' pos='.3 0 0'/></body>"
    "</worldbody></mujoco>"
)
SPEC = mujoco.mjtState.mjSTATE_INTEGRATION


def recorded(model=MODEL):
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    data = mujoco.MjData(model)
    state = np.empty((1, mujoco.mj_stateSize(model, SPEC)))
    mujoco.mj_getState(model, data, state[0], SPEC)
    return RecordedModel(buffer.tobytes(), state, state, mujoco.__version__)


class Channel:
    """Keeps what the child would send."""

    def __init__(self):
        self.sent = []

    def send(self, message):
        self.sent.append(message)


@pytest.fixture
def quick(monkeypatch):
    """Time each pair for as few rounds as an interval needs."""
    monkeypatch.setattr(replacements, "BUDGET_S", 0.0)
    monkeypatch.setattr(replacements, "LEAST_ROUNDS", 6)
    monkeypatch.setattr(replacements, "MOST_CALLS", 2)


def answers(questions, model=MODEL):
    channel = Channel()
    replacements.answer(recorded(model), questions, channel)
    return channel.sent


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("trial", list(Trial))
def test_every_pair_can_be_timed(trial):
    if trial == Trial.RENDERER:
        pytest.skip("it needs OpenGL; benchmarks.own_programs tries it")
    if trial == Trial.BATCH:
        pytest.importorskip("mujoco.batch", reason="this MuJoCo has no Batch")
    question = Question(trial, ("mj_kinematics",), simulations=2, steps=2)
    _, answer = answers([question])
    ratio = answer.ratios[question]
    assert 0 < ratio.low <= ratio.estimate <= ratio.high


@pytest.mark.usefixtures("quick")
def test_a_pair_that_the_model_or_the_release_lacks_is_left_out():
    runge_kutta = mujoco.MjModel.from_xml_string("<mujoco><option integrator='RK4'/></mujoco>")
    asked = [Question(Trial.INVERSE), Question(Trial.FUNCTIONS, ("mj_of_another_release",))]
    known = Question(Trial.NO_TIMER)
    _, *rest = answers([*asked, known], runge_kutta)
    assert [list(answer.ratios) for answer in rest] == [[known]]


def test_whether_a_step_computes_forces_follows_from_the_sensors():
    with_sensor = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint/><geom size='.1'/><site name='s'/></body></worldbody>"
        "<sensor><accelerometer site='s'/></sensor></mujoco>"
    )
    assert [message.computes_forces for message in answers([])] == [False]
    assert [message.computes_forces for message in answers([], with_sensor)] == [True]


def test_a_model_of_another_release_is_not_loaded():
    other = replace(recorded(), release="2.3.7")
    assert replacements.measure([other], [Question(Trial.NO_TIMER)]).ratios == {}


def test_a_model_that_crashes_the_child_costs_only_its_ratios():
    damaged = replace(recorded(), mjb=b"no model")
    measured = replacements.measure([damaged], [Question(Trial.NO_TIMER)])
    assert measured == replacements.MeasuredRatios({})


def test_a_pair_on_threads_is_the_median_launch_with_the_interval_of_all(monkeypatch):
    threaded, alone = Question(Trial.POOL), Question(Trial.ONE_CALL)
    estimates = iter((0.9, 0.5, 1.4, 0.7, 0.6, 0.8))

    def launch(function, arguments, on_message, *_, **__):
        for question in arguments[1]:
            estimate = next(estimates)
            ratio = replacements.TimeRatio(estimate, estimate, estimate, 0.0)
            on_message(replacements.MeasuredRatios({question: ratio}))

    monkeypatch.setattr(replacements.isolate, "run", launch)
    ratios = replacements.measure([recorded()], [threaded, alone]).ratios
    ends = {q: (ratio.low, ratio.estimate, ratio.high) for q, ratio in ratios.items()}
    assert ends == {alone: (0.9, 0.9, 0.9), threaded: (0.5, 0.7, 1.4)}
    assert ratios[threaded].saved == 0.0
