"""What comparisons show on several machines: each machine's verdict, and which are certain enough.

Of many verdicts on targets that do not differ, one is `slower` or `faster` sooner or later, and the
more machines, the sooner. So all verdicts of all machines are one family (see `paired.family`). A
machine counts once for a comparison, however often it measured it. Ratios are never averaged, over
machines or over runs.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any

from mjbench.measuring import launch_stats
from mjbench.measuring.ratio import Ratio
from mjbench.paired import family
from mjbench.paired.metrics import Metric
from mjbench.paired.outcomes import CONFIDENCE, MIN_EFFECT, Verdict
from mjbench.paired.records import TargetRow, VerdictRecord, VerdictRow
from mjbench.releases import release_names
from mjbench.simulation.starts import Starts
from mjbench.store.runs import InputFile, Run, RunHeader


class MachinesOutcome(StrEnum):
    """What one machine counts as in a comparison."""

    SLOWER = "slower"
    """The candidate takes more time there."""
    FASTER = "faster"
    """It takes less."""
    SAME = "same"
    """Any difference is smaller than the smallest effect that matters."""
    UNDECIDED = "undecided"
    """It is inconclusive, failed, or not certain enough beside all other verdicts."""


_CHANGES = (MachinesOutcome.SLOWER, MachinesOutcome.FASTER)


@dataclass(frozen=True)
class Conditions:
    """What the command of a run decided about its comparisons."""

    min_effect: float = MIN_EFFECT
    hold: int = 1
    seed: int = 0
    as_shipped: bool = False

    @classmethod
    def of(cls, header: RunHeader) -> "Conditions":
        arguments = header.arguments
        sizes = arguments.get("sizes")
        asked: Mapping[str, Any] = sizes if isinstance(sizes, dict) else {}
        usual = cls()
        return cls(
            _of_type(arguments.get("min_effect"), usual.min_effect),
            _of_type(asked.get("hold"), usual.hold),
            _of_type(asked.get("seed"), usual.seed),
            _of_type(arguments.get("as_shipped"), usual.as_shipped),
        )


@dataclass(frozen=True)
class MachineRow:
    """A verdict that was measured on a machine."""

    machine: str
    row: VerdictRow
    confidence: float = CONFIDENCE
    conditions: Conditions = Conditions()
    files: tuple[InputFile, ...] = ()


@dataclass(frozen=True)
class MachineVerdict:
    """What one machine says of a comparison.

    Attributes:
      verdict: of its measurements; None where they differ, and where there is none.
      ratio: of the measurement with the widest interval; None where nothing was measured.
      count: how often it measured the comparison.
      detail: why it is undecided, in a few words; empty otherwise.
    """

    machine: str
    outcome: MachinesOutcome
    verdict: Verdict | None
    ratio: Ratio | None
    count: int
    changed_work: bool | None = None
    detail: str = ""


@dataclass(frozen=True)
class MachineComparison:
    """One comparison on all machines that measured it.

    Attributes:
      sides: baseline and candidate, as the first machine had them.
      nbatch: simulations of a run; None where it was never measured.
    """

    model: str
    path: str
    old: str
    new: str
    sides: Sequence[TargetRow]
    metric: Metric
    nbatch: int | None
    nstep: int | None
    starts: Starts | None
    machines: Sequence[MachineVerdict]

    def of_outcome(self, outcome: MachinesOutcome) -> list[MachineVerdict]:
        return [verdict for verdict in self.machines if verdict.outcome == outcome]

    @property
    def names_change(self) -> bool:
        return any(verdict.outcome in _CHANGES for verdict in self.machines)

    @property
    def ratios(self) -> list[Ratio]:
        return [verdict.ratio for verdict in self.machines if verdict.ratio is not None]

    @property
    def differs(self) -> bool:
        """Whether machines differ beyond their intervals: those of two do not overlap."""
        lows, highs = (
            [end for end in ends if end is not None]
            for ends in ([r.low for r in self.ratios], [r.high for r in self.ratios])
        )
        return bool(lows and highs) and max(lows) > min(highs)


@dataclass(frozen=True)
class AcrossMachines:
    """What comparisons show on several machines.

    Attributes:
      comparisons: in the order that they were first measured.
      confidence: of the verdicts that are named slower, a share of at most 1 - confidence is
        expected to be false alarms, and so of those named faster.
    """

    comparisons: Sequence[MachineComparison]
    machines: Sequence[str]
    confidence: float

    @property
    def verdicts(self) -> list[MachineVerdict]:
        return [verdict for comparison in self.comparisons for verdict in comparison.machines]


def rows_of(runs: Sequence[Run], machines: Sequence[str]) -> list[MachineRow]:
    return [
        MachineRow(
            machine,
            record.row(),
            family.confidence_of(run.header),
            Conditions.of(run.header),
            run.header.files_of(_file_names(record)),
        )
        for run, machine in zip(runs, machines, strict=True)
        for record in run.of_type(VerdictRecord)
    ]


def _file_names(row: VerdictRow) -> list[str]:
    starts = [row.starts.file, row.starts.controls_file] if row.starts else []
    return [*(side.model for side in row.sides), *filter(None, starts)]


def decide(rows: Sequence[MachineRow]) -> AcrossMachines:
    """Return what verdicts of several machines show together.

    Of runs that were asked for different confidences, the highest holds for all.
    """
    confidence = max((row.confidence for row in rows), default=CONFIDENCE)
    groups = _by_comparison(rows)
    measurements = [_by_machine(group) for group in groups]
    certain = iter(
        _certain([rows for machines in measurements for rows in machines.values()], confidence)
    )
    return AcrossMachines(
        [
            _comparison(
                group, [_machine_verdict(name, rows, next(certain)) for name, rows in m.items()]
            )
            for group, m in zip(groups, measurements, strict=True)
        ],
        list(dict.fromkeys(row.machine for row in rows)),
        confidence,
    )


def _by_comparison(rows: Sequence[MachineRow]) -> list[list[MachineRow]]:
    """Return rows of the same comparison together.

    A row of a measurement that failed does not know its sizes: it belongs to the comparison that
    shares all else, where there is only one.
    """
    sizes: dict[tuple[object, ...], set[tuple[object, ...]]] = defaultdict(set)
    for row in rows:
        if row.row.nbatch is not None:
            sizes[_targets_key(row)].add(_size_key(row))
    groups: dict[tuple[object, ...], list[MachineRow]] = defaultdict(list)
    for row in rows:
        known = sizes[_targets_key(row)]
        is_failed = row.row.nbatch is None and len(known) == 1
        size = next(iter(known)) if is_failed else _size_key(row)
        groups[*_targets_key(row), *size].append(row)
    return list(groups.values())


def _targets_key(row: MachineRow) -> tuple[object, ...]:
    """Return what is compared, and under which conditions.

    A build counts by its release and by the content of local wheels: builds of one release for
    several processors are the same release.
    """
    sides = [replace(s, build=release_names.wheel_digest(s.build)) for s in row.row.sides]
    verdict = row.row
    names = (verdict.model, verdict.path, verdict.old, verdict.new, verdict.metric)
    return *names, repr([asdict(side) for side in sides]), row.conditions, row.files


def _size_key(row: MachineRow) -> tuple[object, ...]:
    return row.row.nbatch, row.row.nstep, row.row.starts


def _by_machine(rows: Sequence[MachineRow]) -> dict[str, list[VerdictRow]]:
    groups: dict[str, list[VerdictRow]] = defaultdict(list)
    for row in rows:
        groups[row.machine].append(row.row)
    return groups


def _certain(
    measurements: Sequence[Sequence[VerdictRow]], confidence: float
) -> list[Verdict | None]:
    """Return the verdict of each machine on each comparison; None where it is not certain."""
    agreed = [_agreed(rows) for rows in measurements]
    certain: list[Verdict | None] = [v if v == Verdict.SAME else None for v in agreed]
    for change in (Verdict.SLOWER, Verdict.FASTER):
        # the least evidence of several measurements: all of them must be certain
        e_values = [
            min(family.e_value(row, change) for row in _decided(rows)) if v == change else 0.0
            for rows, v in zip(measurements, agreed, strict=True)
        ]
        is_certain = launch_stats.e_benjamini_hochberg(e_values, 1 - confidence)
        certain = [change if sure else v for v, sure in zip(certain, is_certain, strict=True)]
    return certain


def _decided(rows: Sequence[VerdictRow]) -> list[VerdictRow]:
    """Return the measurements of a machine that came to a verdict; others say nothing."""
    return [row for row in rows if row.verdict is not None]


def _agreed(rows: Sequence[VerdictRow]) -> Verdict | None:
    """Return the verdict of all measurements of a machine; None where they differ, or are none."""
    verdicts = {row.verdict for row in _decided(rows)}
    return verdicts.pop() if len(verdicts) == 1 else None


def _machine_verdict(
    machine: str, rows: Sequence[VerdictRow], certain: Verdict | None
) -> MachineVerdict:
    decided = _decided(rows)
    works = {row.changed_work for row in decided}
    return MachineVerdict(
        machine,
        MachinesOutcome(certain.value) if certain else MachinesOutcome.UNDECIDED,
        _agreed(rows),
        max((row.ratio for row in decided if row.ratio), key=_width, default=None),
        len(rows),
        True if True in works else works.pop() if len(works) == 1 else None,
        "" if certain else _why_undecided(rows),
    )


def _why_undecided(rows: Sequence[VerdictRow]) -> str:
    decided = _decided(rows)
    if not decided:
        return "; ".join(dict.fromkeys(row.detail or row.status.value for row in rows))
    verdict = _agreed(rows)
    if verdict is None:
        return f"measured {len(decided)} times: {', '.join(r.verdict or '' for r in decided)}"
    if verdict == Verdict.INCONCLUSIVE:
        return verdict.value
    if any(family.may_be_placement(row) for row in decided):
        return f"{verdict}, or because of where its code lies"
    has_evidence = all((row.e_slower, row.e_faster) != (None, None) for row in decided)
    why = "if judged alone" if has_evidence else "in an older file, which has no e-values"
    return f"{verdict} {why}"


def _width(ratio: Ratio) -> float:
    return float("inf") if ratio.low is None or ratio.high is None else ratio.high / ratio.low


def _comparison(
    rows: Sequence[MachineRow], verdicts: Sequence[MachineVerdict]
) -> MachineComparison:
    measured = next((row.row for row in rows if row.row.nbatch is not None), rows[0].row)
    return MachineComparison(
        model=measured.model,
        path=measured.path,
        old=measured.old,
        new=measured.new,
        sides=measured.sides,
        metric=measured.metric,
        nbatch=measured.nbatch,
        nstep=measured.nstep,
        starts=measured.starts,
        machines=verdicts,
    )


def _of_type(value: Any, usual: Any) -> Any:
    return value if type(value) is type(usual) else usual
