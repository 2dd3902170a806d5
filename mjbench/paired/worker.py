"""The process of one target: it prepares runs and times blocks as `protocol` asks.

Where code and data lie in memory decides 1 % of a process's speed, sometimes 3 %, for all its life,
and one layout is not a sample. So each launch is a new process, which maps MuJoCo's libraries
behind a random amount of other memory. Several times per launch it allocates model, data and
controls anew in the same way, and runs at a random depth of the stack. Both targets of a launch
draw the same (see `launch_seeds`). (Where processes were forked after MuJoCo was imported, all of
one parent shared an offset of 0.5 %, once of 3 %. So `fork_server` forks them before.)

This module runs inside the environment of any one release: it needs only the standard library,
NumPy and MuJoCo, and imports MuJoCo after it has mapped that other memory.
"""

import copy
import gc
import itertools
import mmap
import os
import pickle
import random
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjbench.errors import InputError, MachineError, failure_of
from mjbench.instrument import child, platforms
from mjbench.paired import requests
from mjbench.paired.outcomes import Metric
from mjbench.paired.requests import BLOCK, NANOSECONDS, Done, Request

if TYPE_CHECKING:
    import mujoco
    import numpy as np

    from mjbench.paired.loop_sections import Section
    from mjbench.paired.race_blocks import RaceBlocks
    from mjbench.paired.single_steps import TimedSteps
    from mjbench.paths import Resources, States
    from mjbench.simulation.workload import PortableWorkload, Workload

# Random allocations before each layout: how many, and the largest of each kind, in bytes.
_SMALL, _SMALL_BYTES = 400, 4096
_LARGE, _LARGE_BYTES = 8, 1 << 21
# What moves the memory of a layout is freed after as many more of them.
_SCATTERED_LAYOUTS = 12
# A layout runs below fewer frames of the C stack than this.
_DEPTH = 24
# Memory mapped before MuJoCo's libraries are: fewer pieces, each of fewer pages, than these. Linux
# maps large libraries at multiples of 2 MiB; so the pieces are large, and nothing uses them.
_MAPS, _MAP_PAGES = 8, 1 << 14


