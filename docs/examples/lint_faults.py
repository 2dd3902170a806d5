"""Show that what each rule of `mjbench lint` reports is a fault.

    python lint_faults.py [CODE …]

Needs mujoco and NumPy only, jax for MJB013, a screen for MJB021 and mujoco-mjx for MJB022. Each
line has the fault first, then what to write instead.
"""

import copy
import subprocess
import sys
import threading
import time
import timeit

import mujoco
import numpy as np

PENDULUM = """
<mujoco>
  <worldbody>
    <body name="arm">
      <joint name="hinge" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.05"/>
    </body>
  </worldbody>
</mujoco>
"""


# The arguments with which the program lets threads share an MjData, and opens a viewer.
SHARE, SYNC = "share-data", "sync"

# Boxes that fall on a plane, one of them with a site.
BOXES = """
<mujoco>
  <option integrator="{integrator}"/>
  <worldbody>
    <geom name="plane" type="plane" size="5 5 0.1"/>
    <body name="box" pos="0 0 0.3">
      <freejoint/>
      <geom type="box" size="0.1 0.1 0.1"/>
      <site name="corner" pos="0.1 0.1 0.1"/>
    </body>
    <body pos="0.05 0 0.6"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
    <body pos="0 0.05 0.9"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
  </worldbody>
</mujoco>
"""


def stored_view() -> str:
    """MJB001: all entries of a list of views are the last state; copies are one state each."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    views, copies = [], []
    for _ in range(100):
        mujoco.mj_step(model, data)
        views.append(data.qpos)
        copies.append(data.qpos.copy())
    return f"different states in 100 steps: {_distinct(views)} views, {_distinct(copies)} copies"


def named_access() -> str:
    """MJB002: a name is looked up in every step; its object can be looked up once."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    joint = data.joint("hinge")
    assert data.joint("hinge").qpos.ctypes.data == joint.qpos.ctypes.data
    inside = _ns(lambda: data.joint("hinge").qpos)
    hoisted = _ns(lambda: joint.qpos)
    return f"ns an access: {inside:.0f} by name, {hoisted:.0f} of an object from before the loop"


def new_array() -> str:
    """MJB003: an array is created in every step; one can be written again, slice by slice."""
    qpos, qvel, row = np.arange(30.0), np.arange(30.0), np.empty(60)

    def in_place() -> None:
        row[:30], row[30:] = qpos, qvel

    in_place()
    assert np.array_equal(row, np.hstack([qpos, qvel]))
    stacked = _ns(lambda: np.hstack([qpos, qvel]))
    joined = _ns(lambda: np.concatenate([qpos, qvel]))
    slices = _ns(in_place)
    return f"ns a row: {stacked:.0f} hstack, {joined:.0f} concatenate, {slices:.0f} into slices"


def new_data() -> str:
    """MJB005: an episode creates an MjData; mj_resetData leaves the same state."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = 1, 2
    mujoco.mj_resetData(model, data)
    fresh = mujoco.MjData(model)
    assert all(np.array_equal(getattr(data, f), getattr(fresh, f)) for f in ("qpos", "qvel", "act"))
    new = _ns(lambda: mujoco.MjData(model), 200)
    reset = _ns(lambda: mujoco.mj_resetData(model, data), 200)
    return f"ns an episode: {new:.0f} for MjData(model), {reset:.0f} for mj_resetData"


def one_after_another() -> str:
    """MJB006: simulations run in turn; rollout steps them together, to the same states."""
    try:
        from mujoco import rollout

        rollout.Rollout  # noqa: B018
    except (ImportError, AttributeError):
        return f"the rollout of MuJoCo {mujoco.__version__} has no threads"
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    starts = np.zeros((64, mujoco.mj_stateSize(model, full)))
    starts[:, 1] = np.linspace(-1, 1, 64)  # qpos, after time

    def loop() -> np.ndarray:
        ends = np.empty((64, 2))
        for start, end in zip(starts, ends, strict=True):
            mujoco.mj_resetData(model, data)
            mujoco.mj_setState(model, data, start, full)
            for _ in range(100):
                mujoco.mj_step(model, data)
            end[:] = data.qpos[0], data.qvel[0]
        return ends

    def together() -> np.ndarray:
        states, _ = rollout.rollout(model, data, starts, nstep=100)
        return np.asarray(states)[:, -1, 1:3]

    assert np.array_equal(loop(), together())
    one, all_ = _ns(loop, 1), _ns(together, 1)
    return f"ms for 64 runs of 100 steps: {one / 1e6:.1f} in a loop, {all_ / 1e6:.1f} by rollout"


def forward_after_step() -> str:
    """MJB007: mj_forward computes a step's worth; mj_kinematics computes the same positions."""
    model = mujoco.MjModel.from_xml_string(BOXES.format(integrator="Euler"))
    data = mujoco.MjData(model)
    for _ in range(300):
        mujoco.mj_step(model, data)
        other = copy.copy(data)
        mujoco.mj_forward(model, data)
        mujoco.mj_kinematics(model, other)
        for field in ("xpos", "xmat", "geom_xpos", "site_xpos"):
            assert np.array_equal(getattr(data, field), getattr(other, field)), field
    forward = _ns(lambda: mujoco.mj_forward(model, data), 200)
    positions = _ns(lambda: mujoco.mj_kinematics(model, data), 200)
    return f"ns after a step: {forward:.0f} mj_forward, {positions:.0f} mj_kinematics"


