"""Measure every path on one model, in turns; runs in a child process (see `isolate`).

The order is: load, choose sizes, reference run, then prepare and verify each variant, and only then
time those that agree. Every block's final states are compared again.
"""

import contextlib
import functools
import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mjbench import paths
from mjbench.comparison import step_costs
from mjbench.comparison.messages import (
    BlockDisagreed,
    ClockRoundTimed,
    MeasureRequest,
    ModelReady,
    RoundTimed,
)
from mjbench.comparison.plan import MAY_BE_FASTEST, ComparisonPlan
from mjbench.comparison.sizes import BlockSizes, check_memory, choose_sizes
from mjbench.comparison.verification import FurtherCases, ReferenceCase, verify
from mjbench.errors import MachineError, MjbenchError, describe
from mjbench.instrument import machine, stats, timing
from mjbench.instrument.isolate import Channel
from mjbench.paths.accelerated import save_workload
from mjbench.simulation import agreement, models, sampling, starts, work
from mjbench.simulation.agreement import Difference
from mjbench.simulation.engine_clock import engine_clock, has_clock
from mjbench.simulation.model_digest import model_digest
from mjbench.simulation.model_guard import ModelGuard
from mjbench.simulation.sampling import Sample, SampleRequest

# Timed rounds: half of the budget for all variants, in at least as many rounds as a 95 % interval
# needs; the rest for those that may be the fastest, chosen anew every few rounds, because advice
# has to tell them apart.
MIN_ROUNDS, FINAL_ROUNDS, MAX_ROUNDS = 7, 4, 200
# Rounds with and without MuJoCo's timer: a quarter of the budget, and at least so many.
MIN_CLOCK_ROUNDS = 5
# A child may be silent for this many times as long as its work should take.
PATIENCE = 100


def measure_in_child(request: MeasureRequest, channel: Channel) -> None:
    """Measure one model by every variant of the plan that is not excluded.

    Messages: `ModelReady`, an `AgreementReport` per variant, then `RoundTimed`
    for each round, and `BlockDisagreed` for each variant whose timed block was wrong. The last
    rounds hold only the base and those that may be the fastest (see `finalists`). Where the engine
    has a clock, `ClockRoundTimed` follow.
    """
    plan, name = request.plan, request.source.name
    channel.doing(f"loading {name}")
    model = models.load(request.source)
    channel.doing(f"stepping {name}")
    size_request = plan.size_request(request.workload_file is not None)
    cost_s = step_costs.step_cost_s(
        model_digest(model), functools.partial(sampling.settled_step_s, model)
    )
    sizes = choose_sizes(cost_s, size_request)
    check_memory(model, sizes.nbatch, sizes.nstep, size_request.nthread, plan.returns)
    max_nstep = starts.max_settling_nstep(cost_s)
    settling_nstep = min(starts.settling_nstep(model, plan.starts), max_nstep)
    patience_per_step_s = PATIENCE * work.step_s(model)
    patience_s = patience_per_step_s * sizes.nbatch * sizes.nstep
    channel.allow_silence(patience_s + patience_per_step_s * settling_nstep)
    sample_request = SampleRequest(
        sizes.nbatch,
        sizes.nstep,
        plan.hold,
        plan.seed,
        plan.starts,
        max_nstep,
        may_shorten=plan.nstep is None,
    )
    sample = sampling.draw(model, sample_request)
    workload, observation = sample.workload.returning(plan.returns), sample.observation
    if request.workload_file:
        save_workload(workload, observation.peaks, request.workload_file)
    case = ReferenceCase.create(workload, observation)
    channel.send(_model_ready(case, sizes, sample))
    further = FurtherCases.create(case, cost_s)
    guard = ModelGuard(model)
    prepared_by_index: dict[int, paths.Prepared] = {}
    for index, variant in enumerate(plan.variants):
        if index in request.exclude:
            continue
        channel.doing(f"preparing {variant} on {name}", index)
        channel.allow_silence(patience_s)
        report, prepared = verify(index, variant, case, further)
        _check_model(guard)
        channel.send(report)
        if prepared is not None:
            prepared_by_index[index] = prepared
    further.close()
    if prepared_by_index:
        channel.allow_silence(patience_s * len(prepared_by_index))
        _time(prepared_by_index, case, guard, plan, channel)
    case.resources.close()


def _check_model(guard: ModelGuard) -> None:
    """Raise MachineError where the path of the moment has changed the model."""
    field = guard.change()
    if field:
        raise MachineError(f"changes the model, which all paths share: {field}")


