"""Verdicts as a comment on a pull request: one screen, changed rows first, the rest folded.

The headline is computed from the rows that are shown. The first line is a marker that is the same
in every run of a command, so that a workflow finds its own comment, and edits it.
"""

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

from mjbench import formats
from mjbench.commands.versions import family
from mjbench.commands.versions import show as verdicts
from mjbench.commands.versions.family import Family
from mjbench.errors import InputError
from mjbench.formats import duration, short_commit
from mjbench.interval import Interval
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import VerdictRecord, VerdictRow
from mjbench.results.content import Column, DataTable
from mjbench.results.markdown import code, data_table, escaped, folded
from mjbench.results.runs import Run
from mjbench.status import Status

# Characters of a comment, at most: GitHub refuses longer ones.
_MOST_CHARACTERS = 60_000


class _Outcome(Enum):
    """What a row counts as in the headline: its mark, and a word."""

    SLOWER = "❌", "slower"
    OTHER_RESULTS = "❌", "with other results"
    FAILED = "❌", "not measured"
    UNDECIDED = "❔", "undecided"
    NEW = "🆕", "new"
    FASTER = "✅", "faster"
    SAME = "✅", "same"

    @property
    def mark(self) -> str:
        return self.value[0]

    @property
    def word(self) -> str:
        return self.value[1]


_BAD = (_Outcome.SLOWER, _Outcome.OTHER_RESULTS, _Outcome.FAILED)


@dataclass(frozen=True)
class _Judged:
    row: VerdictRow
    outcome: _Outcome


def render(run: Run) -> Iterator[str]:
    """Yield the lines of a comment.

    Raises:
      InputError: the run is of another command than `versions` or `ab`.
    """
    rows = [record.row() for record in run.of_type(VerdictRecord)]
    if not rows and run.records:
        raise InputError(
            f"a run of `{run.header.command}` has no verdicts: give one of versions or ab"
        )
    confidence = family.confidence_of(run.header)
    decided = family.adjust_for_family(rows, confidence)
    judged = [_Judged(row, _outcome(row, decided)) for row in rows]
    yield f"<!-- mjbench:{run.header.command} -->"
    yield _headline(judged)
    yield from _sides(rows, confidence)
    changed = [each for each in judged if each.outcome != _Outcome.SAME]
    yield from _table(changed)
    yield ""
    yield f"Reproduce: {code(_command(run, rows))}"
    if rows:
        lines = (f"- {j.outcome.mark} {escaped(verdicts.describe_verdict(j.row))}" for j in judged)
        yield from folded(f"All {len(rows)} comparisons", lines)
    yield from folded("Machine and versions", data_table(_machine(run)))


def text(run: Run) -> str:
    whole = "\n".join(render(run)) + "\n"
    if len(whole) <= _MOST_CHARACTERS:
        return whole
    return whole[:_MOST_CHARACTERS].rpartition("\n")[0] + "\n\nThe rest is left out.\n"


def _outcome(row: VerdictRow, decided: Family) -> _Outcome:
    if row.status == Status.NEW:
        return _Outcome.NEW
    if row.status == Status.DISAGREES or row.changed_work:
        return _Outcome.OTHER_RESULTS
    if row.status != Status.OK:
        return _Outcome.FAILED
    if row in decided.slower:
        return _Outcome.SLOWER
    if row in decided.faster:
        return _Outcome.FASTER
    return _Outcome.SAME if row.verdict == Verdict.SAME else _Outcome.UNDECIDED


def _headline(judged: Sequence[_Judged]) -> str:
    counts = {each: sum(j.outcome == each for j in judged) for each in _Outcome}
    parts = [f"{o.mark} {count} {o.word}" for o, count in counts.items() if count]
    if counts[_Outcome.NEW] == len(judged):
        what = f": {', '.join(parts)}" if parts else ""
        return f"### mjbench: ⚠️ nothing was compared{what}"
    if any(counts[outcome] for outcome in _BAD):
        action = "action needed"
    else:
        action = "look at what is undecided" if counts[_Outcome.UNDECIDED] else "no action needed"
    return f"### mjbench: {' · '.join(parts)}: {action}"


def _sides(rows: Sequence[VerdictRow], confidence: float) -> Iterator[str]:
    pairs = dict.fromkeys(tuple(_side(row, number) for number in (0, 1)) for row in rows)
    for old, new in pairs:
        yield (
            f"{old} → {new} · one job, blocks in turns · of those named slower, at most"
            f" {100 * (1 - confidence):g} % are expected to be false alarms"
        )
    controls = [row.control for row in rows if row.control is not None]
    if controls:
        worst = max(controls, key=lambda control: abs(control.ratio.estimate - 1))
        yield escaped(verdicts.describe_control(worst))


def _side(row: VerdictRow, number: int) -> str:
    side, name = row.sides[number], (row.old, row.new)[number]
    if not side.revision:
        return f"MuJoCo {escaped(name)}"
    if side.commit.startswith(name):
        return code(name)
    return f"{escaped(name)} {code(short_commit(side.commit))}".strip()


def _table(judged: Sequence[_Judged]) -> Iterator[str]:
    if not judged:
        return
    yield ""
    yield from data_table(
        DataTable.of(
            "Changes",
            judged,
            (Column(""), lambda each: each.outcome.mark),
            (Column("what"), lambda each: each.row.model),
            (Column("change", has_figures=True), lambda each: _change(each.row.ratio)),
            (Column("baseline", has_figures=True), lambda each: _call(each.row)),
            (Column("outcome"), lambda each: each.outcome.word),
            (Column("why"), lambda each: each.row.detail or verdicts.describe_work(each.row)),
        )
    )


def _change(ratio: Interval | None) -> str:
    return "" if ratio is None else formats.with_interval(ratio, formats.change)


def _call(row: VerdictRow) -> str:
    return "" if row.calls_s is None else duration(1e9 * row.calls_s.old)


def _command(run: Run, rows: Sequence[VerdictRow]) -> str:
    """Return the command that does it again, with commits in place of branches."""
    words = list(run.header.command_line) or [run.header.command]
    positions = iter(range(1, len(words)))
    for side in rows[0].sides if rows else ():
        names = (side.revision, side.commit)
        named = (p for p in positions if words[p].removeprefix("rev=") in names)
        if (position := next(named, None)) is not None and side.commit:
            words[position] = f"rev={short_commit(side.commit)}"
    return shlex.join(["mjbench", *words])


def _machine(run: Run) -> DataTable:
    machine = run.header.machine
    rows = [
        ("processor", f"{machine.cpu}{' (virtual)' * machine.hypervisor}"),
        ("usable cores", str(machine.usable_cores)),
        ("system", machine.system),
        ("Python", machine.python),
        *machine.versions.items(),
    ]
    return DataTable("Machine", [Column("of"), Column("is")], rows)
