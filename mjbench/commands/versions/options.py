"""The options of `mjbench versions`, `versions --explain`, `ab` and `bisect`."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mjbench.commands.shared_options import BudgetOptions, OutputOptions, SizeOptions, top_option
from mjbench.commands.versions.fail_on import FailOnOptions
from mjbench.errors import InputError
from mjbench.options import COUNT, FLAG, NAMES, SHARE, choice, names_among, option
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
    precision: float | None = option(
        None,
        SHARE,
        "Stop early once half the interval's width is below this",
        unset="half of --min-effect, at most 0.5%",
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

        budget, most = self.budget, self.min_effect / 2
        if self.precision is not None and self.precision > most:
            raise InputError(
                f"--precision {100 * self.precision:g}% changes nothing above {100 * most:g}%, half"
                " of --min-effect: give less, or a larger --min-effect"
            )
        return VerdictPlan(
            self.min_effect,
            self.confidence,
            self.precision or min(most, outcomes.PRECISION),
            budget.total_s or budget.each_s,
            self.sizes,
            self.as_shipped,
            counts_loading=budget.total_s is not None,
        )


def _metric_help() -> str:
    meanings = "; ".join(f"`{metric}`, {spec.meaning}" for metric, spec in METRICS.items())
    notes = [spec.note for spec in METRICS.values() if spec.note]
    return " ".join([f"What to compare, one of these: {meanings}.", *notes])


@dataclass(frozen=True, kw_only=True)
class TargetOptions(FailOnOptions, JudgingOptions, OutputOptions):
    """How two targets are compared."""

    metric: str = option(Metric.TIME.value, choice(*Metric, metavar="METRIC"), _metric_help())


@dataclass(frozen=True, kw_only=True)
class VersionsOptions(TargetOptions):
    """How releases are compared."""

    paths: list[str] | None = option(
        None, NAMES, "Ways of stepping to compare between the releases", unset="python_loop"
    )
    family: int | None = option(
        None,
        COUNT,
        "Total comparisons of your CI job, where several commands share it: a change then needs"
        " more evidence",
        unset="those of this command",
        of_functions=False,
    )

    @property
    def plan(self) -> "VerdictPlan":
        """Return what a verdict may cost; InputError where sizes do not fit together."""
        return replace(super().plan, family=self.family or 1)


@dataclass(frozen=True, kw_only=True)
class ExplainOptions(JudgingOptions, OutputOptions):
    """How differences are explained."""

    top: int = top_option()
    skip: list[str] | None = option(
        None, names_among(["times"]), "Leave out these parts: times, the wall-clock times."
    )


@dataclass(frozen=True, kw_only=True)
class RevisionOptions(TargetOptions):
    """How two targets, or functions in revisions, are compared."""

    own_files: bool = option(
        False,
        FLAG,
        "Each revision runs its own file of a function, not the newer side's.",
        of_functions=False,
    )

    def check_no_own_files(self) -> None:
        """Refuse an option of functions where none is named."""
        if self.own_files:
            raise InputError("--own-files is for functions: name one, such as bench.py::step")


@dataclass(frozen=True, kw_only=True)
class BisectOptions(RevisionOptions):
    """How a version is searched for."""

    BUDGET_NOTE = ", about log2(N) + 2 of N versions"
