"""What `mjbench bisect` comes to: the commits or releases that changed the time of something."""

import shlex
from collections.abc import Iterator, Sequence

from mjbench import formats
from mjbench.commands.versions import show as verdicts
from mjbench.commands.versions.bisect import (
    BisectChange,
    BisectComparison,
    BisectRecord,
    VersionKind,
    short_name,
)
from mjbench.errors import file_argument
from mjbench.formats import count_of
from mjbench.paired.metrics import METRICS
from mjbench.paired.outcomes import Verdict
from mjbench.releases.release_names import wheel_digest
from mjbench.results.content import Column, Conclusion, DataTable, Section, Tone
from mjbench.results.runs import Record
from mjbench.status import Status


def sections(records: Sequence[Record]) -> list[Section]:
    """Return what searches come to, or what is known of one that did not end."""
    ended = [record for record in records if isinstance(record, BisectRecord)]
    comparisons = [record for record in records if isinstance(record, BisectComparison)]
    if not ended and comparisons:
        return [_unfinished(comparisons)]
    return [
        Section(
            f"Which {record.kind} changed {record.target}?",
            conclusions=[*_conclusions(record, len(comparisons))],
            tables=[_table(comparisons, record.kind)],
            notes=[] if record.ends is None else verdicts.notes(record.ends),
        )
        for record in ended
    ]


def _unfinished(comparisons: Sequence[BisectComparison]) -> Section:
    known = [each.verdict for each in comparisons if each.verdict is not None]
    is_of_commits = any(verdict.sides[0].revision for verdict in known)
    kind = VersionKind.COMMIT if is_of_commits else VersionKind.RELEASE
    target = known[0].row().model if known else "it"  # the ends are compared first
    return Section(
        f"Which {kind} changed {target}?",
        conclusions=[
            Conclusion(
                "The search has not ended: to continue, repeat the command with --resume and this"
                " run file",
                Tone.UNSURE,
            ),
            *(Conclusion(verdicts.describe_verdict(each.row())) for each in known),
        ],
        tables=[_table(comparisons, kind)],
    )


def _conclusions(record: BisectRecord, count: int) -> Iterator[Conclusion]:
    if record.ends is None or record.status != Status.OK:
        yield Conclusion(f"{record.target}: {record.detail or 'not measured'}", Tone.BAD)
        return
    ends = Conclusion(verdicts.describe_verdict(record.ends), _tone(record.ends.verdict))
    if record.ends.verdict not in (Verdict.SLOWER, Verdict.FASTER):
        yield ends
        yield Conclusion(
            "It is not certain whether there is anything to search for: repeat with a longer"
            " --budget, or on a quieter machine"
            if record.ends.verdict == Verdict.INCONCLUSIVE
            else "So there is nothing to search for."
        )
        return
    for change in record.changes:
        name = short_name(change.version, record.kind)
        subject = f" “{change.version.subject}”" if change.version.subject else ""
        skipped = ", ".join(short_name(row, record.kind) for row in change.skipped)
        others = f"; or one of {skipped}, which could not be measured" if skipped else ""
        text = f"{name}{subject}: {verdicts.describe_change(change.verdict)}{others}"
        yield Conclusion(text, _tone(change.verdict.verdict))
        yield from map(Conclusion, _causes(change, record))
    yield ends
    if record.detail:
        yield Conclusion(record.detail, Tone.UNSURE)
    yield Conclusion(
        f"{count_of(count, 'comparison')} among {count_of(record.versions, record.kind)} in"
        f" {formats.tenths(record.seconds)} s; each change was compared with the {record.kind}"
        " before it"
    )


def _causes(change: BisectChange, record: BisectRecord) -> Iterator[str]:
    """Yield how to see why a release is slower or faster."""
    metric = METRICS[change.verdict.metric]
    if record.kind != VersionKind.RELEASE or not (metric.is_of_steps or metric.is_exact):
        return
    if any(wheel_digest(side.build) for side in change.verdict.sides):  # a version names none
        return
    old, new = change.verdict.old, change.verdict.new
    model = shlex.quote(file_argument(record.target))
    yield f"Which functions changed: mjbench versions --explain {old} {new} {model}"


def _tone(verdict: Verdict | None) -> Tone:
    return {Verdict.SLOWER: Tone.BAD, Verdict.FASTER: Tone.GOOD}.get(
        verdict or Verdict.SAME, Tone.NEUTRAL
    )


def _table(comparisons: Sequence[BisectComparison], kind: VersionKind) -> DataTable:
    return DataTable.of(
        f"{kind.capitalize()}s that were compared",
        comparisons,
        (Column("against", formats.count), lambda each: each.first),
        (Column("number", formats.count), lambda each: each.version.number),
        (Column(kind.value), lambda each: short_name(each.version, kind)),
        (Column("change", formats.change), _estimate),
        (Column("verdict"), _verdict),
        (Column("remark", wraps=True), _remark),
    )


def _estimate(comparison: BisectComparison) -> float | None:
    verdict = comparison.verdict
    return None if verdict is None or verdict.ratio is None else verdict.ratio.estimate


def _verdict(comparison: BisectComparison) -> str | None:
    return None if comparison.verdict is None else comparison.verdict.verdict


def _remark(comparison: BisectComparison) -> str:
    """Return why a version could not be measured, or what it is."""
    failed = comparison.verdict.detail if comparison.verdict else ""
    return comparison.detail or failed or comparison.version.subject
