"""The process of one target: it does tasks, as its parent asks (see `worker_pool`).

Where code and data lie in memory decides 1 % of a process's speed, sometimes 3 %, for all its life,
and one layout is not a sample. So each launch is a new process, which maps MuJoCo's libraries
behind a random amount of other memory. Several times per launch it allocates model, data and
controls anew in the same way, and runs at a random depth of the stack. Both targets of a launch
draw the same (see `memory_layout`). (Where processes were forked after MuJoCo was imported, all of
one parent shared an offset of 0.5 %, once of 3 %. So `fork_server` forks them before.)

This module runs inside the environment of any one release: it needs only the standard library,
NumPy and MuJoCo, and imports MuJoCo after it has mapped that other memory.
"""

import copy
import gc
import itertools
import os
import pickle
import random
import signal
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from mjbench.errors import InputError, MachineError, failure_of
from mjbench.host import child, platforms
from mjbench.paired import memory_layout
from mjbench.paired.worker_answers import (
    BLOCK,
    NANOSECONDS,
    Done,
    DrawnWorkload,
    Move,
    Observed,
    ReadyOperation,
    StepCost,
)

if TYPE_CHECKING:
    import mujoco
    import numpy as np

    from mjbench.paired.loop_sections import LoopSection
    from mjbench.paired.operations import PreparedOperation
    from mjbench.paths import Resources, States
    from mjbench.simulation.starts import StartPlan
    from mjbench.simulation.workload import PortableWorkload, Product, Workload
    from mjbench.simulation.workload_sampling import SampleRequest

# What moves the memory of a layout is freed after as many more of them.
_SCATTERED_LAYOUTS = 12
# A layout runs below fewer frames of the C stack than this.
_DEPTH = 24

_Task = TypeVar("_Task", bound=Callable[..., Any])
_Extension = TypeVar("_Extension")


def activity(doing: str) -> Callable[[_Task], _Task]:
    """Note of a task what the worker is doing in it, for error messages."""

    def note(task: _Task) -> _Task:
        task.__dict__["activity"] = doing
        return task

    return note


