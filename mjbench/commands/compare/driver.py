"""Compare the paths of a model: verify all, race those that run C, measure those that compile.

The parent never loads a model. A child verifies all paths (`verification.path_verification`): its
messages are gathered, and the model's records are known when it ends, however it ends. A path that
kills the child loses its own row; the child is started again without it. The launches of the race
do the verified work (see `paired.race`). Accelerated paths, which compile first, are measured alone
(see `compare.accelerated_measurement`).
"""

import itertools
import math
import sys
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from mjbench import paths
from mjbench.commands.compare import accelerated_measurement
from mjbench.commands.compare import show as report
from mjbench.commands.compare.accelerated_measurement import AcceleratedRequest
from mjbench.commands.compare.options import RL_HOLD, CompareOptions
from mjbench.commands.compare.results import ModelResults, derive_all
from mjbench.commands.shared_options import check_holds
from mjbench.errors import Failure, InputError, failure_of
from mjbench.host import isolate, machine
from mjbench.host.disturbance import Watch
from mjbench.measuring.budget import Budget, Shares
from mjbench.paired import launches
from mjbench.paired.race import RaceBudget, RaceLaunches, RaceRule, enter
from mjbench.paired.race_record import RaceRecord
from mjbench.paired.worker_pool import WorkerPool
from mjbench.results.runs import Record, to_json
from mjbench.session import Item, Items, Measurement, Observer
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import Product
from mjbench.status import FINISHED, Status
from mjbench.verification import selection
from mjbench.verification.path_verification import AgreementReport, ModelFiles, verify_in_child
from mjbench.verification.plan import ComparisonPlan
from mjbench.verification.records import ModelRecord, VariantRecord

# Share of a model's progress that verification stands for; the race is the rest.
_VERIFICATION_SHARE = 0.2


def plans_of(options: CompareOptions) -> list[ComparisonPlan]:
    """Return a plan for each number of simulations."""
    hold = options.hold or (RL_HOLD if options.rl else 1)
    if options.rl:
        selection.check_for_rl(options.paths or ())
        if options.nstep:
            raise InputError("--rl takes the steps of one action a call: give --hold, not --nstep")
    check_holds(options.nstep, hold)
    names, threads, choices = options.paths or [], options.threads, list(options.options or ())
    plan = ComparisonPlan(
        variants=(),
        nstep=hold if options.rl else options.nstep,
        hold=hold,
        seed=options.seed,
        starts=options.starts,
        returns=Product(options.returns),
        budget_s=options.budget.each_s,
        must_end=options.budget_s is not None,
        limit_s=options.time_limit_s,
        import_from=_own_path_folder(names),
        named=tuple(name for name in names if name != selection.USUAL_PATHS),
        total_steps=options.total_steps,
    )
    if options.scaling:
        names = names or list(selection.SCALING_PATHS)
        threads = threads or selection.scaling_threads()
        if not any(choice.startswith("chunk=") for choice in choices):
            choices.append(selection.SCALING_CHUNKS)
    return selection.plans(plan, names, threads, choices, options.nbatch, options.rl)


def _own_path_folder(path_names: Sequence[str]) -> str | None:
    """Return the folder of the user's own paths, for child processes; None without such paths."""
    folders = set()
    for name in path_names:
        module_name, colon, _ = name.partition(":")
        if not colon:
            continue
        paths.find(name)
        file = getattr(sys.modules[module_name], "__file__", None)
        if file is None or module_name == "__main__":
            raise InputError(
                f"path {name}: child processes can import it from a module's file only"
            )
        is_package = hasattr(sys.modules[module_name], "__path__")
        folders.add(str(Path(file).resolve().parents[module_name.count(".") + is_package]))
    if len(folders) > 1:
        raise InputError(f"paths of your own must lie in one folder, not in {', '.join(folders)}")
    return folders.pop() if folders else None


