"""What mjbench suggests computes the same as what the program does, and both are timed."""

import inspect
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mjbench.commands.run.hook import call_clock
from mjbench.commands.run.recorded_models import RecordedModel
from mjbench.commands.run.remedies import call_ways, line_remedies, loop_remedies, remedy_pairs
from mjbench.commands.run.remedies.remedy_pairs import RemedyPair, TimedWay
from mjbench.errors import InputError
from mjbench.simulation import compat

# What each row tries; the names are those of the call clock.
PAIRS = [
    RemedyPair(call_ways.functions, ("mj_kinematics",)),
    *(
        RemedyPair(getattr(call_ways, name))
        for name in ("inverse", "one_call", "rays", "no_rollout")
    ),
    RemedyPair(call_ways.rollouts, ("rollout", "Rollout.rollout")),
    RemedyPair(call_ways.rollouts, (call_clock.THREADED_ROLLOUT, "Rollout.rollout")),
    RemedyPair(call_ways.rollouts, ("Rollout.rollout", "Batch.step")),
    RemedyPair(call_ways.rollouts, ("Rollout.rollout", "mj_step")),
    RemedyPair(call_ways.new_data, ("MjData", "mj_resetData")),
    RemedyPair(call_ways.new_data, ("MjData", "mj_copyData")),
    RemedyPair(call_ways.new_data, (call_clock.COPY_OF_DATA, "mj_copyData"), of_copied=True),
    RemedyPair(call_ways.new_data, (call_clock.DEEP_COPY_OF_DATA, "mj_copyData"), of_copied=True),
    RemedyPair(line_remedies.named_access, by_wall_time=True),
    *(
        RemedyPair(getattr(line_remedies, name))
        for name in ("new_array", "concatenation", "contacts", "columns")
    ),
    RemedyPair(loop_remedies.no_timer),
    RemedyPair(loop_remedies.batch, on_threads=True),
]
GRAPHICS = [RemedyPair(call_ways.renderer), RemedyPair(call_ways.coarser_images)]

FALLING = """
<mujoco>
  <option integrator="{}"/>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .2"><freejoint/><geom size=".1"/></body>
    <body pos="0 0 .6"><joint axis="0 1 0"/><geom size=".05" pos=".3 0 0"/></body>
  </worldbody>
</mujoco>
"""


def ways(function, of_model):
    return function(of_model, RemedyPair(function))


def model(integrator="Euler"):
    return mujoco.MjModel.from_xml_string(FALLING.format(integrator))


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_inverse_dynamics_within_a_step_leaves_the_same_state(integrator):
    states = []
    for way in ways(call_ways.inverse, model(integrator)):
        data = mujoco.MjData(model(integrator))
        for _ in range(200):
            way.run(data)
        states.append([*data.qpos, *data.qvel, *data.qacc_warmstart])
    assert states[0] == states[1]


def test_halves_of_a_step_are_not_suggested_for_runge_kutta():
    with pytest.raises(InputError, match="Euler"):
        ways(call_ways.inverse, model("RK4"))


def test_contacts_one_by_one_and_as_arrays_are_the_same():
    data = mujoco.MjData(model())
    mujoco.mj_step(model(), data, 200)
    one_by_one, arrays = ways(line_remedies.contacts, model())
    assert data.ncon
    assert np.array_equal(one_by_one.run(data), arrays.run(data))


@pytest.mark.parametrize("pair", PAIRS, ids=lambda each: each.ways.__name__)
def test_both_ways_of_each_pair_run(pair):
    for way in pair.ways(model(), replace(pair, simulations=2)):
        way.run(mujoco.MjData(model()))


def test_each_pair_of_ways_is_tried_here():
    declared = {
        function
        for module in (call_ways, line_remedies, loop_remedies)
        for function in vars(module).values()
        if inspect.isfunction(function)
        and function.__annotations__.get("return") == tuple[TimedWay, TimedWay]
    }
    assert {pair.ways for pair in [*PAIRS, *GRAPHICS]} == declared


def test_a_mistake_in_a_pair_is_no_lack_of_a_release():
    """A TypeError ends the child of `remedy_pairs`, which says so."""
    assert not issubclass(TypeError, remedy_pairs.LACKING)


