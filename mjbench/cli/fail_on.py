"""`--fail-on`: which verdicts end a command with exit code 1, and which leave it undecided."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import click

from mjbench.paired.outcomes import Cause, Verdict
from mjbench.status import ExitCode, exit_code

if TYPE_CHECKING:
    from mjbench.paired.records import VerdictRow


class Finding(StrEnum):
    """What `--fail-on` can name: a verdict, or work that changed."""

    SLOWER = Verdict.SLOWER
    FASTER = Verdict.FASTER
    CHANGED_WORK = "changed-work"
    INCONCLUSIVE = Verdict.INCONCLUSIVE


def _findings(ctx: click.Context, param: click.Parameter, value: str | None) -> list[Finding]:
    names = [name.strip() for name in (value or "").split(",") if name.strip()]
    for name in names:
        if name not in list(Finding):
            raise click.BadParameter(f"{name!r} is not one of {', '.join(Finding)}")
    if value is not None and not names:
        raise click.BadParameter(f"no finding given; name one or more of {', '.join(Finding)}")
    return [Finding(name) for name in names]


FAIL_ON = (
    click.option(
        "--fail-on",
        "findings",
        metavar="FINDING,…",
        callback=_findings,
        help=f"Exit 1 for one of these: {', '.join(Finding)}. Exit 3 when it cannot be decided:"
        " the verdict is inconclusive, it may be due to where a build's code lies in memory, or the"
        " work was not compared.",
    ),
    click.option(
        "--allow-inconclusive",
        is_flag=True,
        help="With --fail-on: an inconclusive verdict does not change the exit code.",
    ),
)


@dataclass(frozen=True)
class FailOn:
    """What the exit code of a command depends on, beside failures.

    Attributes:
      findings: what ends it with exit code 1.
      allow_inconclusive: whether a verdict on speed may be inconclusive.
    """

    findings: Sequence[Finding] = ()
    allow_inconclusive: bool = False

    def exit_code(self, rows: Sequence["VerdictRow"]) -> ExitCode:
        """Return the exit code that verdicts stand for; a failure outweighs a finding."""
        code = exit_code(row.status for row in rows)
        if code != ExitCode.OK:
            return code
        outcomes: set[str] = {
            row.verdict for row in rows if row.verdict is not None and not _may_be_placement(row)
        }
        if any(row.changed_work for row in rows):
            outcomes.add(Finding.CHANGED_WORK)
        if outcomes & set(self.findings):
            return ExitCode.FINDING
        return ExitCode.ENVIRONMENT if self._is_undecided(rows) else ExitCode.OK

    def _is_undecided(self, rows: Sequence["VerdictRow"]) -> bool:
        asks_for_speed = bool({Finding.SLOWER, Finding.FASTER} & set(self.findings))
        is_speed_open = any(
            row.verdict in (None, Verdict.INCONCLUSIVE) or _may_be_placement(row) for row in rows
        )
        is_work_open = any(row.changed_work is None for row in rows)
        return (asks_for_speed and is_speed_open and not self.allow_inconclusive) or (
            Finding.CHANGED_WORK in self.findings and is_work_open
        )


def _may_be_placement(row: "VerdictRow") -> bool:
    """Return whether times differ, and it could not be averaged out where the code lies."""
    could_not_average = row.placement is not None and bool(row.placement.problem)
    is_different = row.verdict in (Verdict.SLOWER, Verdict.FASTER)
    return is_different and could_not_average and row.cause == Cause.UNDECIDED
