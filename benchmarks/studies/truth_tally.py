"""Changes that are known, what `mjbench versions` answers about them, and the page of that."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mjbench.interval import Interval
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.outcomes import Verdict

# A size is found if it is within this factor of the published one.
ROUGHLY = 2.0


@dataclass(frozen=True)
class Truth:
    """A pair of environments, and work that is known to take more in one of them.

    Attributes:
      name: what changed.
      arguments: of `mjbench versions`: the baseline, the candidate, the work, and options.
      change: candidate over baseline, as published; None where only the direction was.
      is_more: whether the candidate takes more.
      source: what published it, and its address.
      control: arguments of a comparison that should be `same`.
    """

    name: str
    arguments: tuple[str, ...]
    change: float | None
    is_more: bool
    source: tuple[str, str]
    control: tuple[str, ...]


@dataclass(frozen=True)
class Answer:
    """What `mjbench versions` answers.

    Attributes:
      arguments: that it was given.
      verdict: None where there is none; `detail` then has the reason.
      ratio: candidate over baseline.
      load: of the machine at the beginning, over one minute.
    """

    arguments: tuple[str, ...]
    verdict: Verdict | None
    ratio: Interval | None
    seconds: float
    load: float
    detail: str = ""

    @property
    def text(self) -> str:
        """What the page has of it."""
        if self.verdict is None or self.ratio is None:
            return self.detail or "nothing measured"
        metric = Metric.TIME
        if "--metric" in self.arguments:
            metric = Metric(self.arguments[self.arguments.index("--metric") + 1])
        return f"{METRICS[metric].outcome(self.verdict)}, × {_digits(self.ratio.estimate)}"


@dataclass(frozen=True)
class TruthResult:
    """What the command answers about a change, and about its control."""

    answer: Answer
    control: Answer

    def is_of(self, truth: Truth) -> bool:
        """Return whether the command was asked what it would be asked now."""
        asked = self.answer.arguments, self.control.arguments
        return asked == (truth.arguments, truth.control)

    def is_found(self, truth: Truth) -> bool:
        """Return whether the change was found, whatever its size."""
        return self.answer.verdict == (Verdict.SLOWER if truth.is_more else Verdict.FASTER)

    def has_size(self, truth: Truth) -> bool:
        """Return whether it was found with roughly the published size."""
        ratio = self.answer.ratio
        if not self.is_found(truth) or truth.change is None or ratio is None:
            return False
        return abs(math.log(ratio.estimate / truth.change)) <= math.log(ROUGHLY)

    @property
    def has_control(self) -> bool:
        """Whether the control is the same."""
        return self.control.verdict == Verdict.SAME

    @property
    def seconds(self) -> float:
        """What both took."""
        return self.answer.seconds + self.control.seconds

    def row(self, truth: Truth) -> str:
        """Return the row of a table."""
        text, address = truth.source
        published = "more" if truth.is_more else "less"
        if truth.change is not None:
            published = f"× {_digits(truth.change)}"
        columns = truth.name, f"[{text}]({address}): {published}", self.answer.text
        return f"| {' | '.join((*columns, self.control.text))} |"


def _digits(ratio: float) -> str:
    """Return two digits of a ratio; more of one that is nearly 1."""
    return f"{ratio:.3f}" if 0.9 < ratio < 1.1 else f"{float(f'{ratio:.2g}'):g}"


@dataclass(frozen=True)
class TruthTally:
    """All answers, and where they were given."""

    mujoco: str
    cpu: str
    cores: int
    results: Sequence[TruthResult]

    def known(self, truths: Sequence[Truth]) -> Iterator[tuple[Truth, TruthResult]]:
        """Yield those of the truths about which the command was asked."""
        for truth in truths:
            yield from ((truth, each) for each in self.results if each.is_of(truth))

    def lines(self, truths: Sequence[Truth]) -> Iterator[str]:
        """Yield what the page has."""
        known = [*self.known(truths)]
        found = [truth.name for truth, each in known if each.is_found(truth)]
        beside = [each.has_control for truth, each in known if each.is_found(truth)]
        sized = [each.has_size(truth) for truth, each in known if truth.change is not None]
        missed = [f"{t.name}: {r.answer.text}" for t, r in known if t.name not in found]
        others = f" (not {', '.join(missed)})" if missed else ""
        controls = [each.control.verdict for _, each in known]
        differing = sum(each in (Verdict.SLOWER, Verdict.FASTER) for each in controls)
        yield (
            f"`mjbench versions` finds {len(found)} of {len(known)} changes that others have"
            f" published{others}. For {sum(beside)} of them a control stays `same`: different work"
            f" in the same environments, or the same work in different ones. {differing} of"
            f" {len(controls)} controls differ, and it is not known whether they should. Of"
            f" {len(sized)} published sizes, {sum(sized)} are found within a factor of"
            f" {ROUGHLY:g}."
        )
        if known:
            loads = [each.load for _, both in known for each in (both.answer, both.control)]
            yield (
                f"(`python -m benchmarks.studies.truths`, MuJoCo {self.mujoco} unless named,"
                f" {self.cpu}, {self.cores} cores, with a load of {min(loads):.0f} to"
                f" {max(loads):.0f} at the beginning of comparisons.)"
            )