def measurement(
    sources: Sequence[ModelSource], plans: Sequence[ComparisonPlan], budget: Budget
) -> Measurement:
    """Return the measurement of each model at one size after the other, which `plans` differ in."""
    arguments = {**to_json(plans[0]), "models": [source.name for source in sources]}
    arguments |= {"nbatch": [plan.nbatch for plan in plans], "total_s": budget.total_s}
    files = [source.path for source in sources]
    files += paths.user_module_files(variant.path for variant in plans[0].variants)
    files += plans[0].starts.files

    def measure(earlier: Sequence[Record], observer: Observer) -> Items:
        count = len(sources) * len(plans)
        remaining = budget.divided(count - len(derive_all(earlier)), observer.begin)
        with WorkerPool(plans[0].limit_s) as pool:
            for position, source in enumerate(sources):
                shares = [(position * len(plans) + i) / count for i in range(len(plans) + 1)]
                yield from measure_model(pool, source, plans, shares, earlier, observer, remaining)

    return Measurement(
        "compare",
        arguments,
        files,
        measure,
        lambda records: finished(records, len(plans[0].variants)),
    )


def measure_model(
    pool: WorkerPool,
    source: ModelSource,
    plans: Sequence[ComparisonPlan],
    shares: Sequence[float],
    earlier: Sequence[Record],
    observer: Observer,
    time_shares: Shares | None = None,
) -> Items:
    """Yield what a model comes to at one size after the other.

    Ctrl-C ends it with what is known then. Where a size was complete, so that no record says that
    it was interrupted, KeyboardInterrupt follows.

    Args:
      shares: of all work that is done before each plan, and after the last.
      time_shares: of the time of the command; None where plans have their own.
    """
    of_sizes, stored = list[Record](), derive_all(earlier)
    for plan, of_work in zip(plans, itertools.pairwise(shares), strict=True):
        size, is_interrupted = (source.name, plan.nbatch), False
        known = next((each for each in stored if each.model.size == size), None)
        if known is None:
            budget_s = time_shares.next_s() if time_shares else plan.budget_s
            timed = replace(plan, budget_s=budget_s)
            compared = ComparedModel(pool, source, timed, of_work, of_sizes, observer)
            try:
                compared.run()
            except KeyboardInterrupt:
                is_interrupted = True
            known = compared.known()
        of_sizes += known.records
        yield Item(known.records, is_part=plan is not plans[-1])
        if known.model.status == Status.INTERRUPTED:
            return
        if is_interrupted:
            raise KeyboardInterrupt


def finished(records: Sequence[Record], nvariant: int) -> list[Record]:
    """Return the records of models that are not measured again: all ended, none by a failure."""
    done: list[Record] = []
    for known in derive_all(records):
        raced = [m for m in known.measurements if m.status == Status.OK and not m.samples_s]
        if raced and known.race is None:  # the last line of the file was cut short
            continue
        is_finished = all(each.status in FINISHED for each in known.records)
        if len(known.measurements) == nvariant and is_finished:
            done += known.records
    return done