class Worker:
    """What the process of one target holds, and how it answers each request.

    Attributes:
      connection: to the parent.
      model: loaded by LoadModel or Equip.
      workload: restored from a file.
      final_state: (nbatch, nstate) where each simulation of `workload` must end; None if unknown.
      sections: of the run, which blocks time one after the other.
      single_steps: what blocks run where their slowest steps are compared; None elsewhere.
      resources: of that run; None before the first.
      race: the paths of a race's launch; None in other launches.
      slowdown: share of its time by which a block lasts longer.
      padding: memory that moves whatever is allocated after it.
      scattered: the same, of the last layouts.
      rng: draws the padding, and how deep in the stack blocks run.
    """

    model: "mujoco.MjModel"
    workload: "Workload"
    final_state: "np.ndarray | None"

    def __init__(self, connection: Connection):
        self.connection = connection
        self.resources: Resources | None = None
        self.race: RaceBlocks | None = None
        self.slowdown = 0.0
        self.sections: Sequence[Section] = ()
        self.single_steps: TimedSteps | None = None
        self.padding: list[Any] = []
        self.scattered: deque[list[object]] = deque(maxlen=_SCATTERED_LAYOUTS)
        self.rng = random.Random()
        self._handlers: Mapping[type[Request[Any]], Callable[[Any], Any]] = {
            requests.StartRelease: self._start_release,
            requests.LoadModel: self._load_model,
            requests.SaveModel: self._save_model,
            requests.MeasureStepCost: self._measure_step_cost,
            requests.MeasureSettledCost: self._measure_settled_cost,
            requests.MakeWorkload: self._make_workload,
            requests.Observe: self._observe,
            requests.Trace: self._trace,
            requests.ListFiles: self._list_files,
            requests.Equip: self._equip,
            requests.EquipRace: self._equip_race,
            requests.PrepareEntrant: self._prepare_entrant,
            requests.TimeEntrant: self._time_entrant,
            requests.Prepare: self._prepare,
            requests.PrepareOperation: self._prepare_operation,
            requests.TimeBlocks: self._time_blocks,
            requests.CountCores: self._count_cores,
        }

    def serve(self) -> None:
        """Answer requests until the parent hangs up."""
        while True:
            try:
                request = self.connection.recv()
            except (EOFError, OSError):
                os._exit(0)
            answer: Any
            try:
                answer = Done(self._handlers[type(request)](request))
            except BaseException as error:  # a path of the user's own may raise SystemExit
                answer = failure_of(error)
            try:
                self.connection.send(answer)
            except OSError:  # the parent hung up in the meantime
                os._exit(0)

    def _start_release(self, request: requests.StartRelease) -> None:
        self.rng.seed(request.seed)
        self.padding = [_mapped(self.rng) for _ in range(self.rng.randrange(1, _MAPS))]
        # MuJoCo's types lie elsewhere, too: the bindings look them up by their address
        self.padding += _scattered(self.rng)
        package: Path | None = None
        if request.move is not None:
            movable = pickle.loads(request.move.movable_file.read_bytes())
            move = request.move
            package = movable.use(move.folder, move.others, move.placement)
        import mujoco  # now, so that its libraries lie behind the padding

        imported = Path(mujoco.__file__).parent
        if package is not None and imported != package:
            raise MachineError(f"imported {imported} instead of the moved {package}")
        from mjbench.releases import install_check

        if request.check_files:
            problem = install_check.imported_problem(request.version)
        else:
            problem = install_check.engine_problem(request.version)
        if problem:
            raise MachineError(problem)

    def _load_model(self, request: requests.LoadModel) -> None:
        from mjbench.simulation import model_options, models

        self.model = models.load(models.ModelSource(request.name, request.file))
        for field, text in request.options.items():
            model_options.set_option(self.model, field, text)

    def _save_model(self, request: requests.SaveModel) -> None:
        import mujoco

        mujoco.mj_saveModel(self.model, str(request.file), None)
        # mj_saveModel does not report a disk that is full
        size = request.file.stat().st_size if request.file.exists() else 0
        if size < mujoco.mj_sizeModel(self.model):
            raise MachineError(f"cannot write {request.file}: is the disk full?")

    def _measure_step_cost(self, request: requests.MeasureStepCost) -> requests.StepCost:
        from mjbench.simulation import compat, sampling, starts, work
        from mjbench.simulation.model_digest import model_digest

        return requests.StepCost(
            model_digest(self.model),
            work.step_s(self.model),
            starts.settling_nstep(self.model, request.starts),
            sampling.most_nstep(self.model, request.starts, request.nstart, request.hold),
            compat.has_sleep(self.model),
        )

    def _measure_settled_cost(self, request: requests.MeasureSettledCost) -> float:
        from mjbench.simulation import sampling

        return sampling.settled_step_s(self.model)

    def _make_workload(self, request: requests.MakeWorkload) -> requests.DrawnWorkload:
        from mjbench.comparison.sizes import check_memory
        from mjbench.simulation import sampling, work_check

        check_memory(self.model, request.sample.nbatch, request.sample.nstep)
        sample = sampling.draw(self.model, request.sample)
        return requests.DrawnWorkload(work_check.portable(sample.workload), sample.starts)

    def _observe(self, request: requests.Observe) -> requests.Observed:
        from mjbench.paired import loop_sections
        from mjbench.simulation import work, work_check

        portable = self._read_workload(request.workload_file)
        assert portable.probe is not None, "a workload is drawn with states along it"
        observation = work.observe(self.workload)
        return requests.Observed(
            work=observation.work,
            healthy=observation.healthy,
            diagnosis=observation.diagnosis(),
            warnings=observation.other_warnings(),
            final_state=observation.final_state,
            followed=work_check.follow(self.workload, portable.probe),
            can_divide=loop_sections.can_divide(
                self.workload.only(observation.healthy), request.nsection
            ),
            timestep_s=float(self.model.opt.timestep),
        )

    def _trace(self, request: requests.Trace) -> requests.Traced:
        from mjbench.simulation import rounding_reference

        self._read_workload(request.workload_file)
        return requests.Traced(rounding_reference.trace(self.workload, request.seed))

    def _list_files(self, request: requests.ListFiles) -> tuple[str, ...]:
        from mjbench.simulation import model_files

        return model_files.of(request.file)

    def _equip(self, request: requests.Equip) -> None:
        from mjbench import paths
        from mjbench.simulation import models

        self.model = models.load(models.ModelSource("", request.model_file))
        self._read_workload(request.workload_file)
        paths.find(request.path)  # imports it

    def _equip_race(self, request: requests.EquipRace) -> None:
        import numpy as np

        from mjbench.comparison.verification import ReferenceCase
        from mjbench.paired.race_blocks import RaceBlocks
        from mjbench.simulation import models

        if request.import_from:
            sys.path.append(request.import_from)
        self._lay_out_memory(request.cores)
        self.model = models.load(models.ModelSource("", request.model_file))
        self._read_workload(request.workload_file)
        assert self.final_state is not None, "a race is run with final states to compare"
        rng = np.random.default_rng(self.rng.randrange(2**32))
        workload = self.workload.returning(request.returns)
        self.race = RaceBlocks(ReferenceCase.of_states(workload, self.final_state), rng)

    def _prepare_entrant(self, request: requests.PrepareEntrant) -> None:
        assert self.race is not None, "EquipRace comes first"
        self.scattered.append(_scattered(self.rng))
        self.race.prepare(request)

    def _time_entrant(self, request: requests.TimeEntrant) -> requests.TimedEntrant:
        assert self.race is not None, "EquipRace comes first"
        if request.reorders:
            _collect_garbage()
        return self.race.time(request)

    def _read_workload(self, file: Path) -> "PortableWorkload":
        from mjbench.simulation import workload

        portable: PortableWorkload = pickle.loads(file.read_bytes())
        self.workload = workload.restore(self.model, portable)
        self.final_state = portable.final_state
        return portable

    def _lay_out_memory(self, cores: Sequence[int]) -> None:
        """Run on these cores from now on, and allocate what follows elsewhere."""
        if cores:
            platforms.set_affinity(0, cores)
        self.scattered.append(_scattered(self.rng))

    def _prepare(self, request: requests.Prepare) -> int:
        from mjbench import paths
        from mjbench.paired import loop_sections
        from mjbench.paths import States
        from mjbench.simulation import engine_library
        from mjbench.simulation.engine_clock import engine_clock
        from mjbench.simulation.workload import Product, Workload

        self._lay_out_memory(request.cores)
        model = copy.copy(self.model)
        workload, previous, rows = self.workload, self.resources, list(request.simulations)
        selected = Workload(
            model,
            workload.initial_state[rows],
            workload.control[rows],
            workload.hold,
            workload.seed,
            request.returns or Product.FINAL,
            workload.lead_in,
        )
        path = paths.find(request.path)
        reason = path.unavailable() or path.cannot_return(selected.returns)
        reason = reason or path.unsuited(selected, request.options)
        if reason:
            raise InputError(reason)
        if request.callback:
            engine_library.install_callback(model, request.callback)
        if not request.has_timer:
            engine_clock(False)
        self.slowdown = request.slowdown
        self.resources = paths.Resources(selected)
        self.single_steps = None
        name = f"path {request.path}"
        if request.callback:
            name += f" with {request.callback} called inside each step"
        if request.metric == Metric.P99:
            self.single_steps, states = _single_steps(selected)
            self.sections = [loop_sections.Section(self.single_steps.run)]
        elif request.nsection > 1:
            self.sections = loop_sections.sections(self.resources, request.nsection)
            states = States(self.resources.final_state())
        elif selected.lead_in:
            self.sections = [loop_sections.after_lead_in(self.resources)]
            states = States(self.resources.final_state())
        else:
            prepared = path.prepare(selected, request.options, self.resources)
            self.sections = [loop_sections.Section(prepared.run)]
            states = prepared.verified_states()
        self._check_final_states(name, states, rows)
        if previous is not None:  # kept until now, so that the new memory lies elsewhere
            previous.close()
        _collect_garbage()
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
        """Raise MachineError where a run ends in other states than the plain loop."""
        import numpy as np

        assert self.final_state is not None, "a run is prepared from a workload with final states"
        mask = slice(None) if states.mask is None else states.mask
        if not np.array_equal(states.values[mask], self.final_state[rows][mask]):
            raise MachineError(f"{name} does not reach the final states of the plain loop")

    def _prepare_operation(self, request: requests.PrepareOperation) -> requests.ReadyOperation:
        from mjbench.paired import loop_sections, operations

        self._lay_out_memory(request.cores)
        prepared = operations.registry()[request.name].prepared(request.file)
        section = loop_sections.Section(prepared.run)
        self.sections = [section]
        result = prepared.result()
        _collect_garbage()
        return requests.ReadyOperation(self._block(section), result)

    def _time_blocks(self, request: requests.TimeBlocks) -> None:
        _call_deeper(self.rng.randrange(_DEPTH), self._answer_blocks)

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

    def _count_cores(self, request: requests.CountCores) -> float:
        from mjbench.instrument.machine import Calibration

        calibration = Calibration(request.nthread)
        seconds = []
        for run in (calibration.single, calibration.together) * 2:
            begin = time.perf_counter()
            run()
            seconds.append(time.perf_counter() - begin)
        return calibration.cores(min(seconds[0::2]), min(seconds[1::2]))

    def _block(self, section: "Section") -> int:
        """Run one block; return its nanoseconds, slowdown included, or those of its slow steps."""
        run, clock = section.run, time.perf_counter_ns
        section.warm_up()
        begin = clock()
        run()
        ns = clock() - begin
        if self.single_steps is not None:
            return self.single_steps.p99_ns()
        if self.slowdown:
            ns = round((1 + self.slowdown) * ns)
            while clock() < begin + ns:
                pass
        return ns