def halves_of_runge_kutta() -> str:
    """MJB008: with RK4, two halves of a step are one of Euler."""
    ends = {}
    for integrator in ("RK4", "Euler"):
        model = mujoco.MjModel.from_xml_string(PENDULUM)
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
        for name in ("halves", "whole"):
            data = mujoco.MjData(model)
            for _ in range(500):
                if name == "halves":
                    mujoco.mj_step1(model, data)
                    mujoco.mj_step2(model, data)
                else:
                    mujoco.mj_step(model, data)
            ends[integrator, name] = data.qpos[0]
    assert ends["RK4", "halves"] == ends["Euler", "whole"] != ends["RK4", "whole"]
    halves, whole = ends["RK4", "halves"], ends["RK4", "whole"]
    return f"angle after 500 steps of RK4: {halves:.6f} by halves, as by Euler, {whole:.6f} whole"


def shared_data() -> str:
    """MJB009: threads that step one MjData crash or compute nonsense; each needs its own."""
    model = mujoco.MjModel.from_xml_string(BOXES.format(integrator="Euler"))
    alone, *own = (mujoco.MjData(model) for _ in range(5))
    _step_in_threads(model, [alone])
    _step_in_threads(model, own)
    assert all(np.array_equal(data.qpos, alone.qpos) for data in own)
    command = [sys.executable, __file__, SHARE]  # a process, which may crash
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    ends = {data.qpos.tobytes() for data in own}
    shared = f"crash ({done.returncode})" if done.returncode else done.stdout.strip()
    return f"4 threads: {shared} with one MjData, {len(ends)} state with four"


def _step_in_threads(model: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
    def work(data: mujoco.MjData) -> None:
        for _ in range(2000):
            mujoco.mj_step(model, data)

    threads = [threading.Thread(target=work, args=(data,)) for data in datas]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def _share_data() -> str:
    """Let threads step one MjData, and return how far its state is from that of as many steps."""
    model = mujoco.MjModel.from_xml_string(BOXES.format(integrator="Euler"))
    shared, right = mujoco.MjData(model), mujoco.MjData(model)
    _step_in_threads(model, [shared] * 4)
    for _ in range(4):
        _step_in_threads(model, [right])
    return f"{np.abs(shared.qpos - right.qpos).max():g} from the right qpos"


def copied_data() -> str:
    """MJB010: every sample gets a new MjData; one can take each start."""
    model = mujoco.MjModel.from_xml_string(BOXES.format(integrator="Euler"))
    data, scratch = mujoco.MjData(model), mujoco.MjData(model)
    mujoco.mj_step(model, data, 200)

    def end(sample: mujoco.MjData) -> bytes:
        mujoco.mj_step(model, sample, 20)
        return bytes(sample.qpos.tobytes())

    integration = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(model, integration))

    def take() -> None:
        mujoco.mj_getState(model, data, state, integration)
        mujoco.mj_setState(model, scratch, state, integration)

    take()
    assert end(copy.deepcopy(data)) == end(scratch)
    copies, into = _ns(lambda: copy.deepcopy(data), 200), _ns(take, 200)
    return f"ns a sample: {copies:.0f} for copy.deepcopy(data), {into:.0f} for mj_setState"


