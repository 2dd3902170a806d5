"""The options of `mjbench versions`, `versions --explain`, `ab` and `bisect`."""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from mjbench.commands.shared_options import BudgetOptions, OutputOptions, SizeOptions, top_option
from mjbench.commands.versions.fail_on import FailOnOptions
from mjbench.options import COUNT, FLAG, NAMES, SHARE, choice, names_among, option, text
from mjbench.paired import outcomes
from mjbench.paired.metrics import METRICS, Metric

if TYPE_CHECKING:
    from mjbench.paired.verdict import VerdictPlan


@dataclass(frozen=True, kw_only=True)
class JudgingOptions(BudgetOptions, SizeOptions):
    """How certain a verdict must be, and what it may cost."""

    EACH_S, QUICK_S, THING = outcomes.TIME_LIMIT_S, 15.0, "verdict"
    min_effect: float = option(
        outcomes.MIN_EFFECT,
        SHARE,
        "Smallest change that matters; a change that is certainly smaller is `same`.",
    )
    confidence: float = option(
        outcomes.CONFIDENCE,
        SHARE,
        "Confidence of the interval: at 99%, at most 1 in 100 comparisons of identical targets"
        " is called different.",
    )
    precision: float = option(
        outcomes.PRECISION, SHARE, "Stop when half the interval's width is below this."
    )
    as_shipped: bool = option(
        False,
        FLAG,
        "Compare builds as they are. By default mjbench moves their machine code in memory"
        " from process to process, so that only what the code does makes a difference.",
    )

    @property
    def plan(self) -> "VerdictPlan":
        from mjbench.paired.verdict import VerdictPlan

        budget = self.budget
        return VerdictPlan(
            self.min_effect,
            self.confidence,
            self.precision,
            budget.total_s or budget.each_s,
            self.sizes,
            self.as_shipped,
            counts_loading=budget.total_s is not None,
        )


def _metric(*metrics: Metric) -> Any:
    """Return the option `--metric` with these metrics."""
    meanings = "; ".join(f"`{metric}`, {METRICS[metric].meaning}" for metric in metrics)
    notes = [METRICS[metric].note for metric in metrics if METRICS[metric].note]
    help_text = " ".join([f"What to compare: {meanings}.", *notes])
    return option(Metric.TIME.value, choice(*metrics, metavar="METRIC"), help_text)


@dataclass(frozen=True, kw_only=True)
class VersionsOptions(FailOnOptions, JudgingOptions, OutputOptions):
    """How releases are compared."""

    old: str | None = option(
        None,
        text("RELEASE"),
        "The old release, if it is not the first argument.",
        of_functions=False,
    )
    news: tuple[str, ...] = option(
        (),
        text("RELEASE", is_repeated=True),
        "A new release; may be given several times.",
        "--new",
        of_functions=False,
    )
    paths: list[str] | None = option(
        None,
        NAMES,
        "Ways of stepping to compare between the releases",
        unset="python_loop",
    )
    metric: str = _metric(*Metric)
    functions: tuple[str, ...] = option(
        (),
        text("FUNCTION", is_repeated=True),
        "A function of your code to time in place of a MODEL, such as bench.py::step; may be given"
        " several times. It is called as by `mjbench ab rev=…`; your code is the same on both"
        " sides.",
        "--function",
        of_functions=False,
    )
    family: int | None = option(
        None,
        COUNT,
        "Correct for N comparisons in all, where other commands make some of them: a change then"
        " needs more evidence",
        unset="those of this command",
        of_functions=False,
    )

    @property
    def plan(self) -> "VerdictPlan":
        """Return what a verdict may cost; InputError where sizes do not fit together."""
        return replace(super().plan, family=self.family or 1)


class ExplainPart(StrEnum):
    """What `versions --explain --skip` can name."""

    TIMES = "times"


@dataclass(frozen=True, kw_only=True)
class ExplainOptions(JudgingOptions, OutputOptions):
    """How differences are explained."""

    top: int = top_option()
    skip: list[ExplainPart] | None = option(
        None, names_among(ExplainPart), "Leave out these parts: times, the wall-clock times."
    )


@dataclass(frozen=True, kw_only=True)
class TargetOptions(FailOnOptions, JudgingOptions, OutputOptions):
    """How two targets are compared."""

    metric: str = _metric(*(metric for metric, spec in METRICS.items() if spec.is_of_targets))


@dataclass(frozen=True, kw_only=True)
class BisectOptions(JudgingOptions, OutputOptions):
    """How versions are compared while one is searched for."""
