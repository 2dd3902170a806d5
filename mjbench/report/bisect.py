"""What `mjbench bisect` comes to: the commits that changed the time of a function."""

from collections.abc import Iterator, Sequence

from mjbench.paired.bisect_records import BisectChange, BisectRecord, BisectTrial, CommitRow
from mjbench.paired.outcomes import Verdict
from mjbench.report import formats, verdicts
from mjbench.report.content import Column, Conclusion, DataTable, Section, Tone
from mjbench.status import Status
from mjbench.units import count_of, short_commit


def sections(records: Sequence[BisectRecord]) -> list[Section]:
    return [
        Section(
            f"Which commit changed {record.function}?",
            conclusions=[*_conclusions(record)],
            tables=[_table(record.trials)] if record.trials else [],
            notes=[] if record.ends is None else verdicts.notes(record.ends),
        )
        for record in records
    ]


def _conclusions(record: BisectRecord) -> Iterator[Conclusion]:
    if record.ends is None or record.status != Status.OK:
        yield Conclusion(f"{record.function}: {record.detail or 'not measured'}", Tone.BAD)
        return
    yield Conclusion(verdicts.describe_verdict(record.ends), _tone(record.ends.verdict))
    if record.ends.verdict not in (Verdict.SLOWER, Verdict.FASTER):
        yield Conclusion("So there is nothing to search for.")
        return
    for change in record.changes:
        yield Conclusion(_describe_change(change), _tone(change.verdict.verdict))
    if record.detail:
        yield Conclusion(record.detail, Tone.UNSURE)
    yield Conclusion(
        f"{count_of(len(record.trials), 'commit')} of {record.commits:,} measured in"
        f" {formats.tenths(record.seconds)} s; each change was compared again with the commit"
        " before it"
    )


def _describe_change(change: BisectChange) -> str:
    commit = change.commit
    text = f"{_name(commit)}: {verdicts.describe_change(change.verdict)}"
    if not change.skipped:
        return text
    names = ", ".join(short_commit(row.commit) for row in change.skipped)
    return f"{text}; or one of {names}, which could not be measured"


def _name(commit: CommitRow) -> str:
    return f"{short_commit(commit.commit)} “{commit.subject}”"


def _tone(verdict: Verdict | None) -> Tone:
    return {Verdict.SLOWER: Tone.BAD, Verdict.FASTER: Tone.GOOD}.get(
        verdict or Verdict.SAME, Tone.NEUTRAL
    )


def _table(trials: Sequence[BisectTrial]) -> DataTable:
    return DataTable.of(
        "Commits that were measured",
        sorted(trials, key=lambda trial: trial.commit.number),
        (Column("number", formats.count), lambda trial: trial.commit.number),
        (Column("commit"), lambda trial: short_commit(trial.commit.commit)),
        (Column("change", formats.change), lambda trial: trial.ratio),
        (Column("launches", formats.count), lambda trial: trial.launches),
        (Column("subject", wraps=True), lambda trial: trial.detail or trial.commit.subject),
    )
