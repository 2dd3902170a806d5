"""What lint says of Runge-Kutta in halves, of a shared MjData, and of views that callers write."""

import pytest
from linted import findings

RK4 = '''
XML = """<mujoco><option integrator="RK4"/></mujoco>"""
'''
HALVES = """
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
{line}
for _ in range(9):
    mujoco.mj_step1(model, data)
    mujoco.mj_step2(model, data)
"""


@pytest.mark.parametrize(
    ("xml", "line"),
    [
        (RK4, ""),
        ("", "model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4"),
        ("", "model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_RK4)"),
    ],
)
def test_halves_of_a_runge_kutta_step_are_wrong_results(xml: str, line: str) -> None:
    (finding,) = findings(xml + HALVES.format(line=line), "MJB008")
    assert finding.is_wrong_result


@pytest.mark.parametrize(
    ("xml", "line"),
    [
        ("", ""),
        (RK4.replace("RK4", "implicitfast"), ""),
        (RK4, "model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER"),
        (RK4.replace("XML", "OTHER"), ""),
        (RK4, "model = mujoco.MjModel.from_xml_path('robot.xml')"),
        ("", "other.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4"),
    ],
)
def test_halves_of_other_or_unknown_integrators_are_no_finding(xml: str, line: str) -> None:
    assert findings(xml + HALVES.format(line=line), "MJB008") == []


def test_whole_steps_of_runge_kutta_are_no_finding() -> None:
    text = RK4 + HALVES.format(line="").replace("mj_step1", "mj_step").replace(
        "mj_step2", "mj_step"
    )
    assert findings(text, "MJB008") == []


THREADS = """
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
def given(model, data):
    mujoco.mj_step(model, data)
def outer(i):
    mujoco.mj_step(model, data)
def own(i):
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
def locked(i):
    with lock:
        mujoco.mj_step(model, data)
pool = ThreadPoolExecutor(4)
processes = ProcessPoolExecutor()
one = ThreadPoolExecutor(max_workers=1)
{line}
"""


@pytest.mark.parametrize(
    "line",
    [
        "for i in x: threading.Thread(target=given, args=(model, data)).start()",
        "for i in x: threading.Thread(target=outer, args=(i,)).start()",
        "t = [threading.Thread(target=given, args=(model, data)) for i in x]",
        "for i in x: pool.submit(given, model, data)",
        "futures = [pool.submit(outer, i) for i in x]",
        "list(pool.map(outer, x))",
        "with ThreadPoolExecutor() as p: p.map(outer, x)",
    ],
)
def test_one_mjdata_in_several_threads_is_a_wrong_result(line: str) -> None:
    (finding,) = findings(THREADS.format(line=line), "MJB009")
    assert finding.is_wrong_result


@pytest.mark.parametrize(
    "line",
    [
        "threading.Thread(target=given, args=(model, data)).start()",
        "for d in datas: threading.Thread(target=given, args=(model, d)).start()",
        "for i in x: threading.Thread(target=given, args=(model, mujoco.MjData(model))).start()",
        "for i in x:\n    data = mujoco.MjData(model)\n    pool.submit(given, model, data)",
        "for i in x:\n    t = threading.Thread(target=outer, args=x)\n    t.start()\n    t.join()",
        "for i in x: pool.submit(given, model, data).result()",
        "pool.map(own, x)",
        "pool.map(locked, x)",
        "processes.map(outer, x)",
        "one.map(outer, x)",
        "map(outer, x)",
        "for i in x: pool.submit(unknown, data)",
    ],
)
def test_an_mjdata_of_its_own_or_one_thread_at_a_time_is_no_finding(line: str) -> None:
    assert findings(THREADS.format(line=line), "MJB009") == []


GETTERS = """
class Env:
    def __init__(self): self.data = mujoco.MjData(model)
    def state(self): return {result}
    @property
    def now(self): return {result}
    def step(self, action):
        mujoco.mj_step(model, self.data)
        {method}
env = Env()
data = mujoco.MjData(model)
def look(data): return {plain}
def pair(): return data.time, {plain}
for i in range(9):
    env.step(0)
    {lines}
"""