def compiled_model() -> str:
    """MJB011: every episode compiles a model; values of the compiled one can be changed."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    model.opt.timestep = 0.001
    text = PENDULUM.replace("<mujoco>", '<mujoco><option timestep="0.001"/>')
    ends = []
    for each in (model, mujoco.MjModel.from_xml_string(text)):
        data = mujoco.MjData(each)
        mujoco.mj_step(each, data, 100)
        ends.append(data.qpos[0])
    assert ends[0] == ends[1]

    def change() -> None:
        model.opt.timestep = 0.001

    compiling = _ns(lambda: mujoco.MjModel.from_xml_string(text), 50)
    return f"ns an episode: {compiling:.0f} to compile, {_ns(change):.0f} to change a value"


def new_renderer() -> str:
    """MJB012: every frame creates a Renderer; one from before draws the same."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)

    def draw(renderer: mujoco.Renderer) -> np.ndarray:
        renderer.update_scene(data)
        return np.asarray(renderer.render())

    def close(renderer: mujoco.Renderer) -> None:
        if hasattr(renderer, "close"):  # from MuJoCo 3 on
            renderer.close()

    def anew() -> np.ndarray:
        renderer = mujoco.Renderer(model, 120, 160)
        pixels = draw(renderer)
        close(renderer)
        return pixels

    try:
        first = anew()
    except Exception as error:  # what is raised depends on how OpenGL is missing
        return f"needs OpenGL, for example by MUJOCO_GL=egl: {error}"
    once = mujoco.Renderer(model, 120, 160)
    assert np.array_equal(first, draw(once))
    news, frames = _ns(anew, 5), _ns(lambda: draw(once), 5)
    close(once)
    return f"ms a frame: {news / 1e6:.2f} with a new Renderer, {frames / 1e6:.2f} with one"


def new_jitted_function() -> str:
    """MJB013: a lambda is compiled in every iteration; a function that gets the gain, once."""
    try:
        import jax
    except ImportError:
        return "needs jax: pip install jax"
    traces = {"lambda": 0, "function": 0}

    def move(x, gain, name: str):
        traces[name] += 1  # runs when JAX traces, not when it executes
        return x - gain * x

    jitted = jax.jit(lambda x, gain: move(x, gain, "function"))
    for gain in (0.5, 1.0, 2.0, 4.0):
        anew = jax.jit(lambda x, gain=gain: move(x, gain, "lambda"))(3.0)
        assert anew == jitted(3.0, gain)
    new, one = traces["lambda"], traces["function"]
    return f"compilations for 4 gains: {new} of new lambdas, {one} of one function"


def new_rollout_pool() -> str:
    """MJB014: every call of rollout starts threads; a Rollout keeps them."""
    try:
        from mujoco import rollout

        rollout.Rollout  # noqa: B018
    except (ImportError, AttributeError):
        return f"the rollout of MuJoCo {mujoco.__version__} has no threads"
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    datas = [mujoco.MjData(model) for _ in range(4)]
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    starts = np.zeros((64, mujoco.mj_stateSize(model, full)))
    starts[:, 1] = np.linspace(-1, 1, 64)
    with rollout.Rollout(nthread=len(datas)) as pool:
        anew, _ = rollout.rollout(model, datas, starts, nstep=5)
        kept, _ = pool.rollout(model, datas, starts, nstep=5)
        assert np.array_equal(anew, kept)
        calls = _ns(lambda: rollout.rollout(model, datas, starts, nstep=5), 50)
        one = _ns(lambda: pool.rollout(model, datas, starts, nstep=5), 50)
    return f"ns for 64 runs of 5 steps: {calls:.0f} with new threads, {one:.0f} with kept ones"


def row_of_two_moments() -> str:
    """MJB015: beside the height in qpos, xpos is that of the state before the step."""
    model = mujoco.MjModel.from_xml_string(BOXES.format(integrator="Euler"))
    heights: dict[str, list[float]] = {"after": [], "again": [], "before": []}
    ends = set()
    for way, differences in heights.items():
        data = mujoco.MjData(model)
        for _ in range(100):
            height = data.qpos[2]
            mujoco.mj_step(model, data)
            if way != "before":
                height = data.qpos[2]
            if way == "again":
                mujoco.mj_kinematics(model, data)
            differences.append(abs(height - data.body("box").xpos[2]))
        ends.add(data.qpos.tobytes())
    assert len(ends) == 1
    largest = {way: max(differences) for way, differences in heights.items()}
    return (
        f"height in qpos and xpos: {1000 * largest['after']:.1f} mm apart after a step,"
        f" {1000 * largest['again']:g} with mj_kinematics,"
        f" {1000 * largest['before']:g} with qpos of before the step"
    )