def test_rays_at_once_hit_what_single_rays_hit():
    data = mujoco.MjData(model())
    mujoco.mj_forward(model(), data)
    vectors, geom = np.array([[0.0, 0, -1], [0, 0, 1], [1, 0, -0.1]]), np.empty(1, np.int32)
    origin, geoms, distances = np.array([0.0, 0, 1]), np.empty(3, np.int32), np.empty(3)
    compat.cast_rays(model(), data, origin, vectors, geoms, distances)
    single = [mujoco.mj_ray(model(), data, origin, each, None, 1, -1, geom) for each in vectors]
    assert distances.tolist() == single


def test_a_step_with_controls_is_that_of_a_rollout():
    actuated = mujoco.MjModel.from_xml_string(
        FALLING.format("Euler")
        .replace("</worldbody>", "</worldbody><actuator><motor joint='hinge'/></actuator>")
        .replace("<joint axis", '<joint name="hinge" axis')
    )
    ends = []
    for way in ways(call_ways.no_rollout, actuated):
        data = mujoco.MjData(actuated)
        way.prepare(data)
        for _ in range(3):
            way.run(data)
        ends.append([*data.qpos, *data.ctrl])
    assert ends[0] == ends[1]


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
    monkeypatch.setattr(remedy_pairs, "BUDGET_S", 0.0)
    monkeypatch.setattr(remedy_pairs, "LEAST_ROUNDS", 6)
    monkeypatch.setattr(remedy_pairs, "MOST_CALLS", 2)


def answers(questions, model=MODEL):
    channel = Channel()
    remedy_pairs.answer(recorded(model), questions, channel)
    return channel.sent


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("pair", PAIRS, ids=lambda each: each.ways.__name__)
def test_every_pair_can_be_timed(pair):
    if pair.ways is loop_remedies.batch or "Batch.step" in (pair.functions or ()):
        pytest.importorskip("mujoco.batch", reason="this MuJoCo has no Batch")
    asked = replace(pair, simulations=2, steps=2)
    _, answer = answers([asked])
    ratio = answer.ratios[asked]
    assert 0 < ratio.low <= ratio.estimate <= ratio.high


@pytest.mark.usefixtures("quick")
def test_a_pair_that_the_model_or_the_release_lacks_is_left_out():
    runge_kutta = mujoco.MjModel.from_xml_string("<mujoco><option integrator='RK4'/></mujoco>")
    asked = [
        RemedyPair(call_ways.inverse),
        RemedyPair(call_ways.functions, ("mj_of_another_release",)),
    ]
    known = RemedyPair(loop_remedies.no_timer)
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
    assert remedy_pairs.measure([other], [RemedyPair(loop_remedies.no_timer)]).ratios == {}


def test_a_model_that_crashes_the_child_costs_only_its_ratios():
    damaged = replace(recorded(), mjb=b"no model")
    measured = remedy_pairs.measure([damaged], [RemedyPair(loop_remedies.no_timer)])
    assert measured == remedy_pairs.MeasuredRatios({})


def test_a_pair_on_threads_is_the_median_launch_with_the_interval_of_all(monkeypatch):
    threaded, alone = (
        RemedyPair(call_ways.rollouts, on_threads=True),
        RemedyPair(call_ways.one_call),
    )
    estimates = iter((0.9, 0.5, 1.4, 0.7, 0.6, 0.8))

    def launch(function, arguments, on_message, *_, **__):
        for question in arguments[1]:
            estimate = next(estimates)
            ratio = remedy_pairs.TimeRatio(estimate, estimate, estimate, 0.0)
            on_message(remedy_pairs.MeasuredRatios({question: ratio}))

    monkeypatch.setattr(remedy_pairs.isolate, "run", launch)
    ratios = remedy_pairs.measure([recorded()], [threaded, alone]).ratios
    ends = {q: (ratio.low, ratio.estimate, ratio.high) for q, ratio in ratios.items()}
    assert ends == {alone: (0.9, 0.9, 0.9), threaded: (0.5, 0.7, 1.4)}
    assert ratios[threaded].saved == 0.0


def test_columns_by_steps_leave_the_state_as_one_call_does():
    """Both leave what the program's own step then begins with."""
    of_model, ends = model(), []
    for way in ways(line_remedies.columns, of_model):
        data = mujoco.MjData(of_model)
        data.qvel[:] = 0.1
        way.run(data)
        ends.append([*data.qpos, *data.qvel])
    assert ends[0] == ends[1]