class ComparedModel:
    """One model at one size, while its paths are compared."""

    def __init__(
        self,
        pool: WorkerPool,
        source: ModelSource,
        plan: ComparisonPlan,
        shares: tuple[float, float],
        of_sizes: Sequence[Record],
        observer: Observer,
    ):
        """Start nothing yet.

        Args:
          shares: of all work that is done before it, and after it.
          of_sizes: what is known of the model at other sizes, which is shown, too.
        """
        self._pool, self._plan, self._name = pool, plan, source.name
        self._shares, self._of_sizes, self._observer = shares, of_sizes, observer
        self._begin_s, self._watch = time.monotonic(), Watch()
        self._children = ModelChildren(source, plan, ModelFiles.in_folder(pool.new_folder()))
        self._race: RaceRecord | None = None
        self._is_complete = False

    def run(self) -> None:
        """Verify that paths agree, race those that run C, and measure those that compile.

        Raises:
          KeyboardInterrupt: what is known may be all there is.
        """
        try:
            self._observer.begin(f"{self._name}: checking agreement")
            ended = self._children.verify(self._show_verifying)
            verified_s = time.monotonic() - self._begin_s
            if ended.status == Status.OK:
                self._run_race(verified_s)
                self._run_accelerated()
            self._is_complete = True
            self._show_known()
            self._observer(self._name, self._shares[1])
        except KeyboardInterrupt:
            if not self._is_complete:
                self._children.ended = None
            raise

    def known(self) -> ModelResults:
        """Return what is known now: all there is once `run` has ended."""
        timed: list[int] = []
        if self._race is not None:
            positions = {i for launch in self._race.launches for i in launch.variants}
            timed = [self._plan.variants.index(self._race.variants[i]) for i in positions]
        measurements = self._children.measurements(timed, self._is_complete)
        return ModelResults(self._children.model_record(), measurements, self._race)

    def _run_race(self, verified_s: float) -> None:
        agreeing = self._children.agreeing
        if 0 not in agreeing:  # the plain loop
            return
        variants = [self._plan.variants[i] for i in agreeing]
        compiling = len(self._plan.accelerated) if self._plan.must_end else 0
        budget = RaceBudget(self._begin_s + self._plan.budget_s / (1 + compiling))
        # a launch takes about as long as the agreement check: each runs every path a few times
        expected_s = max(1.0, verified_s, budget.left_s())
        racing = f"racing {len(variants)} paths, about {expected_s:.0f} s"
        if budget.left_s() < verified_s:
            racing += ": one launch takes longer than is left of the budget"
        phase = racing if len(variants) > 1 else "timing the plain loop"
        self._observer.begin(f"{self._name}: {phase}")
        rule = RaceRule(enter(self._children.model_record(), variants), budget)
        targets = RaceLaunches(self._pool, self._name, self._plan, self._children.files, variants)
        rule.end(launches.launch(targets, rule, lambda: self._take_race(rule.record)))
        self._take_race(rule.record)
        if rule.record.status == Status.INTERRUPTED:
            raise KeyboardInterrupt

    def _take_race(self, record: RaceRecord) -> None:
        """Take what a race has come to, and show it."""
        self._race = replace(record, disturbance=self._watch.look())
        for unable in record.unable:
            index = self._plan.variants.index(record.variants[unable.variant])
            self._children.revise(index, unable.status, unable.detail)
        spent = (time.monotonic() - self._begin_s) / self._plan.budget_s
        left = len(record.launches[-1].variants) if record.launches else len(record.variants)
        text = f"{self._name}: launch {len(record.launches)}, {left} paths left"
        self._show_progress(text, min(1.0, max(_VERIFICATION_SHARE, spent)))
        self._show_known()

    def _run_accelerated(self) -> None:
        for number, index in enumerate(self._plan.accelerated):
            now_s, end_s = time.monotonic(), math.inf
            if self._plan.must_end:
                left_s = self._begin_s + self._plan.budget_s - now_s
                end_s = now_s + left_s / (len(self._plan.accelerated) - number)
            phase = f"{self._name}: {self._plan.variants[index]}"
            self._observer.begin(phase)
            self._show_progress(phase, 1.0)
            self._children.run_accelerated(index, end_s)
            self._show_known()

    def _show_verifying(self) -> None:
        share_verified = len(self._children.measured) / len(self._plan.variants)
        text = f"{self._name}: do all paths agree?"
        self._show_progress(text, _VERIFICATION_SHARE * share_verified)

    def _show_progress(self, text: str, share: float) -> None:
        begin, end = self._shares
        self._observer(text, begin + share * (end - begin))

    def _show_known(self) -> None:
        records = [*self._of_sizes, *self.known().records]
        self._observer.show(lambda: report.section_so_far(derive_all(records)))