def written_view() -> str:
    """MJB016: an observation that is a view is scaled in place, and moves the box."""
    model = mujoco.MjModel.from_xml_string(BOXES.format(integrator="Euler"))
    heights = {}
    for way in ("view", "copy"):
        data = mujoco.MjData(model)

        def state(data: mujoco.MjData = data) -> np.ndarray:
            return data.qpos

        for _ in range(10):
            mujoco.mj_step(model, data)
            observation = state() if way == "view" else state().copy()
            observation *= 2
        heights[way] = data.qpos[2]
    view, copied = heights["view"], heights["copy"]
    return f"height after 10 steps: {view:.1f} with scaled views, {copied:.1f} with scaled copies"


def steps_in_a_row() -> str:
    """MJB017: an action is held for several steps, one call each; one call takes them all."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    one, other = mujoco.MjData(model), mujoco.MjData(model)

    def in_a_loop() -> None:
        for _ in range(10):
            mujoco.mj_step(model, one)

    def in_one_call() -> None:
        mujoco.mj_step(model, other, 10)

    in_a_loop(), in_one_call()
    assert one.qpos[0] == other.qpos[0] != 0 and one.qvel[0] == other.qvel[0]
    calls, one_call = _ns(in_a_loop, 500), _ns(in_one_call, 500)
    return f"ns for 10 steps: {calls:.0f} in ten calls, {one_call:.0f} in one"


def growing_array() -> str:
    """MJB018: an array is copied with each row that it gets; one may have all rows beforehand."""
    qpos, steps = np.arange(30.0), 2000

    def joined() -> np.ndarray:
        log = np.empty((0, 30))
        for _ in range(steps):
            log = np.vstack([log, qpos])
        return log

    def allocated() -> np.ndarray:
        log = np.empty((steps, 30))
        for step in range(steps):
            log[step] = qpos
        return log

    assert np.array_equal(joined(), allocated())
    copies, rows = _ns(joined, 1) / steps, _ns(allocated, 1) / steps
    return f"ns a step of {steps}: {copies:.0f} by vstack, {rows:.0f} into allocated rows"


def contact_scan() -> str:
    """MJB019: contacts are taken one by one, by name; arrays hold the ids and forces of all."""
    model = mujoco.MjModel.from_xml_string(BOXES.format(integrator="Euler"))
    model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    data, force, plane = mujoco.MjData(model), np.zeros(6), model.geom("plane").id
    mujoco.mj_step(model, data, 500)

    def one_by_one() -> float:
        total = 0.0
        for i in range(data.ncon):
            contact = data.contact[i]
            if "plane" in (model.geom(contact.geom1).name, model.geom(contact.geom2).name):
                mujoco.mj_contactForce(model, data, i, force)
                total += force[0]
        return total

    def by_arrays() -> float:
        contact = data.contact
        of_plane = (contact.geom == plane).any(axis=1) & (contact.efc_address >= 0)
        return float(data.efc_force[contact.efc_address[of_plane]].sum())

    assert data.ncon and np.isclose(one_by_one(), by_arrays())
    each, arrays = _ns(one_by_one, 500), _ns(by_arrays, 500)
    iterated = _ns(lambda: [contact.dist for contact in data.contact], 500)
    return (
        f"ns for {data.ncon} contacts: {each:.0f} by name, {iterated:.0f} to iterate over them,"
        f" {arrays:.0f} as arrays"
    )


def finite_difference() -> str:
    """MJB020: a step for each column of the linearized dynamics; one call computes them all."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data, eps = mujoco.MjData(model), 1e-6
    mujoco.mj_step(model, data, 50)
    integration = mujoco.mjtState.mjSTATE_INTEGRATION
    start = np.empty(mujoco.mj_stateSize(model, integration))
    mujoco.mj_getState(model, data, start, integration)

    def step(field: str, size: float) -> np.ndarray:
        mujoco.mj_setState(model, data, start, integration)
        getattr(data, field)[0] += size
        mujoco.mj_step(model, data)
        return np.concatenate([data.qpos, data.qvel])

    def by_steps() -> np.ndarray:
        unchanged = step("qpos", 0)
        columns = [(step(field, eps) - unchanged) / eps for field in ("qpos", "qvel")]
        mujoco.mj_setState(model, data, start, integration)
        return np.transpose(columns)

    def in_one_call() -> np.ndarray:
        matrix = np.empty((2, 2))
        mujoco.mjd_transitionFD(model, data, eps, False, matrix, None, None, None)
        return matrix

    assert np.allclose(by_steps(), in_one_call())
    steps, one_call = _ns(by_steps, 500), _ns(in_one_call, 500)
    return f"ns for two columns: {steps:.0f} by steps, {one_call:.0f} by mjd_transitionFD"


