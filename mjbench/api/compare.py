"""`mjbench.compare`: the ways of stepping a model: do they agree, and which is fastest?"""

import itertools
import os
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjbench import paths as stepping_paths
from mjbench.api import argument_values, model_sources, start_states
from mjbench.api.measured import Measured
from mjbench.api.session import Item, Measurement, Observer
from mjbench.comparison import selection
from mjbench.comparison.messages import ModelFiles
from mjbench.comparison.model_children import ModelChildren
from mjbench.comparison.plan import BUDGET_S, ComparisonPlan
from mjbench.errors import InputError
from mjbench.host import neighbours
from mjbench.host.machine import ProcessorTime
from mjbench.limits import LARGE_COUNT, SECONDS, SEED, THREADS, TIME_LIMIT_S
from mjbench.measuring.timing import Progress
from mjbench.paired import launches, model_comparison
from mjbench.paired.model_comparison import ModelComparison
from mjbench.paired.race import RaceBudget, RaceLaunches, RaceRule, enter
from mjbench.paired.race_record import RaceRecord
from mjbench.paired.time_limit import ending_of
from mjbench.paired.worker_pool import WorkerPool
from mjbench.report import comparison as report
from mjbench.report.advice import Advice, ClockAdvice
from mjbench.report.crossovers import Crossover, WorkCrossover
from mjbench.report.documents import CompareDocument
from mjbench.report.path_speedups import ModelResults, PathResult, derive_all
from mjbench.simulation import models as shipped_models
from mjbench.simulation.models import ModelSource
from mjbench.simulation.workload import Product
from mjbench.status import Status
from mjbench.store.runs import Record, to_json

if TYPE_CHECKING:
    from mjbench.api.model_sources import Model
    from mjbench.api.start_states import Actions, States


# Share of a model's progress that verification stands for; the race is the rest.
_VERIFICATION_SHARE = 0.2


@dataclass(frozen=True, repr=False, eq=False)
class Comparison(Measured):
    """Ways of stepping models, compared."""

    @property
    def models(self) -> tuple[ModelResults, ...]:
        """The results of each model at each size."""
        return tuple(derive_all(self.run.records))

    @property
    def document(self) -> CompareDocument:
        """All that `mjbench compare --json` has."""
        return CompareDocument.of(self.machine, self.models)

    @property
    def results(self) -> tuple[PathResult, ...]:
        """The results of all variants of paths, on all models."""
        return tuple(result for model in self.models for result in model.results)

    @property
    def advice(self) -> tuple[Advice, ...]:
        """Which path to use, for open and for closed loop."""
        return tuple(self.document.advice)

    @property
    def clock(self) -> tuple[ClockAdvice, ...]:
        """What turning MuJoCo's timer off gains, where that is certain."""
        return tuple(self.document.clock)

    @property
    def crossovers(self) -> tuple[Crossover, ...]:
        """From how many simulations on accelerated paths overtake C."""
        return tuple(self.document.crossovers)

    @property
    def work_crossovers(self) -> tuple[WorkCrossover, ...]:
        """From how much work per call on Ray overtakes other paths."""
        return tuple(self.document.work_crossovers)