@dataclass
class ModelChildren:
    """The children of one model's comparison, and what they have said so far.

    Attributes:
      ended: how the last child ended that every path needs; None before, and after Ctrl-C.
      measured: of variants, by their positions in the plan.
    """

    source: ModelSource
    plan: ComparisonPlan
    files: ModelFiles
    reference: ModelRecord | None = None
    ended: isolate.Ended | None = None
    measured: dict[int, VariantRecord] = field(default_factory=dict)

    @property
    def agreeing(self) -> list[int]:
        return [
            position
            for position, record in sorted(self.measured.items())
            if record.status == Status.OK and not record.is_accelerated
        ]

    def verify(self, on_message: Callable[[], None] = lambda: None) -> isolate.Ended:
        """Verify all paths that run C; start again without a path that ended the child."""

        def receive(message: ModelRecord | AgreementReport) -> None:
            if isinstance(message, ModelRecord):
                self.reference = message
            else:
                self.measured[message.position] = replace(
                    self._blank(message.position, message.status, message.detail),
                    agrees=message.agrees,
                    agreement=message.agreement,
                    snippet=message.snippet,
                )
            on_message()

        # the child works in a folder of its own
        source = ModelSource(self.source.name, self.source.path.resolve())
        fatal: dict[int, VariantRecord] = {}
        while True:
            excluded = frozenset([*fatal, *self.plan.accelerated])
            ended = isolate.run(
                verify_in_child,
                (source, self.plan, excluded, self.files),
                receive,
                self.plan.limit_s,
                self.plan.import_from,
            )
            culprit = self._culprit(ended)
            if culprit is None:
                self.ended = ended
                return ended
            fatal[culprit] = self._blank(culprit, ended.status, ended.detail)
            self.measured = dict(fatal)

    def _culprit(self, ended: isolate.Ended) -> int | None:
        """Return the variant that ended the child, if one did and the others can go on."""
        position = ended.position
        if position is None or self.plan.variants[position].path == paths.BASE:
            return None
        record = self.measured.get(position)
        # a variant that was already refused is not timed, so another one ended the child
        return position if record is None or record.status == Status.OK else None

    def _blank(self, position: int, status: Status, detail: str) -> VariantRecord:
        variant = self.plan.variants[position]
        return VariantRecord.of(self.source.name, variant, status, detail)

    def revise(self, position: int, status: Status, detail: str) -> None:
        """Change what became of a variant after the fact; its snippet and check stay."""
        record = self.measured.get(position) or self._blank(position, status, detail)
        if status == Status.DISAGREES:
            record = replace(record, agrees=False, agreement=detail)
        self.measured[position] = replace(record, status=status, detail=detail)

    def run_accelerated(self, position: int, end_s: float = math.inf) -> None:
        """Measure one accelerated path alone; whatever becomes of it costs its own row.

        Args:
          end_s: when it must have ended, by the monotonic clock.
        """
        variant, begin_s = self.plan.variants[position], time.monotonic()

        def receive(record: VariantRecord) -> None:
            self.measured[position] = record

        request = AcceleratedRequest(
            self.source,
            variant,
            self.files.accelerated,
            is_named=variant.path in self.plan.named,
            limit_s=self.plan.limit_s,
            end_s=end_s,
        )
        try:
            ended = accelerated_measurement.run(request, receive, self.plan.import_from)
        except Exception as error:  # a path's own `environment` may raise anything
            failure = failure_of(error)
            ended = isolate.Ended(failure.status, failure.detail)
        if ended.status != Status.OK:
            compiled = self.measured.get(position)
            has_compiled = compiled is not None and compiled.compile_s is not None
            if ended.status == Status.TIMEOUT and not has_compiled:
                now_s = time.monotonic()
                is_silent = now_s < end_s
                more = (
                    f"--time-limit {2 * self.plan.limit_s:g}" if is_silent else "twice the --budget"
                )
                detail = accelerated_measurement.not_compiled(now_s - begin_s, more)
                ended = replace(ended, detail=detail)
            self.revise(position, ended.status, ended.detail)

    def model_record(self) -> ModelRecord:
        ended = self.ended or Failure(Status.INTERRUPTED, "")
        return replace(
            self.reference or ModelRecord(model=self.source.name, status=ended.status),
            status=ended.status,
            detail=ended.detail,
            nbatch_asked=self.plan.nbatch,
            usable_cores=machine.usable_cores(),
            total_steps=self.plan.total_steps,
        )

    def measurements(self, timed: Collection[int], is_over: bool) -> tuple[VariantRecord, ...]:
        """Return the records of all variants, in the plan's order; a race has timed some."""
        untimed = self._untimed(is_over)
        records = []
        for position in range(len(self.plan.variants)):
            record = self.measured.get(position)
            if record is None:
                record = self._blank(position, untimed.status, untimed.detail)
            elif record.status == Status.OK and position not in timed and not record.samples_s:
                record = replace(record, status=untimed.status, detail=untimed.detail)
            records.append(replace(record, nbatch_asked=self.plan.nbatch))
        return tuple(records)

    def _untimed(self, is_over: bool) -> Failure:
        """Return what became of variants that nothing has timed or refused."""
        if self.ended is None or not is_over:
            return Failure(Status.INTERRUPTED, "stopped before it was timed")
        if self.ended.status == Status.OK:
            return Failure(Status.FAILED, "it was not timed")
        return Failure(self.ended.status, self.ended.detail)
