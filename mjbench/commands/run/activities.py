"""What a program was doing when a sample of its stack was taken."""

import contextlib
import enum
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from mjbench.bounds import AnyInt
from mjbench.commands.run.hook import file_owners
from mjbench.commands.run.py_spy import Frame
from mjbench.commands.run.source_loops import source_line


class Activity(enum.StrEnum):
    """What a thread does."""

    PHYSICS = "physics"
    """MuJoCo's engine steps, or computes a part of a step."""
    BINDINGS = "bindings"
    """Between Python and the engine: calls, and views of the engine's arrays."""
    PYTHON = "Python"
    """The interpreter, and what has no activity of its own."""
    NUMPY = "NumPy"
    """NumPy and SciPy compute."""
    POLICY = "policy"
    """A framework for neural networks: PyTorch, JAX, TensorFlow, ONNX Runtime."""
    RENDERING = "rendering"
    LOGGING = "logging and I/O"
    PROCESSES = "waiting for other processes"
    """For a pipe, a queue or the end of another process."""
    STARTING = "starting processes"
    THREADS = "waiting for other threads"
    """For a lock or a queue of the same process."""
    SLEEPING = "sleeping"
    COLLECTION = "garbage collection"
    """Python looks for objects that refer to each other."""
    IMPORT = "imports"
    LOADING = "loading models"
    BUILDING = "building models"
    """Python adds the elements of a model, such as those of `MjSpec` or `dm_control.mjcf`."""
    COPYING = "creating and copying MjData"
    """`MjData(model)`, copies of one, and states that are read or set as a whole."""
    COMPILING = "compiling by JAX"
    KERNELS = "compiling Warp kernels"
    """Once for each machine: Warp stores what it compiles in its cache."""
    DISPATCH = "calling compiled functions of JAX"
    """JAX starts what a function computes; on a processor, it may compute it meanwhile."""
    COMPARING = "comparing models of MJX"
    """A compiled function compares the NumPy fields of a new model with those that it knows."""
    DEVICE_WAIT = "waiting for JAX"
    """Until an array is computed, and copied to the host."""
    TRANSFER = "transfers to the device"
    REST = "the rest"
    """What is no call that is timed, where too few samples say what else it is."""


# Of lines that wait for others.
WAITING = (Activity.PROCESSES, Activity.THREADS)


@dataclass(frozen=True)
class Place:
    """A line of Python.

    Attributes:
      file: path of the file: as `shown_path` gives it in results.
      line: from 1.
      function: that holds the line.
      text: of the line, without the spaces around it.
    """

    file: str
    line: AnyInt
    function: str
    text: str = ""

    @property
    def position(self) -> tuple[str, int]:
        """The file and the line: a comprehension is a function of its own, on the same line."""
        return self.file, self.line

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


# What calls a function for each task of a pool, in a process or a thread.
_TASK_CALLERS = {
    ("multiprocessing/pool.py", "worker"),
    ("concurrent/futures/process.py", "_process_worker"),
    ("concurrent/futures/thread.py", "_worker"),
}

# Python files.
_DRAWING_FILE = re.compile(
    r"/mujoco/(renderer|viewer)\.py$|/mujoco/rendering/|/mujoco/(egl|osmesa|cgl|glfw)/|mujoco_rendering\.py$"
    r"|-packages/dm_control/(_render|viewer)/|-packages/dm_control/mujoco/render"
    r"|-packages/(OpenGL|glfw|pygame|matplotlib|cv2|mujoco_python_viewer|robosuite/renderers)/"
)
_POLICY_FILE = re.compile(
    r"-packages/(torch|jax|jaxlib|flax|haiku|optax|tensorflow|keras|onnxruntime)/"
)
_MJX_FIELDS_FILE = re.compile(r"/mujoco/mjx/_src/dataclasses\.py$")
_BUILDING_FILE = re.compile(r"-packages/dm_control/mjcf/(?!physics\.py)")
_LOGGING_FILE = re.compile(
    r"-packages/(tensorboard|tensorboardX|wandb|mlflow|imageio|imageio_ffmpeg|h5py|moviepy)/"
    r"|/numpy/lib/(_npyio_impl|npyio|format|_format_impl)\.py$"
)
_STANDARD_LOGGING = re.compile(r"^(logging/\w+|csv|json/\w+|pickle|shelve|gzip|zipfile\w*)\.py$")
_STANDARD_PROCESSES = re.compile(r"^(multiprocessing/|subprocess\.py|concurrent/futures/process)")
# A pool's caller waits for a thread, which reads what processes send; `ThreadPool` has none of
# those. The workers of both run the same function, behind `_bootstrap` in a process of its own.
_POOL, _WORKER = "multiprocessing/pool.py", "worker"
PROCESS_MODULE = "multiprocessing/process.py"
_UNPICKLES = "_ForkingPickler.loads("
_STANDARD_THREADS = re.compile(r"^(threading|queue|concurrent/futures/(thread|_base))\.py$")
_STANDARD_WAITING = re.compile(r"^(selectors|socket|asyncio/\w+)\.py$")
_WARP_FILE = re.compile(r"-packages/warp/_src/(context|build)\.py$")
_WARP_COMPILES = ("_compile", "build_cuda", "build_cpu")
_THREADED_ENGINE = re.compile(r"/mujoco/(rollout|batch\w*)\.py$")
_IMPORTS = re.compile(r"^<frozen importlib")
_CLOCK_OF_JAX, _CALL_CLOCK = "jax_functions.py", "call_clock.py"
# What a line of Python does that calls libraries.
_LINES = (
    (re.compile(r"\bmj_(step[12]?|forward\w*|inverse\w*|rnePostConstraint)\("), Activity.PHYSICS),
    (re.compile(r"\bmj[uvdr]?_\w+\(|\.contact\b"), Activity.BINDINGS),
    (re.compile(r"\bsleep\("), Activity.SLEEPING),
    (re.compile(r"\.acquire\(|\bwith [\w.]*lock\b"), Activity.THREADS),
    (re.compile(r"\bprint\(|\.(write|flush|savez?|tofile)\("), Activity.LOGGING),
    (re.compile(r"\b(np|numpy|scipy)\.|\.(copy|mean|sum|dot|clip)\(| @ "), Activity.NUMPY),
    (re.compile(r"\.(joint|body|geom|site|sensor|actuator)\("), Activity.BINDINGS),
    (
        re.compile(
            r"\.(add_(body|frame|geom|site|(free)?joint|camera|light|mesh|hfield|texture|material"
            r"|tendon|actuator|sensor|equality|pair|exclude|key|flex)|attach_(body|frame))\("
        ),
        Activity.BUILDING,
    ),
)
# Lines of multiprocessing between its functions and the call that waits.
_NEAR = 4


def activity(stack: Sequence[Frame], has_thread_pool: bool = False) -> Activity:
    """Return what a stack shows.

    Args:
      has_thread_pool: whether pools of `multiprocessing` are of threads in this process.
    """
    return (
        _by_caller(stack, has_thread_pool)
        or _by_line(stack)
        or _by_python(stack)
        or Activity.PYTHON
    )


def _by_line(stack: Sequence[Frame]) -> Activity | None:
    if not stack:
        return None
    frame = stack[-1]
    if is_step_clock(frame):
        is_of_jax = Path(frame.file).name == _CLOCK_OF_JAX
        return Activity.DISPATCH if is_of_jax else Activity.PHYSICS
    text = source_line(frame.file, frame.line)
    return next((activity for pattern, activity in _LINES if pattern.search(text)), None)


def _by_caller(stack: Sequence[Frame], has_thread_pool: bool) -> Activity | None:
    """Return the activity of what is one whole, whatever it calls.

    Callers beyond the innermost line of the user's code do not count: that line is what they run.
    """
    called = list(itertools.takewhile(lambda frame: not is_own(frame), reversed(stack)))
    if any(map(imports, called)):
        return Activity.IMPORT
    if any(f.function in _WARP_COMPILES and _WARP_FILE.search(f.file) for f in called):
        return Activity.KERNELS
    if any(_DRAWING_FILE.search(frame.file) for frame in called):
        return Activity.RENDERING
    for frame in called:
        file = frame.file
        if frame.function.endswith("__eq__") and _MJX_FIELDS_FILE.search(file):
            return Activity.COMPARING
        if _POLICY_FILE.search(file):
            return Activity.POLICY
        if _BUILDING_FILE.search(file):
            return Activity.BUILDING
        if _LOGGING_FILE.search(file) or _STANDARD_LOGGING.match(file_owners.standard_name(file)):
            return Activity.LOGGING
        if _THREADED_ENGINE.search(file):
            return Activity.PHYSICS
        if file_owners.standard_name(file) == _POOL:
            return Activity.THREADS if has_thread_pool else Activity.PROCESSES
    return None


def _by_python(stack: Sequence[Frame]) -> Activity | None:
    if not stack:
        return None
    names = [file_owners.standard_name(frame.file) for frame in reversed(stack)][:_NEAR]
    if any(_STANDARD_PROCESSES.match(name) for name in names) and (
        _STANDARD_WAITING.match(names[0]) or names[0].startswith("multiprocessing/conn")
    ):
        return Activity.PROCESSES
    if _STANDARD_THREADS.match(names[0]) or _STANDARD_WAITING.match(names[0]):
        return Activity.THREADS
    return Activity.NUMPY if file_owners.package_of(stack[-1].file) in ("numpy", "scipy") else None


@cache
def shown_path(file: str) -> str:
    """Return a path for people: within the current folder, an installed package, or in full."""
    match = re.search(r"/(?:site|dist)-packages/(.+)$", file)
    if match or file_owners.standard_name(file):
        return match[1] if match else file_owners.standard_name(file)
    with contextlib.suppress(ValueError):
        return str(Path(file).relative_to(Path.cwd()))
    return file


def is_own(frame: Frame) -> bool:
    return file_owners.is_own(frame.file)


def place_of(frame: Frame) -> Place:
    text = source_line(frame.file, frame.line)
    return Place(shown_path(frame.file), frame.line, frame.function, text)


def imports(frame: Frame) -> bool:
    return _IMPORTS.match(frame.file) is not None


def is_of_thread_pool(stack: Sequence[Frame]) -> bool:
    names = [file_owners.standard_name(frame.file) for frame in stack]
    is_worker = any(
        name == _POOL and frame.function == _WORKER
        for name, frame in zip(names, stack, strict=True)
    )
    return is_worker and PROCESS_MODULE not in names


def calls_tasks(frame: Frame) -> bool:
    """Return whether a frame calls a function for each task of a pool."""
    return (file_owners.standard_name(frame.file), frame.function) in _TASK_CALLERS


def unpickles(stack: Sequence[Frame]) -> bool:
    """Return whether a stack takes apart what another process has sent."""
    return any(
        _UNPICKLES in source_line(frame.file, frame.line)
        for frame in stack
        if file_owners.standard_name(frame.file).startswith("multiprocessing/")
    )


def steps_on_threads(stack: Sequence[Frame]) -> bool:
    """Return whether a stack waits for the engine's own threads, which need no GIL."""
    return any(_THREADED_ENGINE.search(frame.file) for frame in stack)


def is_step_clock(frame: Frame) -> bool:
    return file_owners.is_of_clocks(frame.file)


def is_slow_call(frame: Frame) -> bool:
    """Return whether a frame stands for a slow function, each call of which is timed."""
    return is_step_clock(frame) and Path(frame.file).name == _CALL_CLOCK