def _model_ready(case: ReferenceCase, sizes: BlockSizes, sample: Sample) -> ModelReady:
    workload, observation = case.workload, case.observation
    return ModelReady(
        facts=work.describe(workload.model),
        nbatch=workload.nbatch,
        nstep=workload.nstep,
        hold=workload.hold,
        returns=workload.returns,
        seed=workload.seed,
        reduced=sizes.reduced,
        diverged=sizes.nbatch - workload.nbatch,
        divergence=observation.diagnosis(),
        warnings=observation.other_warnings(),
        spread=sample.spread,
        starts=sample.starts,
        workload_digest=workload.digest(),
        state_digest=agreement.digest(observation.final_state),
        start_contacts=observation.start_contacts,
        work=observation.work,
    )


def _time(
    prepared_by_index: Mapping[int, paths.Prepared],
    case: ReferenceCase,
    guard: ModelGuard,
    plan: ComparisonPlan,
    channel: Channel,
) -> None:
    """Time the prepared variants in turns, comparing the final states of every block."""
    timer = _RoundTimer(prepared_by_index, case, guard, plan, channel)
    round_s = timer.warm_up()
    end = time.perf_counter() + plan.budget_s
    budget_s = plan.budget_s / 2 if plan.narrows else plan.budget_s
    timer.run(list(prepared_by_index), budget_s, MIN_ROUNDS, MAX_ROUNDS)
    if plan.narrows:
        _time_finalists(timer, plan, end, round_s)
    if plan.times_clock:
        timer.run_without_clock(plan.budget_s / 4)
    for index, difference in timer.differences.items():
        channel.send(BlockDisagreed(index, f"in a timed block: {difference}"))


def _time_finalists(timer: "_RoundTimer", plan: ComparisonPlan, end: float, round_s: float) -> None:
    """Time the plain loop, and the variants that may be the fastest, until the budget is used."""
    prepared_by_index = timer.prepared_by_index
    timer.channel.doing("choosing what to time further")
    base = [i for i in prepared_by_index if plan.variants[i].path == paths.BASE]
    # the plain loop with options is no path to be advised
    open_loop = [i for i in prepared_by_index if i not in base or not plan.variants[i].options]
    closed_loop = [i for i in open_loop if paths.find(plan.variants[i].path).closed_loop]
    remaining = finalists(timer.rounds, [open_loop, closed_loop], base)
    while len(remaining) > len(base) and len(timer.rounds) < 2 * MAX_ROUNDS:
        timer.run(remaining, end - time.perf_counter(), FINAL_ROUNDS, FINAL_ROUNDS)
        if time.perf_counter() >= end - round_s:
            break
        groups = [[i for i in group if i in remaining] for group in (open_loop, closed_loop)]
        remaining = finalists(timer.rounds, groups, base)


