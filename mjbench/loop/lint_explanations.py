"""What `mjbench lint --explain` prints of each rule."""

STORED_VIEW = """\
`data.qpos` is a view: an array that shows the memory of the MjData. Storing it stores no
values, so every entry shows the state of the last step, and `np.array(log)` has the same row
everywhere. This holds for the fields of an MjData, for their slices and reshapes, and for those
of named parts; also where a function of the script returns or yields the view.

    mujoco.mj_step(model, data)
    log.append(data.qpos)           # write: log.append(data.qpos.copy())

Results: the log holds one row for each step. The simulation stays as it is.
"""

NAMED_ACCESS = """\
`data.joint("hip")` looks the name up each time. MuJoCo keeps one object for each element, whose
arrays are views, so the object from before the loop shows the present values in every step.

    for _ in range(1000):
        mujoco.mj_step(model, data)
        angle = data.joint("hip").qpos[0]

    hip = data.joint("hip")         # instead
    for _ in range(1000):
        mujoco.mj_step(model, data)
        angle = hip.qpos[0]

Results: none change. A wrong name raises before the loop.
"""

NEW_ARRAY = """\
Each call allocates an array and fills it; in a small model this costs as much as part of a
step.

    observation = np.concatenate([data.qpos, data.qvel])

    observation = np.empty(model.nq + model.nv)       # instead, before the loop
    observation[: model.nq] = data.qpos
    observation[model.nq :] = data.qvel

Results: none change, unless the program keeps the arrays: then it needs one for each step.
"""

NEW_DATA = """\
`MjData(model)` allocates all memory of a simulation. `mj_resetData` sets the same values in the
memory that is there.

    for episode in range(100):
        data = mujoco.MjData(model)

    data = mujoco.MjData(model)                       # instead
    for episode in range(100):
        mujoco.mj_resetData(model, data)

Results: none change, unless the program keeps the MjData of earlier episodes, or their views.
"""

SERIAL_SIMULATIONS = """\
Simulations that do not depend on each other run one after another, on one core, and Python runs
between the steps. `mujoco.rollout`, from MuJoCo 3.2.7 on, and `mujoco.batch` step them on
threads, and `mjbench compare` says which is fastest for a model.

    for plan in plans:
        mujoco.mj_resetData(model, data)
        for ctrl in plan:
            data.ctrl[:] = ctrl
            mujoco.mj_step(model, data)

    states, sensors = rollout.rollout(model, datas, starts, plans)    # instead

Results: none change where the controls are known before the steps.
"""

FORWARD_AFTER_STEP = """\
`mj_step` computes positions, contacts and forces from the state before it, and then integrates.
`mj_forward` after it computes all of that for the new state, and the next `mj_step` does so
again. Stepping does not need it. `qpos`, `qvel`, `act` and `time` are those of the new state
without it. Where positions of the new state are read, `mj_kinematics` computes them; with
`mj_comPos`, centres of mass and what Jacobians need; with `mj_camlight`, cameras and lights;
with `mj_tendon`, lengths of tendons.

    mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)  # write: mujoco.mj_kinematics(model, data)
    height = data.body("torso").xpos[2]

There is no finding where the script reads anything else, such as contacts or sensors, or gives
the MjData to code that is not in the file.

Results in MuJoCo 4.0.0: none change, bit for bit, as in all releases that were tried from 3.10.0
on. In 3.3.1 and before, `mj_forward` also leaves its solution as the start of the next step's
solver, so without it later states differ, by the solver's tolerance at first. In 2.3.7, it
normalizes the quaternions in `qpos`, too, whose last bits differ if no call takes its place.
"""

HALVES_OF_RUNGE_KUTTA = """\
`mj_step` with `integrator="RK4"` computes four stages. `mj_step1` and `mj_step2` cannot:
`mj_step2` integrates by Euler, without a warning, so states differ from those of `mj_step`.

    mujoco.mj_step1(model, data)
    data.ctrl[:] = policy(data)
    mujoco.mj_step2(model, data)

    data.ctrl[:] = policy(data)     # instead: the policy sees positions of the step before
    mujoco.mj_step(model, data)

Or choose `implicitfast`, which both ways of stepping compute.

Results: the states become those of the integrator that the model asks for.
"""

SHARED_DATA = """\
An MjData holds one state and all that is computed from it. `mj_step` releases Python's lock, so
threads that step one MjData write to the same memory at the same time: states are wrong, differ
from run to run, and the program may crash.

    for _ in range(4):
        threading.Thread(target=simulate, args=(model, data)).start()

    for _ in range(4):              # instead
        threading.Thread(target=simulate, args=(model, mujoco.MjData(model))).start()

A model that no thread changes may be shared. `mujoco.rollout` has threads of its own.

Results: each thread simulates its own state.
"""

COPIED_DATA = """\
`copy.copy(data)`, `copy.deepcopy(data)` and `MjData(model)` allocate all memory of a
simulation. One MjData from before the loop takes the state instead: `mj_copyData`, in Python
from MuJoCo 3.5 on, copies everything; `mj_setState` with `mjSTATE_INTEGRATION` the state, the
inputs and the warm start, from which a step computes the rest.

    for plan in plans:
        cost = follow(copy.deepcopy(data), plan)

    scratch = mujoco.MjData(model)                    # instead
    for plan in plans:
        mujoco.mj_copyData(scratch, model, data)
        cost = follow(scratch, plan)

There is no finding where the program keeps the copies.

Results: none change.
"""