class Worker:
    """What the process of one target holds, and the tasks that it can be asked to do.

    Attributes:
      final_state: (nbatch, nstate) where each simulation of `workload` must end; None if unknown.
    """

    model: "mujoco.MjModel"
    workload: "Workload"
    final_state: "np.ndarray | None"

    def __init__(self, connection: Connection):
        self.connection = connection
        self.resources: Resources | None = None
        self._extensions: dict[type, object] = {}
        self.sections: Sequence[LoopSection] = ()
        self.padding: list[Any] = []
        self.scattered: deque[list[object]] = deque(maxlen=_SCATTERED_LAYOUTS)
        self.rng = random.Random()

    def extend(self, extension: object) -> None:
        """Hold what tasks outside of this module work on (see `extension`)."""
        self._extensions[type(extension)] = extension

    def extension(self, kind: type[_Extension]) -> _Extension:
        """Return what an earlier task extended the worker by."""
        extension = self._extensions[kind]
        assert isinstance(extension, kind)
        return extension

    def serve(self) -> None:
        """Do tasks until the parent hangs up."""
        while True:
            try:
                message = self.connection.recv_bytes()
            except (EOFError, OSError):
                os._exit(0)
            answer: Any
            try:
                task, arguments, named = pickle.loads(message)  # may import modules
                answer = Done(task(self, *arguments, **named))
            except BaseException as error:  # a path of the user's own may raise SystemExit
                answer = failure_of(error)
            try:
                self.connection.send(answer)
            except OSError:  # the parent hung up in the meantime
                os._exit(0)

    @activity("importing MuJoCo")
    def start_release(
        self, version: str, check_files: bool, seed: int, move: "Move | None" = None
    ) -> None:
        """Import MuJoCo, and make sure that it is the release meant."""
        self.rng.seed(seed)
        self.padding = [*memory_layout.mapped(self.rng)]
        # MuJoCo's types lie elsewhere, too: the bindings look them up by their address
        self.padding += memory_layout.scattered(self.rng)
        package: Path | None = None
        if move is not None:
            movable = pickle.loads(move.movable_file.read_bytes())
            package = movable.use(move.folder, move.others, move.placement)
        import mujoco  # now, so that its libraries lie behind the padding

        imported = Path(mujoco.__file__).parent
        if package is not None and imported != package:
            raise MachineError(f"imported {imported} instead of the moved {package}")
        from mjbench.releases import install_check

        check = install_check.imported_problem if check_files else install_check.engine_problem
        if problem := check(version):
            raise MachineError(problem)

    @activity("loading the model")
    def load_model(self, name: str, file: Path, options: Mapping[str, str]) -> None:
        """Compile a model, and set fields of its `opt` to a number, or to the name of a choice."""
        from mjbench.simulation import model_options, models

        self.model = models.load(models.ModelSource(name, file))
        for field, text in options.items():
            model_options.set_option(self.model, field, text)

    @activity("saving the model")
    def save_model(self, file: Path) -> None:
        """Save the loaded model, so that launches need not compile it again."""
        from mjbench.simulation import models

        models.save(self.model, file)

    @activity("measuring a step")
    def measure_step_cost(self, plan: "StartPlan", nstart: int, hold: int) -> StepCost:
        from mjbench.simulation import compat, reference_run, starts, workload_sampling
        from mjbench.simulation.model_digest import model_digest

        return StepCost(
            model_digest(self.model),
            reference_run.step_s(self.model),
            starts.settling_nstep(self.model, plan),
            workload_sampling.most_nstep(self.model, plan, nstart, hold),
            compat.has_sleep(self.model),
        )

    @activity("measuring a step")
    def measure_settled_cost(self) -> float:
        """Return about how many seconds one step takes in the model's typical regime."""
        from mjbench.simulation import workload_sampling

        return workload_sampling.settled_step_s(self.model)

    @activity("making the workload")
    def make_workload(self, request: "SampleRequest") -> DrawnWorkload:
        """Draw a workload for the loaded model (see `workload_sampling.draw`)."""
        from mjbench.simulation import state_drift, workload_sampling
        from mjbench.verification.plan import check_memory

        check_memory(self.model, request.nbatch, request.nstep)
        sample = workload_sampling.draw(self.model, request)
        return DrawnWorkload(state_drift.portable(sample.workload), sample.starts)

    @activity("stepping the model")
    def observe(self, workload_file: Path, nsection: int = 1) -> Observed:
        """Read a pickled `PortableWorkload`, do it once the plain way, and return what it was."""
        from mjbench.paired import loop_sections
        from mjbench.simulation import reference_run, state_drift

        portable = self.read_workload(workload_file)
        assert portable.probe is not None, "a workload is drawn with states along it"
        observation = reference_run.observe(self.workload)
        return Observed(
            work=observation.work,
            healthy=observation.healthy,
            diagnosis=observation.diagnosis(),
            warnings=observation.other_warnings(),
            final_state=observation.final_state,
            followed=state_drift.follow(self.workload, portable.probe),
            can_divide=loop_sections.can_divide(self.workload.only(observation.healthy), nsection),
            timestep_s=float(self.model.opt.timestep),
        )

    @activity("reading the workload")
    def equip(self, model_file: Path, workload_file: Path, path: str) -> None:
        """Read a saved model and a pickled `PortableWorkload`, and import a path."""
        from mjbench import paths
        from mjbench.simulation import models

        self.model = models.load(models.ModelSource("", model_file))
        self.read_workload(workload_file)
        paths.find(path)  # imports it

    def read_workload(self, file: Path) -> "PortableWorkload":
        from mjbench.simulation import workload

        portable: PortableWorkload = pickle.loads(file.read_bytes())
        self.workload = workload.restore(self.model, portable)
        self.final_state = portable.final_state
        return portable

    def lay_out_memory(self, cores: Sequence[int]) -> None:
        """Run on these cores from now on, and allocate what follows elsewhere."""
        if cores:
            platforms.set_affinity(0, cores)
        self.scattered.append(memory_layout.scattered(self.rng))

    @activity("preparing a run")
    def prepare_run(
        self,
        path_name: str,
        options: Mapping[str, Any],
        cores: Sequence[int],
        simulations: Sequence[int],
        returns: "Product | None" = None,
        nsection: int = 1,
        has_timer: bool = True,
    ) -> int:
        """Prepare a path's run in fresh memory, and check it.

        Args:
          simulations: rows of the workload to do.
          nsection: sections of the run, which blocks time one after the other (see
            `loop_sections`); 1 with any path but the plain loop.

        Returns:
          How many nanoseconds one block of each section takes, untimed warm-ups included.
        """
        from mjbench import paths
        from mjbench.paired import loop_sections
        from mjbench.paths import States
        from mjbench.simulation.engine_clock import engine_clock
        from mjbench.simulation.workload import Product, Workload

        self.lay_out_memory(cores)
        model = copy.copy(self.model)
        workload, previous, rows = self.workload, self.resources, list(simulations)
        selected = Workload(
            model,
            workload.initial_state[rows],
            workload.control[rows],
            workload.hold,
            workload.seed,
            returns or Product.FINAL,
            workload.lead_in,
        )
        path = paths.find(path_name)
        if reason := path.cannot_run(selected, options):
            raise InputError(reason)
        if not has_timer:
            engine_clock(False)
        self.resources = paths.Resources(selected)
        if nsection > 1:
            self.sections = loop_sections.sections(self.resources, nsection)
            states = States(self.resources.final_state())
        elif selected.lead_in:
            self.sections = [loop_sections.after_lead_in(self.resources)]
            states = States(self.resources.final_state())
        else:
            prepared = path.prepare(selected, options, self.resources)
            self.sections = [loop_sections.LoopSection(prepared.run)]
            states = prepared.verified_states()
        self._check_final_states(f"path {path_name}", states, rows)
        if previous is not None:  # kept until now, so that the new memory lies elsewhere
            previous.close()
        collect_garbage()
        return self._run_all_sections()

    def prepare_section(self, cores: Sequence[int], new: "Callable[[], LoopSection]") -> int:
        """Have blocks run one section, made in fresh memory; return a block's nanoseconds."""
        self.lay_out_memory(cores)
        self.sections = [new()]
        collect_garbage()
        return self._run_all_sections()

    def _run_all_sections(self) -> int:
        """Run one block of each section, and check it; return how many nanoseconds that takes."""
        ns = 0
        for section in self.sections:
            begin = time.perf_counter_ns()
            self._block(section)
            ns += time.perf_counter_ns() - begin
            section.check()
        return ns

    def _check_final_states(self, name: str, states: "States", rows: list[int]) -> None:
        import numpy as np

        assert self.final_state is not None, "a run is prepared from a workload with final states"
        mask = slice(None) if states.mask is None else states.mask
        if not np.array_equal(states.values[mask], self.final_state[rows][mask]):
            raise MachineError(f"{name} does not reach the final states of the plain loop")

    @activity("preparing an operation")
    def prepare_operation(
        self, prepare: "Callable[[], PreparedOperation]", cores: Sequence[int]
    ) -> ReadyOperation:
        """Prepare an operation (see `operations`) in fresh memory, and do it."""
        from mjbench.paired import loop_sections

        self.lay_out_memory(cores)
        prepared = prepare()
        section = loop_sections.LoopSection(prepared.run)
        self.sections = [section]
        result = prepared.result()
        collect_garbage()
        return ReadyOperation(self._block(section), result)

    @activity("running a block")
    def time_blocks(self) -> None:
        """Run a block for every BLOCK byte that follows, until an END byte.

        The first two blocks are of the first section of the run, the next two of the second, and so
        on; after the last section, the first is next. So the blocks of a quad are of one section.
        """
        memory_layout.call_deeper(self.rng.randrange(_DEPTH), self._answer_blocks)

    def _answer_blocks(self) -> None:
        receive, send, pack = (
            self.connection.recv_bytes,
            self.connection.send_bytes,
            NANOSECONDS.pack,
        )
        # a quad has two blocks of this target
        sections = itertools.cycle([section for section in self.sections for _ in range(2)])
        while receive() == BLOCK:
            send(pack(self._block(next(sections))))

    @activity("counting cores")
    def count_cores(self, nthread: int) -> float:
        """Return how many cores `nthread` threads get now (see `machine.Calibration`)."""
        from mjbench.host.machine import Calibration

        calibration = Calibration(nthread)
        seconds = []
        for run in (calibration.single, calibration.together) * 2:
            begin = time.perf_counter()
            run()
            seconds.append(time.perf_counter() - begin)
        return calibration.cores(min(seconds[0::2]), min(seconds[1::2]))

    def _block(self, section: "LoopSection") -> int:
        """Run one block; return its reading, or its nanoseconds."""
        run, clock = section.run, time.perf_counter_ns
        section.warm_up()
        begin = clock()
        run()
        ns = clock() - begin
        return ns if section.reading is None else section.reading()


def collect_garbage() -> None:
    """Collect garbage now, and none while blocks run."""
    gc.collect()
    gc.freeze()  # later collections look only at what the next layout allocates
    gc.disable()


def main(descriptor: int, parent: int) -> None:
    """Do tasks on the inherited socket, for the process `parent`."""
    child.die_with_parent(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.set_inheritable(descriptor, False)  # what a path starts must not hold or write to it
    Worker(Connection(descriptor)).serve()