def compare(
    *models: "Model",
    paths: str | Iterable[str] | None = None,
    threads: int | Iterable[int] | None = None,
    chunk: int | Iterable[int] | None = None,
    options: Mapping[str, Any] | None = None,
    nbatch: int | Iterable[int] | None = None,
    nstep: int | None = None,
    hold: int = 1,
    returns: str = Product.FINAL.value,
    seed: int = 0,
    settle_s: float | None = None,
    states: "States | None" = None,
    actions: "Actions | None" = None,
    budget_s: float = BUDGET_S,
    total_steps: float | None = None,
    time_limit_s: float = TIME_LIMIT_S,
    wait: bool = False,
    on_progress: Progress | None = None,
) -> Comparison:
    """Compare ways of stepping models: do they agree, and how fast are they?

    The same as `mjbench compare`. What paths return is compared first, bit by bit; a path that
    disagrees gets no speed. All is measured in child processes. A model that fails loses only its
    own results, unless all fail.

    Args:
      *models: names as on the command line, paths, MjModels or MjSpecs; none for all shipped ones.
      paths: names of paths (see `mjbench paths`), `c` for all C paths but `ray`, `usual` for those
        and MJX where that is installed, `module:Class` for one of your own; None for `c`.
      threads: thread counts; None for one, and all usable cores.
      chunk: simulations that a thread takes at a time; None for the path's default.
      options: values of further options of paths by name, such as `{"pool": ["new", "kept"]}`.
      nbatch: simulations; several are measured one after the other; None for up to 64.
      nstep: steps of each simulation; None for up to 100.
      hold: steps for which each control is held: an environment's frame_skip.
      returns: what every path returns: `final`, `trajectory` or `sensors`.
      seed: of start states and controls.
      settle_s: simulated seconds for which the model moves before the first start state; 0 starts
        at keyframe 0, None stands for 0.1 with a keyframe, and for 5 without.
      states: a file of start states, or arrays by MjData field, as `mjbench.record` returns and
        `mjbench.capture` stores them.
      actions: a file of controls, or an array (ncontrol, nu) or (nsequence, ncontrol, nu), in place
        of random ones.
      budget_s: seconds for each model, agreement included; what compiles comes on top.
      total_steps: steps that you will take in all: a path that compiles is advised only if that
        pays within them; None for those of one block.
      time_limit_s: a child process that reports nothing for this long is killed.
      wait: whether to wait until no other mjbench measures on this machine.
      on_progress: called with what is measured now, and the share of all work that is done.

    Raises:
      InputError: there is no such model or path, an argument is out of its range, or no model can
        be compared.
      MachineError: a package is missing, or no model could be compared because processes failed.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """
    path_names = [] if paths is None else argument_values.names("paths", paths)
    plan = ComparisonPlan(
        variants=(),
        nstep=argument_values.optional(argument_values.whole, "nstep", nstep),
        hold=argument_values.whole("hold", hold),
        seed=argument_values.whole("seed", seed, SEED),
        returns=argument_values.choice("returns", returns, Product),
        budget_s=argument_values.number("budget_s", budget_s, SECONDS),
        limit_s=argument_values.number("time_limit_s", time_limit_s, SECONDS),
        import_from=_own_path_folder(path_names),
        named=selection.named(path_names),
        total_steps=argument_values.optional(
            argument_values.whole, "total_steps", total_steps, LARGE_COUNT, is_float=True
        ),
    )
    argument_values.holds(plan.nstep, plan.hold)
    plans = selection.plans(
        plan,
        path_names,
        argument_values.optional(argument_values.wholes, "threads", threads, THREADS),
        argument_values.optional(argument_values.wholes, "chunk", chunk),
        _option_texts(options or {}),
        argument_values.optional(argument_values.wholes, "nbatch", nbatch),
    )
    with (
        model_sources.sources(models or shipped_models.shipped()) as sources,
        start_states.plan(settle_s, states, actions) as starts,
    ):
        sized = [replace(plan, starts=starts) for plan in plans]
        return Comparison.of(measurement(sources, sized), wait, on_progress)


def measurement(sources: Sequence[ModelSource], plans: Sequence[ComparisonPlan]) -> Measurement:
    """Return the measurement of each model at one size after the other, which `plans` differ in."""
    arguments = {**to_json(plans[0]), "models": [source.name for source in sources]}
    arguments["nbatch"] = [plan.nbatch for plan in plans]
    files = [source.path for source in sources]
    files += stepping_paths.user_module_files(variant.path for variant in plans[0].variants)
    files += plans[0].starts.files
    nvariant = len(plans[0].variants)

    def measure(earlier: Sequence[Record], observer: Observer) -> Iterator[Item]:
        count = len(sources) * len(plans)
        with WorkerPool(plans[0].limit_s) as pool:
            for position, source in enumerate(sources):
                shares = [(position * len(plans) + i) / count for i in range(len(plans) + 1)]
                yield from measure_model(pool, source, plans, shares, earlier, observer)

    return Measurement(
        "compare",
        arguments,
        files,
        measure,
        lambda records: model_comparison.finished(records, nvariant),
    )