COMPILED_MODEL = """\
Loading XML, `MjSpec.compile` and PyMJCF's `Physics.from_mjcf_model` parse and compile the whole
model, which takes as long as many steps.

    for episode in range(100):
        model = mujoco.MjModel.from_xml_string(scene())

    model = mujoco.MjModel.from_xml_string(scene())   # instead
    for episode in range(100):
        model.geom_friction[:, 0] = rng.uniform(0.5, 1)

Masses, sizes, friction, colours and positions can be changed in the compiled model;
`mj_setConst` recomputes what follows from masses and `qpos0`. If the number of bodies varies,
compile all of them, and move those that are not used away.

Results: depend on what is changed; bodies that are moved away still cost time in each step.
"""

NEW_RENDERER = """\
Each Renderer creates an OpenGL context and uploads all meshes and textures of the model. One
that is never closed keeps them.

    for step in range(1000):
        mujoco.mj_step(model, data)
        renderer = mujoco.Renderer(model)

    with mujoco.Renderer(model) as renderer:          # instead
        for step in range(1000):
            mujoco.mj_step(model, data)
            renderer.update_scene(data)

Results: none change; `update_scene` sets the whole scene.
"""

NEW_JITTED_FUNCTION = """\
`jax.jit` keeps what it compiled for each function object. A lambda, a local function or a
`functools.partial` that an iteration creates is a new object, so JAX traces and compiles it
again. With `mjx.step`, that takes seconds to minutes.

    for gain in gains:
        move = jax.jit(lambda d: mjx.step(mx, d.replace(ctrl=-gain * d.qpos)))
        data = move(data)

    @jax.jit                                          # instead
    def move(d, gain):
        return mjx.step(mx, d.replace(ctrl=-gain * d.qpos))

    for gain in gains:
        data = move(data, gain)

Results: up to rounding the same; as an argument, `gain` is no constant of the compiled program.
"""

NEW_ROLLOUT_POOL = """\
`rollout.rollout` with several MjData starts threads, and stops them when it is done. An object
keeps them between calls.

    for _ in range(100):
        states, sensors = rollout.rollout(model, datas, starts, plans)

    with rollout.Rollout(nthread=len(datas)) as pool: # instead
        for _ in range(100):
            states, sensors = pool.rollout(model, datas, starts, plans)

`persistent_pool=True` does the same with one pool for the program.

Results: none change.
"""

ROW_OF_TWO_MOMENTS = """\
`mj_step` computes positions, contacts, forces and sensors of the state that it begins with, and
then integrates. After it, `qpos`, `qvel`, `act` and `time` belong to the new state, and all else to
the one before, until something computes it again. In a row with both, one is a step late.

    mujoco.mj_step(model, data)
    log.append((data.qpos.copy(), data.site("tip").xpos.copy()))

    mujoco.mj_step(model, data)     # instead: both of the new state
    mujoco.mj_kinematics(model, data)
    log.append((data.qpos.copy(), data.site("tip").xpos.copy()))

    qpos = data.qpos.copy()         # or: both of the state before, at no cost
    mujoco.mj_step(model, data)
    log.append((qpos, data.site("tip").xpos.copy()))

`mj_kinematics` computes positions of bodies, geoms and sites; contacts, forces and sensors need
`mj_forward`. The second way is for single steps of other integrators than `RK4`, after which
positions are those of the last of its four stages. A row at the top of a loop mixes the same two
moments. What no step moves, such as the position of a fixed body, is right in either state.

There is no finding for an observation: for what a function returns, or what a policy gets. It may
be late on purpose, as in Gymnasium's environments, and a policy that was trained on it expects it.

Results: the rows hold one moment. In MuJoCo 4.0.0 the simulation stays as it is, bit for bit; in
3.3.1 and before, `mj_forward` changes later states by the solver's tolerance.
"""

WRITTEN_VIEW = """\
A function that returns `data.qpos`, or a slice of it, returns a view: an array that shows the
memory of the MjData. A caller that writes into it, to scale or clip an observation, writes into the
simulation, and the next step goes on from there.

    def state(self):
        return self.data.qpos       # write: return self.data.qpos.copy()

    obs = env.state()
    obs -= mean                     # or here: obs = env.state() - mean

There is no finding where the caller seems to set the state: where `mj_forward` or the like
follows, in a method called `reset` or `set_...`, or where the function is named after the field or
as a view.

Results: the simulation keeps its own state, so all later states differ.
"""

STEPS_IN_A_ROW = """\
Each call of `mj_step` passes from Python to C and back. Where nothing is read or written between
steps, as while an action is held, one call takes them all.

    data.ctrl[:] = policy(data)
    for _ in range(frame_skip):
        mujoco.mj_step(model, data)

    data.ctrl[:] = policy(data)     # instead
    mujoco.mj_step(model, data, frame_skip)

There is no finding where the loop does anything else, such as to ask the policy.

Results: none change, bit for bit.
"""
