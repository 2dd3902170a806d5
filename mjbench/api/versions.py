"""`mjbench.versions`: is a model slower with a new release of MuJoCo than with an old one?"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjbench.api import argument_values, model_sources, start_states
from mjbench.api.measured import Measured
from mjbench.api.verdict_measurements import between_releases
from mjbench.commands.versions import family
from mjbench.commands.versions.family import Family
from mjbench.errors import InputError
from mjbench.limits import SECONDS, SEED, SHARE
from mjbench.measuring.timing import Progress
from mjbench.paired import outcomes
from mjbench.paired.metrics import Metric
from mjbench.paired.records import VerdictRecord, VerdictRow
from mjbench.paired.run_sizes import Sizes
from mjbench.paired.verdict import VerdictPlan
from mjbench.releases import installs
from mjbench.simulation import models as shipped_models

if TYPE_CHECKING:
    import os

    from mjbench.api.start_states import Actions, States


@dataclass(frozen=True, repr=False, eq=False)
class ReleaseComparison(Measured):
    """Verdicts on models in an old and in new releases of MuJoCo."""

    @property
    def verdicts(self) -> tuple[VerdictRow, ...]:
        return tuple(record.row() for record in self.run.of_type(VerdictRecord))

    @property
    def confidence(self) -> float:
        return family.confidence_of(self.run.header)

    @property
    def family(self) -> Family:
        """Which are slower, faster or undecided when one allows for their number."""
        return family.adjust_for_family(self.verdicts, self.confidence)


def versions(
    old: str,
    *news: str,
    models: "str | os.PathLike[str] | Iterable[str | os.PathLike[str]] | None" = None,
    paths: str | Iterable[str] | None = None,
    metric: str = Metric.TIME.value,
    min_effect: float = outcomes.MIN_EFFECT,
    confidence: float = outcomes.CONFIDENCE,
    precision: float = outcomes.PRECISION,
    budget_s: float = outcomes.TIME_LIMIT_S,
    as_shipped: bool = False,
    nbatch: int | None = None,
    nstep: int | None = None,
    hold: int = 1,
    seed: int = 0,
    settle_s: float | None = None,
    states: "States | None" = None,
    actions: "Actions | None" = None,
    wait: bool = False,
    on_progress: Progress | None = None,
) -> ReleaseComparison:
    """Compare models in an old release of MuJoCo and in new ones: are they slower?

    The same as `mjbench versions`. Each release is installed in a folder of its own in the cache.
    Ratios are new over old: above 1 is slower. A model that fails loses only its own verdict,
    unless all fail.

    Args:
      old: a version (`3.5.0`), a wheel, a folder of wheels, `installed`, `newest` or `previous`; or
        packages, with commas, such as `jax==0.7.0,jaxlib==0.7.0`.
      *news: the same, one or several.
      models: names as on the command line, or paths; None for all shipped models. A compiled
        model cannot be compared: other releases cannot load it.
      paths: names of C paths, or of paths that compile, such as `mjx`, each compared between the
        releases; None for `python_loop`.
      metric: what to compare: `time`, `instructions`, which needs valgrind, the time of `load`,
        `reset`, `rays`, or of a short call of `rollout` or `batch`, the peak of `memory`, or the
        time that paths take to `compile`.
      min_effect: smallest change that matters, as a share; a change that is certainly smaller is
        `same`.
      confidence: of the interval, as a share.
      precision: stop when half the interval's width is below this share.
      budget_s: for each verdict, once the models are loaded; after it, an uncertain one is
        `inconclusive`.
      as_shipped: whether to compare builds with their machine code where it lies in memory.
      nbatch: simulations of a run.
      nstep: steps of each simulation.
      hold: steps for which each control is held: an environment's frame_skip.
      seed: of start states and controls.
      settle_s: simulated seconds for which the model moves before the first start state; 0 starts
        at keyframe 0, None stands for 0.1 with a keyframe, and for 5 without.
      states: a file of start states, or arrays by MjData field, as `mjbench.record` returns and
        `mjbench.capture` stores them.
      actions: a file of controls, or an array (ncontrol, nu) or (nsequence, ncontrol, nu), in place
        of random ones.
      wait: whether to wait until no other mjbench measures on this machine.
      on_progress: called with what is measured now, and the share of all work that is done.

    Raises:
      InputError: there is no such release, model or path, an argument is out of its range, or no
        model can be compared.
      MachineError: a package or a release is missing, or processes failed for every model.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """
    path_names = None if paths is None else argument_values.names("paths", paths)
    chosen = argument_values.choice("metric", metric, Metric)
    if not news:
        raise InputError('name an old and a new release, such as versions("3.3.0", "4.0.0")')
    specs = installs.parse_available(map(str, (old, *news)))
    sources = model_sources.each_once(map(model_sources.named, _several(models)))
    with start_states.plan(settle_s, states, actions) as starts:
        sizes = Sizes(
            argument_values.optional(argument_values.whole, "nbatch", nbatch),
            argument_values.optional(argument_values.whole, "nstep", nstep),
            argument_values.whole("hold", hold),
            argument_values.whole("seed", seed, SEED),
            starts,
            metric=chosen,
        )
        argument_values.holds(sizes.nstep, sizes.hold)
        plan = VerdictPlan(
            argument_values.number("min_effect", min_effect, SHARE),
            argument_values.number("confidence", confidence, SHARE),
            argument_values.number("precision", precision, SHARE),
            argument_values.number("budget_s", budget_s, SECONDS),
            sizes,
            as_shipped,
        )
        measurement = between_releases(specs, sources, path_names, plan)
        return ReleaseComparison.of(measurement, wait, on_progress)


def _several(
    models: "str | os.PathLike[str] | Iterable[str | os.PathLike[str]] | None",
) -> "Sequence[str | os.PathLike[str]]":
    if models is None:
        return shipped_models.shipped()
    if isinstance(models, str) or not isinstance(models, Iterable):
        return [models]
    return list(models)