def _single_steps(workload: "Workload") -> "tuple[TimedSteps, States]":
    """Return steps that are timed one by one, and the states that a first run ended in."""
    from mjbench.paired.single_steps import TimedSteps
    from mjbench.paths import States

    single_steps = TimedSteps(workload)
    single_steps.run()
    return single_steps, States(single_steps.final_state)


def _collect_garbage() -> None:
    """Collect garbage now, and none while blocks run."""
    gc.collect()
    gc.freeze()  # later collections look only at what the next layout allocates
    gc.disable()


def _mapped(rng: random.Random) -> mmap.mmap:
    """Map a random number of pages, which move whatever is mapped after them."""
    size = mmap.PAGESIZE * rng.randrange(1, _MAP_PAGES)
    flags = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
    return mmap.mmap(-1, size, flags=flags, prot=mmap.PROT_READ)  # takes up no memory


def _scattered(rng: random.Random) -> list[object]:
    """Return blocks of memory that move whatever is allocated after them to random places."""
    import numpy as np

    small = [bytearray(rng.randrange(16, _SMALL_BYTES)) for _ in range(_SMALL)]
    # of NumPy, which writes nothing to them: that would take 5 ms
    large = [np.empty(rng.randrange(1 << 12, _LARGE_BYTES), np.uint8) for _ in range(_LARGE)]
    # half of them are freed at once: holes that the allocator fills with some of what comes next
    return [*rng.sample(small, _SMALL // 2), *rng.sample(large, _LARGE // 2)]


def _call_deeper(levels: int, function: Callable[[], None]) -> None:
    """Call `function` below `levels` further frames of the C stack."""
    if levels == 0:
        function()
    else:
        # Since Python 3.11 a call from Python to Python adds no frame to the C stack. `map` is
        # written in C and calls back into Python, so each level adds frames of C.
        list(map(lambda _: _call_deeper(levels - 1, function), (None,)))  # noqa: C417


def main(descriptor: int, parent: int) -> None:
    """Answer requests on the inherited socket, for the process `parent`."""
    child.die_with_parent(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.set_inheritable(descriptor, False)  # what a path starts must not hold or write to it
    Worker(Connection(descriptor)).serve()
