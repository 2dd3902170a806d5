"""The tally of `benchmarks.studies.checkups`: check-ups beside longer commands."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mjbench import formats
from mjbench.commands.checkup.item import CheckupItem, ResultChange
from mjbench.commands.checkup.targets import TargetKind
from mjbench.commands.tune.c_search import LEAST_GAIN
from mjbench.commands.tune.result import Effect, TuneRecord
from mjbench.interval import Interval
from mjbench.paired.race_record import RaceRecord
from mjbench.verification.plan import Variant

if TYPE_CHECKING:
    from mjbench.results.runs import Run

# The first advice has at least this share of the best gain, and a check-up takes no longer.
LEAST_SHARE, MOST_S = 0.95, 60.0
_EFFECTS = {ResultChange.NONE: Effect.FREE, ResultChange.TOLERANCE: Effect.EQUIVALENT}


@dataclass(frozen=True, kw_only=True)
class CheckupTrial:
    """A check-up of one target, beside the commands that look closer.

    Attributes:
      seconds: that the check-up took; None where it failed.
      other_cores: how many other programs used, in the mean of all commands.
      first: of its items, the first that has a gain and keeps results; of a program or an
        environment, the first of all. Empty without one.
      again: times as fast that `first` is by the longer commands, 1 where it is empty; None where
        they did not measure it, or say otherwise that results are wrong.
      best, best_gain: what the longer commands find best, and times as fast that it is.
      contradicted: items that the longer commands call no gain, or that change more than is said.
      unknown: items that they did not measure, or whose gain they leave undecided.
      detail: why it failed; empty otherwise.
    """

    name: str
    kind: TargetKind
    seconds: float | None = None
    other_cores: float = 0.0
    first: str = ""
    again: float | None = None
    best: str = ""
    best_gain: float = 1.0
    contradicted: Sequence[str] = ()
    unknown: Sequence[str] = ()
    detail: str = ""

    @property
    def is_first_best(self) -> bool:
        return self.again is not None and self.again >= LEAST_SHARE * self.best_gain

    @property
    def is_in_time(self) -> bool:
        return self.seconds is not None and self.seconds <= MOST_S

    @property
    def is_right(self) -> bool:
        return self.is_first_best and self.is_in_time and not self.contradicted

    @property
    def row(self) -> str:
        """What is printed of it: name, seconds, first advice and its gain, best and its gain."""
        if self.detail:
            return f"| `{self.name}` | – | {_cell(self.detail)} | – | – | – |"
        seconds = "–" if self.seconds is None else f"{self.seconds:.0f}"
        again = "–" if self.again is None else formats.factor(self.again)
        best = "the same" if self.best and self.best == self.first else _cell(self.best)
        texts = [_cell(self.first), again, best, formats.factor(self.best_gain)]
        return f"| `{self.name}` | {seconds} | {' | '.join(texts)} |"


def trial(begun: CheckupTrial, short: "Run", longer: "Run") -> CheckupTrial:
    """Return what a check-up lists, judged by a run that has the records of longer commands."""
    # late: asv imports this module without its packages
    from mjbench.commands.checkup import ranking

    listed, closer = ranking.items(short), ranking.items(longer)
    if begun.kind == TargetKind.MODEL:
        first, best = _best(listed), _best(closer)
        again = _times(_measured(first, longer)) if first is not None else 1.0
        if _has_wrong(listed) != _has_wrong(closer):
            again = None
    else:
        first, best = next(iter(listed), None), next(iter(closer), None)
        again = _in_list(first, closer, longer)
    judged = [item for item in listed if item.gain is not None and begun.kind == TargetKind.MODEL]
    objections = [(item.action, _objection(item, longer)) for item in judged]
    return replace(
        begun,
        first=first.action if first is not None else "",
        again=again,
        best=best.action if best is not None else "",
        best_gain=best.times if best is not None else 1.0,
        contradicted=[f"{action}: {objection}" for action, objection in objections if objection],
        unknown=[
            item.action
            for item in judged
            if not (_is_decided(_measured(item, longer)) or _objection(item, longer))
        ],
    )


def _best(listed: Sequence[CheckupItem]) -> CheckupItem | None:
    keeping = [item for item in listed if item.gain is not None and item.change.keeps]
    return max(keeping, key=lambda item: item.times, default=None)


def _has_wrong(listed: Sequence[CheckupItem]) -> bool:
    return any(item.change == ResultChange.CORRECTED for item in listed)


def _times(gain: Interval | None) -> float | None:
    return gain.estimate if gain is not None else None


def _in_list(
    first: CheckupItem | None, closer: Sequence[CheckupItem], longer: "Run"
) -> float | None:
    """Return how much an item gains by the longer command, if it may stand first there."""
    if first is None:
        return None if _has_wrong(closer) else 1.0
    # late: asv imports this module without its packages
    from mjbench.commands.checkup import ranking

    if not closer or ranking.importance(first) != ranking.importance(closer[0]):
        return None
    same = next((item for item in closer if item.action == first.action), None)
    return same.times if same is not None else _times(_measured(first, longer))


def _measured(item: CheckupItem, longer: "Run") -> Interval | None:
    """Return how much faster the same way of stepping, or the same settings, are in another run.

    Settings that it did not try together have the gain of the best of them alone.
    """
    # late: asv imports this module without their packages
    from mjbench.commands.env.result import EnvironmentRecord

    if item.variant is not None:
        gains = [race.speedup(item.variant) for race in longer.of_type(RaceRecord)]
        gains += [
            path.speedup
            for record in longer.of_type(EnvironmentRecord)
            for path in record.physics_paths
            if Variant(path.path, path.options) == item.variant
        ]
        return next(iter(gains), None)
    ratios = _ratios(longer)
    wanted = frozenset(each.label for each in item.settings)
    if wanted in ratios:
        return ratios[wanted].inverse
    alone = [ratios[frozenset({name})] for name in wanted if frozenset({name}) in ratios]
    least = min(alone, key=lambda ratio: ratio.estimate, default=None)
    return least.inverse if least is not None else None


def _ratios(longer: "Run") -> dict[frozenset[str], Interval]:
    """Return the times of all settings, by their labels, over those of the present ones."""
    ratios: dict[frozenset[str], Interval] = {}
    for record in longer.of_type(TuneRecord):
        for attempt in record.attempts:
            ratio = attempt.ratio
            if ratio is None and attempt.time_ratio is not None:
                ratio = Interval(attempt.time_ratio, None, None)
            if ratio is not None:
                ratios[frozenset(each.label for each in attempt.settings)] = ratio
        for each in record.front:
            ratios[frozenset(setting.label for setting in each.settings)] = each.ratio
    return ratios


def _objection(item: CheckupItem, longer: "Run") -> str:
    """Return what the longer commands say against an item; empty for nothing."""
    gain = _measured(item, longer)
    if gain is not None and item.gain is not None and _is_no_gain(gain, item.gain):
        return f"{formats.factor(gain.estimate)}{formats.in_brackets(gain)}"
    effects = [
        each.effect
        for record in longer.of_type(TuneRecord)
        for each in record.front
        if {one.label for one in each.settings} == {one.label for one in item.settings}
    ]
    said = _EFFECTS.get(item.change)
    return next((each for each in effects if said is not None and each.rank > said.rank), "")


def _is_no_gain(gain: Interval, said: Interval) -> bool:
    """Return whether a gain that the longer commands measured is less than said, and may be none.

    One without an interval was given up, or was not decided.
    """
    if gain.low is None or gain.high is None:
        return gain.estimate <= 1 / (1 - LEAST_GAIN)
    return not gain.is_above(1.0) and gain.high < (said.low or said.estimate)


def _is_decided(gain: Interval | None) -> bool:
    return gain is not None and (gain.low is None or gain.is_above(1.0))


@dataclass(frozen=True)
class CheckupTally:
    """All targets, and where they were checked."""

    mujoco: str
    cpu: str
    cores: int
    trials: Sequence[CheckupTrial]

    def with_trial(self, added: CheckupTrial) -> "CheckupTally":
        """Return the tally with a trial, in the place of an earlier one of the same target."""
        others = [each for each in self.trials if each.name != added.name]
        return replace(self, trials=[*others, added])

    def lines(self) -> Iterator[str]:
        """Yield what the page has."""
        if not self.trials:
            yield "Nothing has been measured yet."
            return
        for kind in TargetKind:
            if trials := [each for each in self.trials if each.kind == kind]:
                yield from _kind_lines(kind, trials)
        others = max(each.other_cores for each in self.trials)
        yield (
            f"(MuJoCo {self.mujoco}, {self.cpu}, {self.cores} cores. Other programs used up to"
            f" {others:.2f} cores meanwhile. Gains are those of the longer commands.)"
        )


def _kind_lines(kind: TargetKind, trials: Sequence[CheckupTrial]) -> Iterator[str]:
    best = sum(each.is_first_best for each in trials)
    in_time = sum(each.is_in_time for each in trials)
    yield (
        f"- **{kind}s**: the first advice has 0.95 of the best gain or more for {best} of"
        f" {len(trials)}; {in_time} took at most {MOST_S:.0f} s."
    )
    for each in trials:
        if each.detail:
            yield f"  - `{each.name}` was not measured: {each.detail}"
        yield from (f"  - `{each.name}` is contradicted: {text}" for text in each.contradicted)
        yield from (f"  - `{each.name}` has an unconfirmed gain: {text}" for text in each.unknown)


def _cell(text: str) -> str:
    return text.replace("|", "\\|") or "none"