@dataclass
class _RoundTimer:
    """Times rounds of variants, with a calibration of the cores in each.

    Simulations are reordered before each round, so that the output of an earlier one is wrong.

    Attributes:
      prepared_by_index: the variants that agree.
      case: that they run.
      guard: of the model, which no path may change.
      plan: of the comparison.
      channel: to the parent.
      rounds: seconds by variant, a dictionary a round.
      differences: the first of each variant whose timed block was wrong.
    """

    prepared_by_index: Mapping[int, paths.Prepared]
    case: ReferenceCase
    guard: ModelGuard
    plan: ComparisonPlan
    channel: Channel
    rounds: list[dict[int, float]] = field(default_factory=list)
    differences: dict[int, Difference] = field(default_factory=dict)

    def __post_init__(self) -> None:
        nthread = self.plan.size_request(has_accelerated=False).nthread
        cores = min(machine.usable_cores(), nthread)
        self._calibration = machine.Calibration(cores) if cores > 1 else None
        self._patience_s = 0.0
        self._rng = np.random.default_rng([self.plan.seed, 4])
        self._contenders = {
            index: timing.Contender(
                prepared.run,
                before=functools.partial(self._before, index, prepared),
                after=functools.partial(self._after, index, prepared),
            )
            for index, prepared in self.prepared_by_index.items()
        }

    def warm_up(self) -> float:
        """Time each contender once; return the seconds of all blocks together."""
        contenders = [*self._contenders.values(), *self._calibration_contenders()]
        with _failures_reported():
            round_s = sum(timing.block_s(contender) for contender in contenders)
        self._patience_s = PATIENCE * round_s
        self.channel.allow_silence(self._patience_s)
        return round_s

    def run(
        self, indices: Sequence[int], budget_s: float, min_rounds: int, max_rounds: int
    ) -> None:
        """Time rounds of these variants; send each, and add it to `rounds`."""
        contenders = [*(self._contenders[i] for i in indices), *self._calibration_contenders()]
        seed = self.plan.seed + len(self.rounds)
        for seconds in self._reordered(
            timing.rounds(contenders, budget_s, min_rounds, max_rounds, seed)
        ):
            cores = 1.0
            if self._calibration:
                cores = self._calibration.cores(single_s=seconds[-2], together_s=seconds[-1])
            # the calibration's two blocks come after the variants'
            self.rounds.append(dict(zip(indices, seconds[: len(indices)], strict=True)))
            self.channel.send(RoundTimed(self.rounds[-1], cores))

    def run_without_clock(self, budget_s: float) -> None:
        """Time every variant of this process with and without MuJoCo's timer; send each round."""
        model = self.case.workload.model
        indices = [i for i in self._contenders if self._variant_path(i).in_process]
        if not indices or not has_clock(model):
            return
        with_clock = [self._contenders[i] for i in indices]
        without_clock = [_without_clock(contender) for contender in with_clock]
        contenders = [*with_clock, *without_clock]
        seed = self.plan.seed + len(self.rounds)
        for seconds in self._reordered(
            timing.rounds(contenders, budget_s, MIN_CLOCK_ROUNDS, MAX_ROUNDS, seed)
        ):
            halves = seconds[: len(indices)], seconds[len(indices) :]
            with_s, without_s = (dict(zip(indices, half, strict=True)) for half in halves)
            self.channel.send(ClockRoundTimed(with_s, without_s))

    def _reordered(self, rounds: Iterator[list[float]]) -> Iterator[list[float]]:
        """Yield rounds, with the simulations reordered before each."""
        while True:
            self.channel.allow_silence(self._patience_s)
            self.case.reorder(self._rng)
            with _failures_reported():
                seconds = next(rounds, None)
            if seconds is None:
                return
            yield seconds

    def _variant_path(self, index: int) -> paths.SteppingPath:
        return paths.find(self.plan.variants[index].path)

    def _calibration_contenders(self) -> list[timing.Contender]:
        if self._calibration is None:
            return []
        runs = (self._calibration.single, self._calibration.together)
        return [timing.Contender(run, before=self._before_calibration) for run in runs]

    def _before_calibration(self) -> None:
        self.channel.doing("counting cores")

    def _before(self, index: int, prepared: paths.Prepared) -> None:
        self.channel.doing(f"timing {self.plan.variants[index]}", index)
        prepared.clear()

    def _after(self, index: int, prepared: paths.Prepared) -> None:
        _check_model(self.guard)
        difference = self.case.difference(prepared.final_states(), prepared)
        if difference:
            self.differences.setdefault(index, difference)


def _without_clock(contender: timing.Contender) -> timing.Contender:
    """Return a contender that runs without MuJoCo's timer, which is on before and after."""

    def before() -> None:
        contender.before()
        engine_clock(False)

    def after() -> None:
        engine_clock(True)
        contender.after()

    return timing.Contender(contender.run, before, after)


@contextlib.contextmanager
def _failures_reported() -> Iterator[None]:
    """Report whatever a timed path raises as a failure, which costs its own row."""
    try:
        yield
    except MjbenchError:
        raise
    except BaseException as error:  # it may be SystemExit
        raise MachineError(describe(error)) from error


def finalists(
    rounds: Sequence[Mapping[int, float]], groups: Sequence[Sequence[int]], always: Sequence[int]
) -> list[int]:
    """Return the variants that may be the fastest of a group, and those of `always`.

    A variant may be the fastest unless its speed is less than MAY_BE_FASTEST of that of the group's
    fastest, and the 95 % interval is, too.

    Args:
      rounds: seconds by variant; one that is missing from a round is missing from all later ones.
      groups: variants that compete with each other.
      always: variants that stay whatever their speed.
    """
    seconds = {i: [r[i] for r in rounds if i in r] for group in groups for i in group}
    remaining = set(always)
    for group in groups:
        if not group:
            continue
        fastest = min(group, key=lambda i: statistics.median(seconds[i]))
        for i in group:
            lead = stats.speedup_in_common(seconds[i], seconds[fastest])
            if i == fastest or lead.low is None or lead.low <= 1 / MAY_BE_FASTEST:
                remaining.add(i)
    return sorted(remaining)
