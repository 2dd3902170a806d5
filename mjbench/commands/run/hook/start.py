"""Start the clocks in the user's program, and in the processes that it forks.

Tracebacks that the user sees hold no frames of the clocks.
"""

import atexit
import contextlib
import faulthandler
import gc
import os
import sys
from collections.abc import Callable
from functools import partial
from types import ModuleType
from typing import Any

from . import file_owners, step_file
from .call_clock import CallClock
from .function_replacement import AfterImport, named_like
from .jax_functions import JaxFunctions
from .rare_calls import RareCalls
from .step_clock import StepClock
from .watch import Watch

# Methods that begin a step of an environment: module, class, method.
_ENVIRONMENTS = (
    ("gymnasium.envs.mujoco.mujoco_env", "MujocoEnv", "do_simulation"),
    ("dm_control.rl.control", "Environment", "step"),
    ("dm_control.composer.environment", "Environment", "step"),
    ("robosuite.environments.base", "MujocoEnv", "step"),
)
# Of the file in which a crash is noted.
_HIGH_DESCRIPTOR = 500


def start(folder: str) -> None:
    calls = CallClock(folder)
    watch = Watch(folder, calls)
    try:
        steps = StepClock(folder, calls, watch)
    except OSError:
        if os.path.exists(step_file.path_of(folder)):
            return  # it is empty, for want of space, and the report says so
        raise
    slow, of_jax = RareCalls(calls, watch), JaxFunctions(calls)

    def install(module: ModuleType) -> None:
        steps.install(module)
        slow.install(module)

    def environment(class_name: str, method: str) -> Callable[[ModuleType], None]:
        return lambda module: steps.install_environment(module, class_name, method)

    def begin_process() -> None:
        try:
            for clock in (calls, watch, steps, of_jax):
                clock.begin_process()
        except BaseException:  # of a signal handler of the program's
            calls.close()
            steps.leave()
            raise

    actions: dict[str, Callable[[ModuleType], None]] = {
        "mujoco": install,
        "mujoco.rollout": slow.install_rollout,
        "mujoco.batch": slow.install_batch,
        "mujoco.mjx": slow.install_mjx,
        "gymnasium.envs.mujoco.mujoco_rendering": slow.install_gymnasium,
        "gymnasium.utils.ezpickle": watch.install_copies,
        "jax": of_jax.install,
        "multiprocessing.process": slow.install_processes,
    }
    for module_name, class_name, method in _ENVIRONMENTS:
        actions[module_name] = environment(class_name, method)
    sys.meta_path.insert(0, AfterImport(actions))
    gc.callbacks.append(steps.collections.callback)
    _hide_clocks(folder)
    if not faulthandler.is_enabled():
        _note_crashes(os.path.join(folder, f"{os.getpid()}.fault"))
    _follow_forks(begin_process)
    for clock in (steps, of_jax):
        atexit.register(_end, clock)


def _end(clock: StepClock | JaxFunctions) -> None:
    """End a clock as the last thing that the process does: a signal has nothing to end any more."""
    with contextlib.suppress(BaseException):
        clock.end()


def _follow_forks(begin_process: Callable[[], None]) -> None:
    """Let a process that is forked begin its own files before `os.fork` returns in it.

    `os.register_at_fork` is no place for that: Python drops an exception that is raised there, such
    as that of Ctrl-C. A function of C calls the fork itself, so that Python warns of threads at the
    program's line.
    """

    def followed(result: Any) -> Any:
        pid = result[0] if isinstance(result, tuple) else result  # as of `os.forkpty`
        if pid == 0:
            begin_process()
        return result

    for name in ("fork", "forkpty"):
        fork = getattr(os, name, None)
        if fork is not None:
            following = named_like(fork, partial(next, map(followed, iter(fork, None))))
            for module in (os, sys.modules["posix"]):
                setattr(module, name, following)


def _note_crashes(path: str) -> None:
    """Let a crash leave the line that the program was at, in a file of its own.

    The program sees a fault handler that is not enabled, until it enables it itself.
    """
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with contextlib.suppress(ImportError, OSError):
        import fcntl

        # a number that no file of the program gets, even if the program closes what it inherits
        high = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, _HIGH_DESCRIPTOR)
        os.close(descriptor)
        descriptor = high
    enable, is_enabled = faulthandler.enable, faulthandler.is_enabled
    enable(descriptor, all_threads=False)

    def enable_for_program(*args: Any, **kwargs: Any) -> None:
        faulthandler.is_enabled = is_enabled
        enable(*args, **kwargs)

    faulthandler.enable = named_like(enable, enable_for_program)
    faulthandler.is_enabled = named_like(is_enabled, lambda: False)


def _hide_clocks(folder: str) -> None:
    """Let what an uncaught exception prints leave out the clock's own frames, and note it."""
    earlier = sys.excepthook

    def report(kind: type[BaseException], error: BaseException, frames: Any) -> None:
        frames = _without_own(frames)
        with contextlib.suppress(Exception):  # the disk is full, or its own `__str__` raises
            _note_exception(os.path.join(folder, f"{os.getpid()}.exception"), error, frames)
        if not issubclass(kind, KeyboardInterrupt):  # the user or mjbench ended the program
            earlier(kind, error, frames)

    sys.excepthook = report
    import threading

    earlier_of_threads = threading.excepthook

    def report_of_thread(arguments: Any) -> None:
        error = arguments.exc_value
        if error is not None:
            error = error.with_traceback(_without_own(error.__traceback__))
            arguments = threading.ExceptHookArgs(
                (arguments.exc_type, error, error.__traceback__, arguments.thread)
            )
        earlier_of_threads(arguments)

    threading.excepthook = report_of_thread


def _note_exception(path: str, error: BaseException, frames: Any) -> None:
    """Write an exception in a line, and its frames, innermost first, as a crash leaves them."""
    lines: list[str] = []
    while frames is not None:
        code = frames.tb_frame.f_code
        lines.insert(0, f'File "{code.co_filename}", line {frames.tb_lineno} in {code.co_name}')
        frames = frames.tb_next
    text = " ".join(f"{type(error).__name__}: {error}".split())
    with open(path, "w", encoding="utf-8", errors="backslashreplace") as file:
        file.write("\n".join([text, *lines]))


def _without_own(frames: Any) -> Any:
    rest = []
    while frames is not None:
        if not file_owners.is_of_clocks(frames.tb_frame.f_code.co_filename):
            rest.append(frames)
        frames = frames.tb_next
    following = None
    for frame in reversed(rest):
        frame.tb_next = following
        following = frame
    return following
