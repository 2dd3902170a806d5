"""How often paired comparison is wrong, slow or undecided on this machine, now.

The truth about both targets of a trial is known (see `Case`). Whatever a verdict says
beyond that is an error of measuring.
"""

import contextlib
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from benchmarks.history.speed_series import NO_CHANGE_PAIRS, NoChangePair
from benchmarks.verdicts import planted, records
from benchmarks.verdicts.records import Arm, CaseRow, CaseSummary, TrialRecord
from benchmarks.verdicts.section import describe_case
from mjbench.errors import Failure, InputError, MachineError, failure_of
from mjbench.host import child, platforms
from mjbench.paired import verdict
from mjbench.paired.outcomes import MIN_EFFECT, Cause, Verdict
from mjbench.paired.records import VerdictRecord
from mjbench.paired.targets import Target
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases import release_names
from mjbench.results.runs import Record
from mjbench.session import Item, Items, Measurement, Observer, input_files
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource
from mjbench.status import Status

# The arm of known slowdowns, unless other arms are asked for.
_SLOWDOWNS = (0.0, 0.005, 0.01, 0.02, 0.05)


@dataclass(frozen=True)
class Case:
    """Two targets, and how they differ."""

    arm: Arm
    baseline: Target
    candidate: Target
    slowdown: float = 0.0
    callback: str = ""

    def row(self) -> CaseRow:
        return CaseRow(
            arm=self.arm,
            model=self.candidate.model.name,
            slowdown=None if self.arm == Arm.INSIDE_STEP else self.slowdown,
            callback=self.callback,
            old=self.baseline.release.version,
            new=self.candidate.release.version,
        )


def slowed(model: ModelSource, slowdown: float) -> Case:
    """Return a case in which each block of the candidate lasts longer by a share, such as 0.01.

    Its process spins for that share of the time that the block took. So every slowdown is exact, of
    every model, and blocks do as much work as those of an ordinary comparison. Where the slowdown
    is 0, the targets are identical.
    """
    baseline = _installed(model)
    slower = planted.slowed_run(slowdown) if slowdown else None
    return Case(Arm.SLOWDOWN, baseline, replace(baseline, prepare_run=slower), slowdown)


def inside_step(model: ModelSource, function: str) -> Case:
    """Return a case in which every step of the candidate calls a function of the engine."""
    baseline = _installed(model)
    candidate = replace(baseline, prepare_run=planted.slowed_run(callback=function))
    return Case(Arm.INSIDE_STEP, baseline, candidate, callback=function)


def between_builds(model: ModelSource, pair: NoChangePair) -> Case:
    """Return a case of two releases whose steps execute equally many instructions."""
    baseline, candidate = (
        Target(release_names.parse_release(release), model) for release in (pair.old, pair.new)
    )
    return Case(Arm.BETWEEN_BUILDS, baseline, candidate)


def cases(
    names: Sequence[str], slowdowns: Sequence[float], functions: Sequence[str], builds: bool
) -> list[Case]:
    """Return the cases of models by name; without names, of those that are usual for each arm."""
    few = [models.resolve(name) for name in names or ("cartpole", "humanoid")]
    cases = [slowed(source, share) for source in few for share in slowdowns]
    cases += [inside_step(source, name) for source in few for name in functions]
    if builds:
        sources = [models.resolve(name) for name in names or models.shipped()]
        cases += [between_builds(source, pair) for source in sources for pair in NO_CHANGE_PAIRS]
    return cases


def remaining(cases: Sequence[Case], trials: int, records: Sequence[TrialRecord]) -> Iterator[Case]:
    """Yield a case for each trial to do, in turns, so that a change of the machine hits all."""
    done = Counter(record.case() for record in records)
    for turn in range(trials):
        for case in cases:
            if done[case.row()] <= turn:
                yield case


def _installed(model: ModelSource) -> Target:
    return Target(release_names.parse_release(release_names.INSTALLED), model)


def run(
    pool: WorkerPool, cases: Sequence[Case], plan: VerdictPlan
) -> Iterator[tuple[CaseRow, TrialRecord | Failure]]:
    """Yield a trial of each case, or how it failed.

    A model that failed is not tried again with the same builds and callback.
    """
    failed, shares = set[CaseRow](), plan.budget.divided(len(cases))
    for case in cases:
        row = case.row()
        at_any_slowdown = replace(row, slowdown=None)
        if at_any_slowdown in failed:
            continue
        try:
            yield row, trial(pool, case, replace(plan, time_limit_s=shares.next_s()))
        except (InputError, MachineError) as error:
            failed.add(at_any_slowdown)
            yield row, failure_of(error)


def trial(pool: WorkerPool, case: Case, plan: VerdictPlan) -> TrialRecord:
    return record_of(case, verdict.decide_pair(pool, case.baseline, case.candidate, plan))


def record_of(case: Case, row: VerdictRecord) -> TrialRecord:
    """Return the record of a trial.

    Raises:
      InputError: a target cannot do the work.
      MachineError: a target failed, or time ran out before the first launch.
      KeyboardInterrupt: it was interrupted.
    """
    if row.status == Status.INTERRUPTED:
        raise KeyboardInterrupt
    if row.status != Status.OK or row.verdict is None or row.ratio is None:
        raise (InputError if row.status == Status.INPUT else MachineError)(row.detail)
    averaged = row.placement is not None and row.placement.averaged
    used = [launch for launch in row.samples if launch.placements.is_moved == averaged]
    others = [launch for launch in row.samples if launch.placements.is_moved != averaged]
    return TrialRecord(
        **vars(case.row()),
        verdict=row.verdict,
        cause=row.cause,
        estimate=row.ratio.estimate,
        low=row.ratio.low,
        high=row.ratio.high,
        placement=row.placement,
        seconds=row.seconds,
        launches=[round(launch.log_ratio, 7) for launch in used],
        residues=[launch.placements.residue for launch in used] if averaged else [],
        as_shipped=[round(launch.log_ratio, 7) for launch in others],
    )