def messages(*lines: str, result: str = "self.data.qpos", method: str = "pass") -> list[str]:
    text = GETTERS.format(
        result=result, plain=result.replace("self.", ""), method=method, lines="\n    ".join(lines)
    )
    return [finding.message for finding in findings(text, "MJB016")]


@pytest.mark.parametrize(
    "write",
    [
        "obs[0] = 0",
        "obs[2:5] *= 0.1",
        "obs += 0.1",
        "np.clip(obs, -1, 1, out=obs)",
        "np.add(obs, 1, out=obs[:2])",
        "obs[:] = (obs - mean) / deviation",
        "obs.sort()",
        "np.copyto(obs, 0)",
        "np.put_along_axis(obs, indices, 0, axis=0)",
        "operator.setitem(obs, 0, 1)",
        "rng.shuffle(obs)",
    ],
)
@pytest.mark.parametrize(
    "read", ["obs = env.state()", "obs = env.now", "obs = look(data)", "time, obs = pair()"]
)
def test_a_write_into_what_a_getter_returns_is_a_wrong_result(read: str, write: str) -> None:
    (message,) = messages(read, write)
    assert "data.qpos of the simulation" in message
    assert messages(read, write, result="self.data.qpos.copy()") == []
    assert messages(read, write, result="np.array(self.data.qpos)") == []
    assert messages(read, write, result="self.data.ctrl") == [], "an input is written"


@pytest.mark.parametrize("result", ["self.data.qpos[2:]", "self.data.sensordata", "self.data.xpos"])
def test_any_view_of_what_a_step_changes_counts(result: str) -> None:
    assert len(messages("obs = env.state()", "obs[0] = 0", result=result)) == 1


@pytest.mark.parametrize(
    "lines",
    [
        ("obs = env.state().copy()", "obs[0] = 0"),
        ("obs = env.state() - mean", "obs += 1"),
        ("obs = env.state()", "x = obs[0] + 1"),
        ("obs = env.state()", "np.clip(obs, -1, 1, out=clipped)"),
        ("obs = env.state()", "obs = obs - mean"),
        ("obs = env.state()", "obs = obs.copy()", "obs[0] = 0"),
        ("obs = env.state()", "obs[:] = start"),
        ("obs = env.state()", "obs[0] = 0", "mujoco.mj_forward(model, data)"),
        ("obs = env.state()", "obs[0] = 0", "env.set_state(obs)"),
        ("time, obs = pair()", "time += 1"),
        ("obs = unknown.state()", "obs[0] = 0"),
        ("obs = env.qpos()", "obs[0] = 0"),
        ("obs = sorted(env.state())", "obs.sort()"),
    ],
)
def test_copies_reads_and_a_state_that_is_set_are_no_finding(lines: tuple[str, ...]) -> None:
    assert messages(*lines) == []


@pytest.mark.parametrize("name", ["qpos", "state_view", "view"])
def test_a_getter_that_is_named_as_a_view_promises_one(name: str) -> None:
    text = f"""
    class Robot:
        def {name}(self): return self.data.qpos
    robot = Robot()
    q = robot.{name}()
    q[0] = 1
    """
    assert findings(text, "MJB016") == []


def test_a_method_of_the_same_class_is_a_caller_too() -> None:
    (message,) = messages("pass", method="obs = self.state(); obs[0] = 0")
    assert message.startswith("this writes into self.data.qpos of the simulation, which state()")
    text = "class Env:\n    def state(self): return self.data.qpos\n    def reset(self):\n"
    text += "        q = self.state()\n        q[0] = 0\n"
    assert findings(text, "MJB016") == []


def test_an_mjdata_of_one_call_is_not_the_simulation() -> None:
    text = """
    def start():
        data = mujoco.MjData(model)
        return data.qpos
    q = start()
    q[0] = 1
    """
    assert findings(text, "MJB016") == []


def test_a_property_that_is_stored_is_a_stored_view() -> None:
    text = GETTERS.format(
        result="self.data.qpos", plain="data.qpos", method="pass", lines="log.append({})"
    )
    (finding,) = findings(text.format("env.now"), "MJB001")
    assert finding.line == 9
    assert findings(text.format("env.now.copy()"), "MJB001") == []
    assert findings(text.format("env.now); env.now.fill(0"), "MJB001") == []
