"""Written by benchmarks.studies.function_stub: what `import mjbench` offers."""

import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from mjbench.api.model_sources import Model
from mjbench.api.start_states import Actions, States
from mjbench.commands.record.capture import Capture as Capture
from mjbench.api.checkup import Checkup
from mjbench.api.compare import Comparison
from mjbench.simulation.engine_clock import engine_clock as engine_clock
from mjbench.api.latency import Latency
from mjbench.commands.show.rows import load as load
from mjbench.api.profile import Profile
from mjbench.commands.record.recording import record as record
from mjbench.api.timer import timer as timer
from mjbench.api.versions import ReleaseComparison

__version__: str
__all__: list[str]

capture = Capture

def checkup(
    target: Model,
    *arguments: str,
    budget_s: float | None = None,
    quick: bool = False,
    seconds: float | None = 40.0,
    settle_s: float | None = None,
    states: States | None = None,
    time_limit_s: float = 60.0,
    wait: bool = False,
    on_progress: Callable[[str, float], None] | None = None,
) -> Checkup:
    """Return what to do about a simulation that is slow, in a minute.

    The same as `mjbench TARGET`. A program runs unchanged, with its own output; all else is
    measured in child processes.

    Args:
      target: a model by name, path, MjModel or MjSpec; the path of a program; an environment
        by its Gymnasium id, or as `module:function`.
      *arguments: of a program.
      on_progress: called with what is measured now, and the share of all work that is done.
      budget_s: Time of the whole command; if given, or with --quick, it ends a program even before
        --seconds. In seconds. Default: 60s.
      quick: A first impression, often uncertain: 15s.
      seconds: End the program, as Ctrl-C would, when it has stepped for this long, with MJX alone
        from its first compiled function on; `none` runs it to its end. In seconds.
      settle_s: Simulated time for which the model moves before the first start state; 0 starts at
        keyframe 0, or at the default pose without one. In seconds. Default: 0.1s with a keyframe,
        5s without.
      states: Draw start states, and their controls if there are any, from this file. `with
        mjbench.capture("states.npz"):` around the loop of your program writes it. Or it has arrays
        by MjData field, such as `qpos` (nstate, nq), which it needs, `qvel` (nstate, nv) and `ctrl`
        (nstate, nu): `mjbench.record` returns them. A path, or a dictionary of arrays.
      time_limit_s: Kill a process of a model that reports nothing for this long. In seconds.
      wait: Wait until no other mjbench measures on this machine.

    Raises:
      InputError: there is no such target, or it could be several; it cannot be loaded or read.
      MachineError: a package is missing, or the process that steps crashed or hung.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """

def compare(
    *models: Model,
    paths: str | Iterable[str] | None = None,
    threads: int | Iterable[int] | None = None,
    options: Mapping[str, Any] | None = None,
    nbatch: int | Iterable[int] | None = None,
    returns: str = "final",
    nstep: int | None = None,
    hold: int | None = None,
    total_steps: float | None = None,
    rl: bool = False,
    budget_s: float | None = None,
    quick: bool = False,
    seed: int = 0,
    settle_s: float | None = None,
    states: States | None = None,
    actions: Actions | None = None,
    time_limit_s: float = 60.0,
    wait: bool = False,
    on_progress: Callable[[str, float], None] | None = None,
) -> Comparison:
    """Compare ways of stepping models: do they agree, and how fast are they?

    The same as `mjbench compare`. What paths return is compared first, bit by bit; a path that
    disagrees gets no speed. All is measured in child processes. A model that fails loses only its
    own results, unless all fail.

    Args:
      *models: names as on the command line, paths, MjModels or MjSpecs.
      on_progress: called with what is measured now, and the share of all work that is done.
      paths: Ways of stepping to compare, such as rollout, batch_step, mjx, warp (see `mjbench
        paths`), or MODULE:CLASS of your own; python_loop, with and without its timer, is always
        added. `c` stands for all C paths, `usual` for those and, where installed, mjx. Default: c.
      threads: Thread counts. Default: 1 and usable cores.
      options: Values of any other option of a path, such as pool=new, or chunk=1,4: simulations
        that a thread takes at a time.
      nbatch: Simulations at once. Default: 64; fewer where the plain loop would take more than 20
        ms.
      returns: What every path returns: final states; the state after every step, too; and sensor
        data of every step, too, which are of the state before it. MJX and Warp return final states
        only.
      nstep: Steps of each simulation. Default: 100; fewer where the plain loop would take more than
        20 ms; --hold with --rl.
      hold: Steps for which each control is held: an environment's frame_skip. Default: 1; 5 with
        --rl.
      total_steps: Steps that you will take in all simulations together, such as 1e9: a path that
        compiles is advised only if that pays within them. Default: --nbatch times --nstep.
      rl: For RL (closed loop): a policy chooses an action every --hold steps. Only paths that it
        can use are compared, and each call takes the steps of one action.
      budget_s: Time of the whole command, divided among its models. In seconds. Default: 23s for
        each model.
      quick: A first impression, often uncertain: 5s for each model.
      seed: Seed of start states and controls.
      settle_s: Simulated time for which the model moves before the first start state; 0 starts at
        keyframe 0, or at the default pose without one. In seconds. Default: 0.1s with a keyframe,
        5s without.
      states: Draw start states, and their controls if there are any, from this file. `with
        mjbench.capture("states.npz"):` around the loop of your program writes it. Or it has arrays
        by MjData field, such as `qpos` (nstate, nq), which it needs, `qvel` (nstate, nv) and `ctrl`
        (nstate, nu): `mjbench.record` returns them. A path, or a dictionary of arrays.
      actions: Take controls from this .npz or .npy file: an array `ctrl` or `actions` of shape
        (ncontrol, nu) or (nsequence, ncontrol, nu). Each row is held for the steps of a control. A
        path, or an array.
      time_limit_s: Kill a process of a model that reports nothing for this long. In seconds.
      wait: Wait until no other mjbench measures on this machine.

    Raises:
      InputError: there is no such model or path, an argument is out of its range, or no model can
        be compared.
      MachineError: a package is missing, or no model could be compared because processes failed.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """

def latency(
    model: Model,
    *,
    tick: int = 1,
    deadline_s: float | None = None,
    rate_hz: float | None = None,
    nstep: int | None = None,
    budget_s: float | None = None,
    quick: bool = False,
    seed: int = 0,
    settle_s: float | None = None,
    states: States | None = None,
    actions: Actions | None = None,
    time_limit_s: float = 60.0,
    wait: bool = False,
) -> Latency:
    """Return how long ticks take, which miss their deadline, and what slow ones share.

    The same as `mjbench latency`. They run in a child process.

    Args:
      model: a name as on the command line, a path, an MjModel or an MjSpec.
      tick: Steps of a tick: a controller sets controls once, then takes so many steps. Rate,
        deadline and latency are of ticks.
      deadline_s: Time by which a tick should end. In seconds. Default: the time between two paced
        ticks; free-running, the simulated time of a tick.
      rate_hz: Paced ticks per second. Default: 1 / (timestep × --tick).
      nstep: Steps measured at each pace. Default: 10,000 ticks, or what the budget allows.
      budget_s: Time of the whole command, divided among its models. In seconds. Default: 15s for
        each model.
      quick: A first impression, often uncertain: 5s for each model.
      seed: Seed of start states and controls.
      settle_s: Simulated time for which the model moves before the first start state; 0 starts at
        keyframe 0, or at the default pose without one. In seconds. Default: 0.1s with a keyframe,
        5s without.
      states: Draw start states, and their controls if there are any, from this file. `with
        mjbench.capture("states.npz"):` around the loop of your program writes it. Or it has arrays
        by MjData field, such as `qpos` (nstate, nq), which it needs, `qvel` (nstate, nv) and `ctrl`
        (nstate, nu): `mjbench.record` returns them. A path, or a dictionary of arrays.
      actions: Take controls from this .npz or .npy file: an array `ctrl` or `actions` of shape
        (ncontrol, nu) or (nsequence, ncontrol, nu). Each row is held for the steps of a control. A
        path, or an array.
      time_limit_s: Kill a process of a model that reports nothing for this long. In seconds.
      wait: Wait until no other mjbench measures on this machine.

    Raises:
      InputError: there is no such model, it cannot be loaded, or an argument is out of its range.
      MachineError: a package is missing, or the process that steps crashed or hung.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """

def profile(
    model: Model,
    *,
    budget_s: float | None = None,
    quick: bool = False,
    settle_s: float | None = None,
    states: States | None = None,
    time_limit_s: float = 60.0,
    wait: bool = False,
) -> Profile:
    """Return where a step's time goes: engine stages, Python around it, rendering.

    The same as `mjbench profile`. All is measured in child processes.

    Args:
      model: a name as on the command line, a path, an MjModel or an MjSpec.
      budget_s: Time of the whole command, divided among its models. In seconds. Default: 10s for
        each model.
      quick: A first impression, often uncertain: 5s for each model.
      settle_s: Simulated time for which the model moves before the first start state; 0 starts at
        keyframe 0, or at the default pose without one. In seconds. Default: 0.1s with a keyframe,
        5s without.
      states: Draw start states, and their controls if there are any, from this file. `with
        mjbench.capture("states.npz"):` around the loop of your program writes it. Or it has arrays
        by MjData field, such as `qpos` (nstate, nq), which it needs, `qvel` (nstate, nv) and `ctrl`
        (nstate, nu): `mjbench.record` returns them. A path, or a dictionary of arrays.
      time_limit_s: Kill a process of a model that reports nothing for this long. In seconds.
      wait: Wait until no other mjbench measures on this machine.

    Raises:
      InputError: there is no such model, it cannot be loaded, or it diverges.
      MachineError: a package is missing, or the process that steps crashed or hung.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """

def versions(
    old: str,
    *news: str,
    models: str | os.PathLike[str] | Iterable[str | os.PathLike[str]] = (),
    paths: str | Iterable[str] | None = None,
    metric: str = "time",
    min_effect: float = 0.01,
    confidence: float = 0.99,
    precision: float | None = None,
    as_shipped: bool = False,
    budget_s: float | None = None,
    quick: bool = False,
    nbatch: int | None = None,
    nstep: int | None = None,
    hold: int = 1,
    seed: int = 0,
    settle_s: float | None = None,
    states: States | None = None,
    actions: Actions | None = None,
    wait: bool = False,
    on_progress: Callable[[str, float], None] | None = None,
) -> ReleaseComparison:
    """Compare models in an old release of MuJoCo and in new ones: are they slower?

    The same as `mjbench versions`. Each release is installed in a folder of its own in the cache.
    Ratios are new over old: above 1 is slower. A model that fails loses only its own verdict,
    unless all fail.

    Args:
      old: a version (`3.5.0`), a wheel, a folder of wheels, `installed`, `newest` or `previous`; or
        packages, with commas, such as `jax==0.7.0,jaxlib==0.7.0`.
      *news: the same, one or several.
      models: names as on the command line, or paths. A compiled model cannot be compared: other
        releases cannot load it.
      on_progress: called with what is measured now, and the share of all work that is done.
      paths: Ways of stepping to compare between the releases. Default: python_loop.
      metric: What to compare, one of these: `time`, the time of steps; `instructions`, the
        instructions of the engine; `load`, loading the model; `reset`, mj_resetData; `rays`,
        casting rays; `rollout`, a call of rollout with 5 steps of each simulation; `batch`, a call
        of Batch.rollout with 5 steps of each simulation; `memory`, the peak memory of a new process
        that loads the model and steps it; `compile`, tracing and compiling the steps of a path that
        compiles, such as mjx. Instruction counts repeat within 0.1 %. They do not need a quiet
        machine, but they need valgrind, and --confidence, --precision, --budget and --as-shipped do
        not apply.
      min_effect: Smallest change that matters; a change that is certainly smaller is `same`. As a
        share: 0.01 is 1 %.
      confidence: Confidence of the interval: at 99%, at most 1 in 100 comparisons of identical
        targets is called different. As a share: 0.01 is 1 %.
      precision: Stop early once half the interval's width is below this. As a share: 0.01 is 1 %.
        Default: half of --min-effect, at most 0.5%.
      as_shipped: Compare builds as they are. By default mjbench moves their machine code in memory
        from process to process, so that only what the code does makes a difference.
      budget_s: Time of the whole command, divided among its verdicts. In seconds. Default: 60s for
        each verdict.
      quick: A first impression, often uncertain: 15s for each verdict.
      nbatch: Simulations at once. Default: as many as take 1 ms, or 10 ms for each of several
        threads; 2 to count instructions.
      nstep: Steps of each simulation. Default: up to 100 within that time; 50 to count
        instructions.
      hold: Steps for which each control is held: an environment's frame_skip.
      seed: Seed of start states and controls.
      settle_s: Simulated time for which the model moves before the first start state; 0 starts at
        keyframe 0, or at the default pose without one. In seconds. Default: 0.1s with a keyframe,
        5s without.
      states: Draw start states, and their controls if there are any, from this file. `with
        mjbench.capture("states.npz"):` around the loop of your program writes it. Or it has arrays
        by MjData field, such as `qpos` (nstate, nq), which it needs, `qvel` (nstate, nv) and `ctrl`
        (nstate, nu): `mjbench.record` returns them. A path, or a dictionary of arrays.
      actions: Take controls from this .npz or .npy file: an array `ctrl` or `actions` of shape
        (ncontrol, nu) or (nsequence, ncontrol, nu). Each row is held for the steps of a control. A
        path, or an array.
      wait: Wait until no other mjbench measures on this machine.

    Raises:
      InputError: there is no such release, model or path, an argument is out of its range, or no
        model can be compared.
      MachineError: a package or a release is missing, or processes failed for every model.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """
