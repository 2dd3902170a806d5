"""One side of a paired comparison: a process that does what `paired` asks of it.

Where code and data lie decides a percent of a process's speed, sometimes three, for all its life,
and one layout is not a sample. So each launch is a program started anew, which maps MuJoCo's
libraries behind a random amount of other memory. Several times over it allocates model, data and
controls likewise, and runs at a random depth of the stack. (Forking launches from a started one is
quicker, and was tried: all launches of a parent shared an offset of half a percent, once of three.)
Requests and answers are pickled tuples over a socket; a block is a byte there and eight bytes back.

This module runs inside the environment of any one release and needs only NumPy and MuJoCo.
"""

import copy
import gc
import mmap
import os
import pickle
import random
import signal
import socket
import struct
import sys
import time
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mjbench
from mjbench.errors import InputError, MachineError, failure_of, one_line
from mjbench.instrument import child

if TYPE_CHECKING:
    from mjbench.simulation.workload import PortableWorkload

BLOCK, END = b"b", b"e"
NANOSECONDS = struct.Struct("<q")
# Random allocations before a launch makes its own: how many, and the largest of each, in bytes;
# and the most frames of the C stack below which it runs.
_SMALL, _SMALL_BYTES = 400, 4096
_LARGE, _LARGE_BYTES = 8, 1 << 21
_DEPTH = 24
# Memory mapped before MuJoCo's libraries are: how many pieces, and the largest, in pages.
_MAPS, _MAP_PAGES = 8, 512


class Worker:
    """What a process of one side knows and can be asked."""

    def __init__(self, connection: Connection):
        self.connection = connection
        self.model: Any = None
        self.workload: Any = None
        self.final: Any = None
        self.prepared: Any = None
        self.resources: Any = None
        self.padding: list[Any] = []

    def serve(self) -> None:
        """Answer requests until the parent hangs up."""
        while True:
            try:
                do, arguments = self.connection.recv()
            except (EOFError, OSError):
                os._exit(0)
            try:
                answer = ("ok", getattr(self, f"do_{do}")(**arguments))
            except Exception as error:
                answer = failure_of(error)
            try:
                self.connection.send(answer)
            except OSError:  # the parent hung up in the middle
                os._exit(0)

    def do_start(self, version: str, files: bool) -> str:
        """Import MuJoCo behind other memory; make sure that it is the release meant, whole."""
        self.padding = [_mapped() for _ in range(random.randrange(1, _MAPS))]
        import mujoco

        from mjbench.releases import install_check

        problem = install_check.imported_problem(version, files)
        if problem:
            raise MachineError(problem)
        return str(mujoco.__version__)

    def do_load(self, name: str, path: str, options: Mapping[str, str]) -> None:
        """Load a model and set options of its `opt`."""
        from mjbench.simulation import models

        self.model = models.load(models.ModelSource(name, Path(path)))
        for option, value in options.items():
            _set_option(self.model, option, value)

    def do_save(self, path: str) -> None:
        """Save the model as it is, to be loaded by launches without compiling it again."""
        import mujoco

        mujoco.mj_saveModel(self.model, path, None)

    def do_make(self, nbatch: int, nstep: int, hold: int, seed: int) -> "PortableWorkload":
        """Make a workload; return it in a form that any release restores."""
        from mjbench.simulation import work, workload

        made, _, _ = work.stable_workload(self.model, nbatch, nstep, hold, seed)
        return workload.portable(made)

    def do_take(self, work: str) -> None:
        """Take a workload from a file."""
        from mjbench.simulation import workload

        given = pickle.loads(Path(work).read_bytes())
        self.workload = workload.restore(self.model, given)
        self.final = given.final_state

    def do_equip(self, model: str, work: str) -> None:
        """Take a saved model and a workload, and import what a run needs."""
        from mjbench import paths
        from mjbench.simulation import models

        self.model = models.load(models.ModelSource("", Path(model)))
        self.do_take(work)
        paths.registry()

    def do_observe(self, work: str) -> dict[str, Any]:
        """Do a workload once, plainly: what it was, and where one step leads from each start."""
        from mjbench.simulation import work as room

        self.do_take(work)
        seen = room.observe(self.workload)
        return {
            "work": seen.work.as_dict(),
            "healthy": seen.healthy,
            "diagnosis": seen.diagnosis(),
            "final": seen.final_state,
            "after": room.one_step(self.model, self.workload.initial_state),
        }

    def do_cost(self) -> float:
        """Return about how long one step takes, in seconds."""
        from mjbench.simulation import work

        return work.step_s(self.model)

    def do_prepare(
        self,
        path: str,
        options: Mapping[str, Any],
        cores: list[int],
        rows: list[int],
    ) -> int:
        """Prepare a path's run in fresh memory, and check it; return nanoseconds of a warm block.

        Args:
          path: its name.
          options: its options.
          cores: to run on.
          rows: simulations to do; one named again is done again.
        """
        import numpy as np

        from mjbench import paths
        from mjbench.simulation import workload

        if cores and hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(0, cores)
        self.padding += _scattered()
        model = copy.copy(self.model)
        given, before = self.workload, self.resources
        made = workload.Workload(
            model, given.initial_state[rows], given.control[rows], given.hold, given.seed
        )
        way = paths.find(path)
        reason = way.unavailable() or way.unsuited(made, options)
        if reason:
            raise InputError(reason)
        self.resources = paths.Resources(made)
        self.prepared = way.prepare(made, options, self.resources)
        reached = self.prepared.verified_states()
        held = slice(None) if reached.mask is None else reached.mask
        if not np.array_equal(reached.values[held], self.final[rows][held]):
            raise MachineError(f"path {path} does not reach the final states of the plain loop")
        if before is not None:  # until now its memory kept the new one from lying there too
            before.close()
        gc.collect()
        gc.freeze()  # the next layout's garbage is all there is left to look at
        gc.disable()
        return self._block()

    def do_time(self) -> None:
        """Time a block whenever asked to, until told to end."""
        _deeper(random.randrange(_DEPTH), self._time)

    def _time(self) -> None:
        receive, send, pack = (
            self.connection.recv_bytes,
            self.connection.send_bytes,
            NANOSECONDS.pack,
        )
        while receive() == BLOCK:
            send(pack(self._block()))

    def do_cores(self, threads: int) -> float:
        """Return how many cores `threads` threads get now (see machine.Calibration)."""
        from mjbench.instrument.machine import Calibration

        calibration = Calibration(threads)
        seconds = []
        for run in (calibration.single, calibration.together) * 2:
            begin = time.perf_counter()
            run()
            seconds.append(time.perf_counter() - begin)
        return calibration.cores(min(seconds[0::2]), min(seconds[1::2]))

    def _block(self) -> int:
        run, clock = self.prepared.run, time.perf_counter_ns
        begin = clock()
        run()
        return clock() - begin


def _set_option(model: Any, option: str, value: str) -> None:
    """Set a field of `model.opt`: a number, or the name of an enum's value."""
    import mujoco

    enums = {"integrator": "mjINT_", "solver": "mjSOL_", "cone": "mjCONE_", "jacobian": "mjJAC_"}
    if not hasattr(model.opt, option) or callable(getattr(model.opt, option)):
        raise InputError(f"no option {option!r}: give a number field of MjOption, such as solver")
    try:
        if option in enums and not value.isdigit():
            kind = getattr(mujoco, f"mjt{option.capitalize()}")
            names = {n.lower(): n for n in dir(kind) if n.startswith(enums[option])}
            number = int(getattr(kind, names[f"{enums[option]}{value}".lower()]))
        else:
            number = type(getattr(model.opt, option))(float(value))
        setattr(model.opt, option, number)
    except KeyError:
        known = ", ".join(sorted(n.removeprefix(enums[option]) for n in names.values()))
        raise InputError(f"option {option}: {value!r} is not one of {known}") from None
    except (TypeError, ValueError) as error:
        raise InputError(f"option {option}: {value!r} will not do: {one_line(error)}") from error


def _mapped() -> mmap.mmap:
    """Map a random number of pages, which move what is mapped after them."""
    return mmap.mmap(-1, mmap.PAGESIZE * random.randrange(1, _MAP_PAGES))


def _scattered() -> list[bytearray]:
    """Return blocks of memory that move whatever is allocated after them to random places."""
    small = [bytearray(random.randrange(16, _SMALL_BYTES)) for _ in range(_SMALL)]
    large = [bytearray(random.randrange(1 << 12, _LARGE_BYTES)) for _ in range(_LARGE)]
    # holes, into which the allocator puts some of what comes
    return random.sample(small, _SMALL // 2) + random.sample(large, _LARGE // 2)


def _deeper(levels: int, function: Callable[[], None]) -> None:
    """Call `function` below `levels` further frames of the C stack."""
    if levels == 0:
        function()
    else:
        list(map(lambda _: _deeper(levels - 1, function), (None,)))  # noqa: C417  a frame of C


def main(descriptor: int) -> None:
    """Answer requests on the inherited socket."""
    child.die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Worker(Connection(descriptor)).serve()


def make_core(folder: Path) -> None:
    """Link mjbench alone into a folder: what lies beside it must not be found by a release."""
    (folder / "mjbench").symlink_to(Path(mjbench.__file__).resolve().parent)


def command(code: str, core: Path, install: Path | None) -> list[str]:
    """Return the command that runs Python code in the environment of a release.

    Args:
      code: what to run.
      core: a folder that `make_core` filled.
      install: the folder of a release; None for the environment of this process.
    """
    if install is None:
        return [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(core)!r}); {code}"]
    places = [str(core), str(install)]
    return [sys.executable, "-P", "-s", "-S", "-c", f"import sys; sys.path += {places!r}; {code}"]


def environment(install: Path | None) -> dict[str, str]:
    """Return the environment variables of a worker: without those that change how Python runs.

    PYTHONPATH is left to the environment of this process alone.
    """
    kept = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    kept["MUJOCO_GL"] = "disable"  # nothing is drawn: a third of the import is the window library
    if install is None and "PYTHONPATH" in os.environ:
        kept["PYTHONPATH"] = os.environ["PYTHONPATH"]
    return kept


def pair() -> tuple[Connection, socket.socket]:
    """Return a connection for the parent and the socket for a worker at its other end."""
    ours, theirs = socket.socketpair()
    return Connection(ours.detach()), theirs
