"""What lint says of objects that every iteration creates, and where that has a reason."""

import pytest
from linted import findings, places

SETUP = """
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
def advance(data, plan):
    for ctrl in plan:
        data.ctrl[:] = ctrl
        mujoco.mj_step(model, data)
    return data.qpos[0]
"""


@pytest.mark.parametrize(
    "text",
    [
        "costs = [advance(copy.deepcopy(data), plan) for plan in plans]",
        "for plan in plans:\n    advance(copy.copy(data), plan)",
        "for plan in plans:\n    scratch = mujoco.MjData(model)\n    advance(scratch, plan)",
        "for plan in plans:\n    last = copy.copy(data)\n    advance(last, plan)\n"
        "    kept.append(last.qpos.copy())\n    table[0] = last.qvel\n    log.append(last.qpos[0])",
        "while True:\n    before = copy.copy(data)\n    mujoco.mj_step(model, data)\n"
        "    moved = data.qpos - before.qpos",
        "def cost(plan):\n    scratch = mujoco.MjData(model)\n    return advance(scratch, plan)\n"
        "for plan in plans:\n    cost(plan)",
    ],
)
def test_a_new_mjdata_in_every_iteration_is_found(text: str) -> None:
    assert len(findings(SETUP + text, "MJB010")) == 1


@pytest.mark.parametrize(
    "text",
    [
        "for plan in plans:\n    kept.append(copy.copy(data))\n    advance(data, plan)",
        "for plan in plans:\n    advance(data, plan)\n    last = copy.copy(data)\n"
        "    kept.append(last)",
        "for plan in plans:\n    advance(data, plan)\n    nodes[plan] = Node(copy.copy(data))",
        "for plan in plans:\n    if advance(data, plan) > best:\n        best = copy.copy(data)",
        "datas = [mujoco.MjData(model) for _ in range(9)]",
        "for plan in plans:\n    last = copy.copy(data)\n    advance(last, plan)\n"
        "    kept.append(last.qpos)",
        "for plan in plans:\n    last = copy.copy(data)\n    advance(last, plan)\n"
        "    end = last.body('hand').xpos[:2]\n    kept.append(end)",
        "def end(data, plan):\n    advance(data, plan)\n    return data.time, data.xpos[1]\n"
        "ends = [end(copy.copy(data), plan) for plan in plans]",
        "for plan in plans:\n    values = copy.copy(plan)\n    advance(data, values)",
        "for m in models:\n    other = mujoco.MjData(m)\n    advance(other, plan)",
        "def cost(model, plan):\n    scratch = mujoco.MjData(model)\n    advance(scratch, plan)\n"
        "for m in models:\n    cost(m, plan)",
        "scratch = None\nfor plan in plans:\n    if scratch is None:\n"
        "        scratch = mujoco.MjData(model)\n    advance(scratch, plan)",
        "for plan in plans:\n    scratch = mujoco.MjData(model)\n    unknown(scratch)\n"
        "    advance(scratch, plan)",
    ],
)
def test_a_copy_that_is_kept_or_that_has_a_reason_is_no_finding(text: str) -> None:
    assert findings(SETUP + text, "MJB010") == []


EPISODES = """
def scene(mass):
    return mujoco.MjModel.from_xml_string(XML.format(mass=mass))
spec = mujoco.MjSpec.from_file("robot.xml")
for episode in range(9):
    {model}
    data = mujoco.MjData(model)
    for _ in range(9):
        mujoco.mj_step(model, data)
"""


@pytest.mark.parametrize(
    "line",
    [
        "model = mujoco.MjModel.from_xml_path('robot.xml')",
        "model = scene(rng.uniform())",
        "model = spec.compile()",
        "model, data = spec.recompile(model, data)",
        "physics = mjcf.Physics.from_mjcf_model(root)",
        "if randomize: model = mujoco.MjModel.from_xml_path('robot.xml')",
    ],
)
def test_a_model_that_is_compiled_again_is_found(line: str) -> None:
    (finding,) = findings(EPISODES.format(model=line), "MJB011")
    assert finding.instead == ()


@pytest.mark.parametrize(
    "line",
    [
        "model = mujoco.MjModel.from_xml_path(files[episode])",
        "model = scene(episode)",
        "mass = 2 * episode; model = scene(mass)",
        "spec.body('box').mass = episode; model = spec.compile()",
        "pattern = re.compile('x')",
        "if model is None: model = mujoco.MjModel.from_xml_path('robot.xml')",
        "if episode == 3: model = mujoco.MjModel.from_xml_path('robot.xml')",
        "models.append(mujoco.MjModel.from_xml_path('robot.xml'))",
        "make = lambda: mujoco.MjModel.from_xml_path('robot.xml')",
    ],
)
def test_another_model_or_one_that_is_kept_is_no_finding(line: str) -> None:
    assert findings(EPISODES.format(model=line), "MJB011") == []


def test_a_function_that_loads_once_is_no_finding() -> None:
    cached = "@functools.cache\ndef scene():\n    return mujoco.MjModel.from_xml_path('a.xml')\n"
    early = (
        "def scene():\n    if known:\n        return known[0]\n"
        "    return mujoco.MjModel.from_xml_path('a.xml')\n"
    )
    loop = "for _ in range(9):\n    model = scene()\n    mujoco.mj_step(model, data)\n"
    assert findings(cached + loop, "MJB011") == []
    assert findings(early + loop, "MJB011") == []
    assert len(findings(early.replace("if known", "while known") + loop)) == 0


def test_a_model_that_follows_from_the_state_is_no_finding() -> None:
    text = """
    def fitted(model, data):
        spec = mujoco.MjSpec()
        spec.worldbody.add_geom(size=data.xpos[1])
        return spec.compile()
    for _ in range(9):
        mujoco.mj_step(model, data)
        fitted(model, data)
    """
    assert findings(text, "MJB011") == []


def test_a_loop_that_resets_compiles_anew_as_well() -> None:
    text = """
    while True:
        physics = mjcf.Physics.from_xml_string(XML)
        physics.reset()
    """
    assert len(findings(text, "MJB011")) == 1


RENDERING = """
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
renderer = None
for i in range(9):
    mujoco.mj_step(model, data)
    {line}
"""


@pytest.mark.parametrize(
    "line",
    [
        "renderer = mujoco.Renderer(model, 240, 320)",
        "if i % 3 == 0: renderer = mujoco.Renderer(model)",
        "with mujoco.Renderer(model) as renderer: renderer.update_scene(data)",
    ],
)
def test_a_renderer_for_every_frame_is_found(line: str) -> None:
    assert len(findings(RENDERING.format(line=line), "MJB012")) == 1


def test_a_renderer_is_known_under_another_name() -> None:
    text = "from mujoco import Renderer as Camera\n" + RENDERING.format(line="Camera(model)")
    assert [f.code for f in findings(text, "MJB012")] == ["MJB012"]


@pytest.mark.parametrize(
    "line",
    [
        "if renderer is None: renderer = mujoco.Renderer(model)",
        "if i == 3: renderer = mujoco.Renderer(model)",
        "renderer = renderer or mujoco.Renderer(model)",
        "renderer = mujoco.Renderer(model, *sizes[i])",
        "renderer = Renderer(model)",
        "model = load(i); renderer = mujoco.Renderer(model)",
        "renderer = mujoco.Renderer(model); break",
    ],
)
def test_a_renderer_that_is_created_once_is_no_finding(line: str) -> None:
    assert findings(RENDERING.format(line=line), "MJB012") == []


JIT = "import jax\nfrom functools import partial\n"


@pytest.mark.parametrize(
    "text",
    [
        "for _ in range(9):\n    move = jax.jit(lambda d: mjx.step(mx, d))\n    d = move(d)",
        "for _ in range(9):\n    d = jax.jit(partial(move, mx))(d)",
        "for gain in gains:\n    move = jax.jit(lambda d: f(d, -gain * d))\n    d = move(d)",
        "for gain in gains:\n    move = jax.jit(lambda d, g=gain: g * d)\n    d = move(d)",
        "for _ in range(9):\n    for f in moves:\n        d = jax.jit(lambda d: g(d))(d)",
        "while True:\n    @jax.jit\n    def move(d):\n        return d + 1\n    d = move(d)",
        "for _ in range(9):\n    def move(d):\n        return d + 1\n    d = jax.jit(move)(d)",
        "while x:\n    @partial(jax.jit, inline=True)\n    def f(d):\n        return d\n    f(1)",
    ],
)
def test_a_function_that_is_compiled_in_every_iteration_is_found(text: str) -> None:
    assert len(findings(JIT + text, "MJB013")) == 1


@pytest.mark.parametrize(
    "text",
    [
        "move = jax.jit(lambda d: d + 1)\nfor _ in range(9):\n    d = move(d)",
        "for _ in range(9):\n    d = jax.jit(move)(d)",
        "for f in functions:\n    d = jax.jit(lambda d: f(d))(d)",
        "for f in functions:\n    move = jax.jit(lambda d, f=f: f(d))\n    d = move(d)",
        "for f in functions:\n    move = jax.jit(lambda d, g=f: g(d))\n    d = move(d)",
        "for model in models:\n    move = jax.jit(lambda d: mjx.step(model, d))\n    d = move(d)",
        "for n in sizes:\n    d = jax.jit(lambda d: scan(f, d, length=n))(d)",
        "moves = [jax.jit(partial(f, gain)) for gain in gains]",
        "for name in names:\n    moves[name] = jax.jit(partial(f, name))",
        "while x:\n    if move is None:\n        move = jax.jit(lambda d: d)\n    move(d)",
        "for _ in range(9):\n    d = other.jit(lambda d: d)(d)",
    ],
)
def test_a_function_that_is_compiled_once_or_differs_is_no_finding(text: str) -> None:
    assert findings(JIT + text, "MJB013") == []


ROLLOUT = """
from mujoco import rollout
model = mujoco.MjModel.from_xml_string(XML)
datas = [mujoco.MjData(model) for _ in range(4)]
data = mujoco.MjData(model)
for _ in range(9):
    {call}
"""


def test_rollout_with_threads_of_its_own_is_found_in_a_loop() -> None:
    call = "states, sensors = rollout.rollout(model, datas, starts, plans)"
    assert places(ROLLOUT.format(call=call)) == [("MJB014", call)]


@pytest.mark.parametrize(
    "call",
    [
        "rollout.rollout(model, datas, starts, plans, persistent_pool=True)",
        "rollout.rollout(model, datas, starts, plans, **options)",
        "rollout.rollout(model, data, starts, plans)",
        "rollout.rollout(model, [data], starts, plans)",
        "pool.rollout(model, datas, starts, plans)",
        "with pytest.raises(ValueError): rollout.rollout(model, datas, None)",
    ],
)
def test_rollout_without_threads_or_with_a_pool_is_no_finding(call: str) -> None:
    assert findings(ROLLOUT.format(call=call), "MJB014") == []


@pytest.mark.parametrize(
    "text",
    [
        "def swing(gain):\n    move = jax.jit(lambda d: f(d, -gain * d))\n    return move(start)\n"
        "for gain in gains:\n    swing(gain)",
        "def reset():\n    @jax.jit\n    def move(d): return d + 1\n    return move(start)\n"
        "for _ in range(9):\n    reset()",
    ],
)
def test_a_function_that_the_loop_calls_compiles_in_every_iteration(text: str) -> None:
    (finding,) = findings(JIT + text, "MJB013")
    assert finding.message.endswith("calls this in every iteration")


@pytest.mark.parametrize(
    "text",
    [
        "def swing(f):\n    move = jax.jit(lambda d: f(d))\n    return move(start)\n"
        "for f in functions:\n    swing(f)",
        "def run(model):\n    mx = mjx.put_model(model)\n"
        "    move = jax.jit(lambda d: mjx.step(mx, d))\n    return move(start)\n"
        "for model in models:\n    run(model)",
        "def run():\n    move = jax.jit(lambda d: d + 1)\n    return move(start)\nrun()",
        "def moves():\n    return jax.jit(lambda d: d + 1)\nfor _ in range(9):\n    moves()",
    ],
)
def test_a_function_that_differs_with_each_call_is_no_finding(text: str) -> None:
    assert findings(JIT + text, "MJB013") == []


DEVICE = """
import jax
from mujoco import mjx
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
mx = mjx.put_model(model)
step = jax.jit(mjx.step)
def reset():
    mujoco.mj_resetData(model, data)
    return mjx.put_data(model, data)
for episode in range(episodes):
    {line}
    for _ in range(20):
        dx = step(mx, dx)
"""


@pytest.mark.parametrize(
    "line",
    [
        "dx = reset()",
        "dx = mjx.put_data(model, data)",
        "mx = mjx.put_model(model)",
        "mujoco.mj_resetData(model, data); dx = mjx.put_data(model, data, device=gpu)",
    ],
)
def test_what_goes_to_the_device_in_every_episode_is_found(line: str) -> None:
    assert len(findings(DEVICE.format(line=line), "MJB022")) == 1


@pytest.mark.parametrize(
    "line",
    [
        "dx = first.replace(qpos=starts[episode])",
        "if dx is None: dx = mjx.put_data(model, data)",
        "dx = mjx.put_data(models[episode], data)",
        "model.geom_friction[:, 0] = 1 + episode; mx = mjx.put_model(model)",
        "model.body('hand').mass[:] = 1; mx = mjx.put_model(model)",
        "randomize(model); mx = mjx.put_model(model)",
        "model = mujoco.MjModel.from_xml_string(XML); mx = mjx.put_model(model)",
        "dx = mjx.put_data(model, data, impl=ways[episode])",
    ],
)
def test_another_model_on_the_device_is_no_finding(line: str) -> None:
    assert findings(DEVICE.format(line=line), "MJB022") == []


def test_a_loop_that_does_not_step_on_the_device_is_no_finding() -> None:
    text = "from mujoco import mjx\nfor data in datas:\n    batch.append(mjx.put_data(model, data))"
    assert findings(text, "MJB022") == []