def summary(trials: Sequence[TrialRecord], min_effect: float = MIN_EFFECT) -> list[CaseSummary]:
    """Return what the trials say, a row for each case, by arm, model and slowdown."""
    groups: dict[tuple[CaseRow, bool], list[TrialRecord]] = {}
    for record in trials:
        groups.setdefault((record.case(), record.averaged), []).append(record)
    rows = [_row(case, averaged, group, min_effect) for (case, averaged), group in groups.items()]
    arms = list(Arm)
    return sorted(rows, key=lambda row: (arms.index(row.arm), row.model, row.slowdown or 0.0))


def _row(
    case: CaseRow, averaged: bool, trials: Sequence[TrialRecord], min_effect: float
) -> CaseSummary:
    def share(test: Callable[[TrialRecord], bool]) -> float:
        return sum(map(test, trials)) / len(trials)

    wrong = {Verdict.FASTER} if case.is_slower else {Verdict.FASTER, Verdict.SLOWER}
    has_cause = averaged and not case.is_slower
    truth = None if case.slowdown is None else 1 + case.slowdown
    measured = float(np.median([t.estimate for t in trials])) - 1
    is_to_find = (measured if case.slowdown is None else case.slowdown) >= min_effect
    variances = [np.var(t.launches, ddof=1) for t in trials if len(t.launches) > 1]
    return CaseSummary(
        **vars(case),
        averaged=averaged,
        problem=next(filter(None, (t.problem for t in trials)), ""),
        trials=len(trials),
        detected=share(lambda t: t.verdict == Verdict.SLOWER),
        wrong=share(lambda t: t.verdict in wrong),
        by_code=share(lambda t: t.cause == Cause.CODE) if has_cause else None,
        by_placement=share(lambda t: t.cause == Cause.PLACEMENT) if has_cause else None,
        measured=measured,
        missed=share(lambda t: t.verdict == Verdict.SAME) if is_to_find else None,
        inconclusive=share(lambda t: t.verdict == Verdict.INCONCLUSIVE),
        covered=None if truth is None else share(lambda t: t.ratio.covers(truth)),
        error=None if truth is None else float(np.mean([t.estimate - truth for t in trials])),
        seconds=float(np.mean([t.seconds for t in trials])),
        launches=float(np.mean([len(t.launches) for t in trials])),
        launch_sd=float(np.sqrt(np.mean(variances))) if variances else None,
    )


@contextlib.contextmanager
def busy_neighbour_core() -> Iterator[None]:
    """Keep the last of this process's cores busy while the block runs."""
    allowed = platforms.affinity()
    if not allowed:
        raise MachineError("--busy cannot work here: this system cannot keep a process on one core")
    core = max(allowed)
    code = f"import os\nos.sched_setaffinity(0, [{core}])\nwhile True: sum(range(100000))"
    spinner = child.Child(  # in a session of its own: Ctrl-C is not for it
        child.ending_with_parent([sys.executable, "-c", code]), stdin=subprocess.DEVNULL
    )
    try:
        yield
    finally:
        spinner.end()


def measurement(
    names: Sequence[str],
    count: int,
    slowdowns: Sequence[float],
    functions: Sequence[str],
    builds: bool,
    is_busy: bool,
    plan: VerdictPlan,
) -> Measurement:
    """Return the measurement of `count` verdicts on each pair of targets that differ as is known.

    Args:
      slowdowns: by how much longer blocks of a candidate last, as shares; without any, functions
        and builds, the usual ones.
      functions: of the engine; another candidate each calls one of them once more in each step.
      between_builds: whether releases of equally many instructions are compared, too.
      is_busy: whether the last core is kept busy meanwhile.
    """
    if not (slowdowns or functions or builds):
        slowdowns = _SLOWDOWNS
    all_cases = cases(names, slowdowns, functions, builds)
    sources = list(dict.fromkeys(case.candidate.model for case in all_cases))

    def items(earlier: Sequence[Record], observer: Observer) -> Items:
        done = [record for record in earlier if isinstance(record, TrialRecord)]
        missing = [*remaining(all_cases, count, done)]
        with busy_neighbour_core() if is_busy else contextlib.nullcontext(), WorkerPool() as pool:
            for number, (case, ended) in enumerate(run(pool, missing, plan), len(done)):
                name = f"{case.model}, {describe_case(case)}"
                if isinstance(ended, Failure):
                    yield Item(failure=Failure(ended.status, f"{name}: {ended.detail}"))
                    continue
                observer(name, (number + 1) / (count * len(all_cases)))
                yield Item([ended])

    return Measurement(
        "verdicts",
        {
            **asdict(plan),
            "trials": count,
            "busy": is_busy,
            "slowdowns": list(slowdowns),
            "models": [source.name for source in sources],
            "inside_step": list(functions),
            "between_builds": builds,
        },
        input_files(sources, [], plan.sizes.starts),
        items,
        notes=platforms.pinning_notes(),
        record_types=records.RECORD_TYPES,
    )