def synced_viewer() -> str:
    """MJB021: the viewer gets every step; a screen shows 60 frames a second."""
    command = [sys.executable, __file__, SYNC]  # a process, which ends where there is no screen
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "needs a screen"


def _sync() -> str:
    """Open a viewer, and return the time of a step with each way to sync it."""
    import mujoco.viewer

    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    with mujoco.viewer.launch_passive(model, data) as viewer:
        synced = 0.0

        def every_step() -> None:
            mujoco.mj_step(model, data)
            viewer.sync()

        def at_the_screens_rate() -> None:
            nonlocal synced
            mujoco.mj_step(model, data)
            if time.perf_counter() - synced > 1 / 60:
                synced = time.perf_counter()
                viewer.sync()

        every, rate = _ns(every_step, 1000), _ns(at_the_screens_rate, 1000)
    return f"ns a step: {every:.0f} with a sync each, {rate:.0f} with 60 a second"


def new_device_copy() -> str:
    """MJB022: each episode converts the model and the data; one state can be replaced."""
    try:
        from mujoco import mjx
    except ImportError:
        return "needs mujoco-mjx: pip install mujoco-mjx"
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    first = mjx.put_data(model, data)

    def anew() -> tuple:
        data.qpos[0] = 0.5
        return mjx.put_model(model), mjx.put_data(model, data)

    def replaced():
        return first.replace(qpos=first.qpos.at[0].set(0.5))

    assert anew()[1].qpos == replaced().qpos
    return f"ns an episode: {_ns(anew, 5):.0f} to convert, {_ns(replaced, 5):.0f} to replace"


def settled_reset() -> str:
    """MJB023: boxes settle at each reset; the settled state can be kept."""
    model = mujoco.MjModel.from_xml_string(BOXES.format(integrator="Euler"))
    data, spec = mujoco.MjData(model), mujoco.mjtState.mjSTATE_INTEGRATION

    def settle() -> np.ndarray:
        mujoco.mj_resetData(model, data)
        mujoco.mj_step(model, data, 500)
        state = np.empty(mujoco.mj_stateSize(model, spec))
        mujoco.mj_getState(model, data, state, spec)
        return state

    settled = settle()

    def restore() -> np.ndarray:
        mujoco.mj_setState(model, data, settled, spec)
        return settled

    assert np.array_equal(settle(), restore())
    return f"ns an episode: {_ns(settle, 5):.0f} to settle, {_ns(restore, 5):.0f} to restore"


FAULTS = {
    "MJB001": stored_view,
    "MJB002": named_access,
    "MJB003": new_array,
    "MJB005": new_data,
    "MJB006": one_after_another,
    "MJB007": forward_after_step,
    "MJB008": halves_of_runge_kutta,
    "MJB009": shared_data,
    "MJB010": copied_data,
    "MJB011": compiled_model,
    "MJB012": new_renderer,
    "MJB013": new_jitted_function,
    "MJB014": new_rollout_pool,
    "MJB015": row_of_two_moments,
    "MJB016": written_view,
    "MJB017": steps_in_a_row,
    "MJB018": growing_array,
    "MJB019": contact_scan,
    "MJB020": finite_difference,
    "MJB021": synced_viewer,
    "MJB022": new_device_copy,
    "MJB023": settled_reset,
}


def _distinct(rows: list[np.ndarray]) -> int:
    return len({row.tobytes() for row in rows})


def _ns(call, number: int = 10_000) -> float:
    """Return the nanoseconds of a call: the fastest of five series."""
    return min(timeit.repeat(call, number=number, repeat=5)) / number * 1e9


if __name__ == "__main__":
    if sys.argv[1:] in ([SHARE], [SYNC]):
        sys.exit(print(_share_data() if sys.argv[1] == SHARE else _sync()))
    for code in sys.argv[1:] or FAULTS:
        print(code, FAULTS[code]())