def measure_model(
    pool: WorkerPool,
    source: ModelSource,
    plans: Sequence[ComparisonPlan],
    shares: Sequence[float],
    earlier: Sequence[Record],
    observer: Observer,
) -> Iterator[Item]:
    """Yield what a model comes to at one size after the other.

    Ctrl-C ends it with what is known then. Where a size was complete, so that no record says that
    it was interrupted, KeyboardInterrupt follows.

    Args:
      shares: of all work that is done before each plan, and after the last.
    """
    of_sizes: list[Record] = []
    for plan, of_work in zip(plans, itertools.pairwise(shares), strict=True):
        known, is_interrupted = model_comparison.stored(source, plan, earlier), False
        if known is None:
            compared = ComparedModel(pool, source, plan, of_work, of_sizes, observer)
            try:
                compared.run()
            except KeyboardInterrupt:
                is_interrupted = True
            known = compared.known()
        of_sizes += known.records
        yield Item(known.records, is_part=plan is not plans[-1])
        if known.is_interrupted:
            return
        if is_interrupted:
            raise KeyboardInterrupt


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
        self._begin_s, self._processor_time = time.monotonic(), ProcessorTime.now()
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

    def known(self) -> ModelComparison:
        """Return what is known now: all there is once `run` has ended."""
        timed: list[int] = []
        if self._race is not None:
            positions = {i for launch in self._race.launches for i in launch.variants}
            timed = [self._plan.variants.index(self._race.variants[i]) for i in positions]
        measurements = self._children.measurements(timed, self._is_complete)
        return ModelComparison(self._children.model_record(), measurements, self._race)

    def _run_race(self, verified_s: float) -> None:
        agreeing = self._children.agreeing
        if 0 not in agreeing:  # the plain loop
            return
        variants = [self._plan.variants[i] for i in agreeing]
        budget = RaceBudget(self._begin_s + self._plan.budget_s)
        # a launch takes about as long as the agreement check: each runs every path a few times
        expected_s = max(1.0, verified_s, budget.left_s())
        racing = f"racing {len(variants)} paths, about {expected_s:.0f} s"
        if budget.left_s() < verified_s:
            racing += ": one launch takes longer than is left of the budget"
        phase = racing if len(variants) > 1 else "timing the plain loop"
        self._observer.begin(f"{self._name}: {phase}")
        rule = RaceRule(enter(self._children.model_record(), variants), budget)
        targets = RaceLaunches(self._pool, self._children, variants)
        try:
            for ending in launches.launch(targets, rule):
                if ending is not None:
                    rule.end(ending)
                self._take_race(rule.record)
        except KeyboardInterrupt as error:  # while it was shown
            rule.end(ending_of(error))
            self._race = self._with_disturbance(rule.record)
            raise
        if rule.record.status == Status.INTERRUPTED:
            raise KeyboardInterrupt

    def _take_race(self, record: RaceRecord) -> None:
        """Take what a race has come to, and show it."""
        self._race = self._with_disturbance(record)
        for unable in record.unable:
            index = self._plan.variants.index(record.variants[unable.variant])
            self._children.revise(index, unable.status, unable.detail)
        spent = (time.monotonic() - self._begin_s) / self._plan.budget_s
        left = len(record.launches[-1].variants) if record.launches else len(record.variants)
        text = f"{self._name}: launch {len(record.launches)}, {left} paths left"
        self._show_progress(text, min(1.0, max(_VERIFICATION_SHARE, spent)))
        self._show_known()

    def _with_disturbance(self, record: RaceRecord) -> RaceRecord:
        others = [each for each in neighbours.measuring_now() if each.pid != os.getpid()]
        earlier = self._race.neighbours if self._race is not None else ()
        names = sorted({*earlier, *(each.command for each in others)})
        return replace(
            record,
            stolen_share=ProcessorTime.now().stolen_since(self._processor_time),
            neighbours=names,
        )

    def _run_accelerated(self) -> None:
        for index in self._plan.accelerated:
            phase = f"{self._name}: {self._plan.variants[index]}"
            self._observer.begin(phase)
            self._show_progress(phase, 1.0)
            self._children.run_accelerated(index)
            self._show_known()

    def _show_verifying(self) -> None:
        share = _VERIFICATION_SHARE * self._children.share_verified
        self._show_progress(f"{self._name}: do all paths agree?", share)

    def _show_progress(self, text: str, share: float) -> None:
        begin, end = self._shares
        self._observer(text, begin + share * (end - begin))

    def _show_known(self) -> None:
        records = [*self._of_sizes, *self.known().records]
        self._observer.show(lambda: report.section_so_far(derive_all(records)))


def _option_texts(options: Mapping[str, Any]) -> list[str]:
    several = {
        name: [values] if isinstance(values, str) or not isinstance(values, Iterable) else values
        for name, values in options.items()
    }
    return [f"{name}={','.join(map(str, values))}" for name, values in several.items()]


def _own_path_folder(path_names: Sequence[str]) -> str | None:
    """Return the folder of the user's own paths, for child processes; None without such paths."""
    folders = set()
    for name in path_names:
        module_name, colon, _ = name.partition(":")
        if not colon:
            continue
        stepping_paths.find(name)
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
