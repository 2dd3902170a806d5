"""Simulations that begin anew: plans that rollout steps at once, and steps that settle a model."""

import pytest
from linted import findings, places

PLANS = """
def score(model, data, start, plan):
    mujoco.mj_setState(model, data, start, SPEC)
    cost = 0.0
    for action in plan:
        data.ctrl[:] = action
        mujoco.mj_step(model, data)
        cost += abs(data.qpos[1])
    return cost

def main():
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    for _ in range(rounds):
        plans = mean + rng.normal(size=(64, 100, 1))
        costs = [score(model, data, start, plan) for plan in plans]
        mean = plans[np.argsort(costs)[:8]].mean(axis=0)
"""
CALL = "costs = [score(model, data, start, plan) for plan in plans]"


def test_plans_that_a_comprehension_scores_are_found_at_it() -> None:
    (finding,) = findings(PLANS, "MJB006")
    assert finding.instead == ("rollout",)
    assert "known before the steps" in finding.message
    assert places(PLANS, "MJB006") == [("MJB006", CALL)]


@pytest.mark.parametrize(
    "loop",
    [
        "for i, plan in enumerate(plans): costs[i] = score(model, data, start, plan)",
        "for plan in plans: costs.append(score(model, data, start, plan))",
    ],
)
def test_plans_that_a_loop_scores_and_stores_are_found(loop: str) -> None:
    assert places(PLANS.replace(CALL, loop), "MJB006") == [("MJB006", loop)]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("data.ctrl[:] = action", "data.ctrl[:] = action - data.qpos[1]"),
        ("data.ctrl[:] = action", "data.ctrl[:] = action * cost"),
        ("data.ctrl[:] = action", "data.ctrl[:] = policy(data)"),
        ("data.ctrl[:] = action", "data.ctrl[:] = gains"),
        ("data.ctrl[:] = action", "data.ctrl[:] = action; data.qpos[0] = 0.0"),
        ("data.ctrl[:] = action", "data.ctrl[:] = action; model.opt.timestep = 0.1"),
        ("cost += abs(data.qpos[1])", "cost += data.xpos[1, 2]"),
        ("cost += abs(data.qpos[1])", "cost += data.body('tip').xpos[2]"),
        ("cost += abs(data.qpos[1])", "cost += cost_of(model, data)"),
        ("cost += abs(data.qpos[1])", "if data.qpos[1] > 1: break"),
        ("    mujoco.mj_setState(model, data, start, SPEC)\n", ""),
        (CALL, "for plan in plans: start = score(model, data, start, plan)"),
        (CALL, "score(model, data, start, plans[0])"),
    ],
)
def test_what_rollout_cannot_step_at_once_is_no_finding(old: str, new: str) -> None:
    text = PLANS.replace(old, new)
    assert text != PLANS
    assert findings(text, "MJB006") == []


METHOD = """
class Env:
    def __init__(self):
        self.model = mujoco.MjModel.from_xml_string(XML)
        self.data = mujoco.MjData(self.model)
        self.count = 500

    def reset(self):
        mujoco.mj_resetData(self.model, self.data)
        for _ in range(500):
            mujoco.mj_step(self.model, self.data)
        return self.data.qpos.copy()

    def step(self, action):
        self.data.ctrl[:] = action
        mujoco.mj_step(self.model, self.data)
"""
LOOP = """
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
for episode in range(100):
    mujoco.mj_resetData(model, data)
    mujoco.mj_step(model, data, 500)
    data.ctrl[:] = rng.normal(size=model.nu)
    for _ in range(50):
        mujoco.mj_step(model, data)
"""
STEPS = "for _ in range(500):"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("", ""),
        ("range(500)", "range(self.count)"),
        ("def reset(", "def reset_model("),
        ("mj_resetData(self.model, self.data)", "mj_resetDataKeyframe(self.model, self.data, 0)"),
    ],
)
def test_steps_that_settle_a_model_at_each_reset_are_found(old: str, new: str) -> None:
    ((code, line),) = places(METHOD.replace(old, new), "MJB023")
    assert code == "MJB023"
    assert line.startswith("for _ in range(")


def test_many_steps_of_one_call_settle_as_well() -> None:
    line = "mujoco.mj_step(model, data, 500)"
    assert places(LOOP, "MJB023") == [("MJB023", line)]
    by_name = LOOP.replace(", 500)", ", nstep=500)")
    assert len(findings(by_name, "MJB023")) == 1


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("500", "9"),
        ("range(500)", "range(rng.integers(500))"),
        (STEPS, "self.data.qpos[0] = rng.normal()\n        " + STEPS),
        (STEPS, "self.place_objects()\n        " + STEPS),
        (STEPS, "self.model.geom_friction[0] = rng.normal()\n        " + STEPS),
        ("mujoco.mj_step(self.model, self.data)", "mujoco.mj_step(self.model, self.other)"),
        ("mujoco.mj_step(self.model, self.data)", "self.data.ctrl[:] = gravity(self.data)"),
        ("def reset(", "def settle("),
        ("def step(", "def other(self): pass\n\nclass Other:\n    def step("),
        ("def reset(self):", "def reset(self):\n        self.model = load()"),
        ("self.count = 500", "mujoco.set_mjcb_control(control)"),
        ("mj_resetData(self.model, self.data)", "mj_resetDataKeyframe(self.model, self.data, key)"),
    ],
)
def test_what_may_differ_from_reset_to_reset_is_no_finding(old: str, new: str) -> None:
    text = METHOD.replace(old, new)
    assert text != METHOD
    assert findings(text, "MJB023") == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("for episode in range(100):", "if True:"),
        ("for episode in range(100):", "for model in models:"),
        ("    mujoco.mj_resetData", "    model = load(episode)\n    mujoco.mj_resetData"),
        (", 500)", ", episode)"),
        (", 500)", ", 5)"),
        ("    for _ in range(50):\n        mujoco.mj_step(model, data)", "    log()"),
    ],
)
def test_what_a_loop_settles_once_or_otherwise_is_no_finding(old: str, new: str) -> None:
    assert findings(LOOP.replace(old, new), "MJB023") == []
