"""`--fail-on`: which verdicts end a command with exit code 1."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from mjbench.commands.shared_options import fail_on_option
from mjbench.options import FLAG, option
from mjbench.paired.outcomes import Verdict
from mjbench.status import ExitCode, Status, exit_code

if TYPE_CHECKING:
    from mjbench.paired.records import VerdictRow
    from mjbench.results.runs import Run


class GateFinding(StrEnum):
    """What `--fail-on` can name: a verdict, or work that changed."""

    SLOWER = Verdict.SLOWER
    FASTER = Verdict.FASTER
    CHANGED_WORK = "changed-work"
    INCONCLUSIVE = Verdict.INCONCLUSIVE


@dataclass(frozen=True)
class FailOnOptions:
    """What the exit code of a command depends on, beside failures.

    Attributes:
      allow_inconclusive: whether a verdict on speed may be inconclusive.
    """

    findings: Sequence[GateFinding] | None = fail_on_option(
        tuple(GateFinding),
        "`changed-work`: contacts, constraints, solver iterations or results of steps differ."
        " Exit 3 when it cannot be decided: the verdict is inconclusive, it may be due to where a"
        " build's code lies in memory, or the work was not compared.",
    )
    allow_inconclusive: bool = option(
        False,
        FLAG,
        "With --fail-on: an inconclusive verdict does not change the exit code.",
        of_functions=False,
    )

    def exit_code_of_run(self, run: "Run", confidence: float) -> ExitCode:
        """Return the exit code that the verdicts of a run stand for."""
        from mjbench.commands.versions.bisect import BisectRecord
        from mjbench.paired.records import VerdictRecord

        rows = [record.row() for record in run.of_type(VerdictRecord)]
        for search in run.of_type(BisectRecord):
            rows += [change.verdict for change in search.changes] or filter(None, [search.ends])
        return self.exit_code(rows, confidence)

    def exit_code(self, rows: Sequence["VerdictRow"], confidence: float) -> ExitCode:
        """Return the exit code that verdicts stand for; a failure outweighs a finding."""
        from mjbench.commands.versions import family

        code = exit_code(row.status for row in rows)
        if code != ExitCode.OK:
            return code
        rows = [row for row in rows if row.status != Status.NEW]  # there was nothing to find out
        decided = family.adjust_for_family(rows, confidence)
        is_there = {
            GateFinding.SLOWER: bool(decided.slower),
            GateFinding.FASTER: bool(decided.faster),
            GateFinding.CHANGED_WORK: any(row.changed_work for row in rows),
            GateFinding.INCONCLUSIVE: any(row.verdict == Verdict.INCONCLUSIVE for row in rows),
        }
        is_speed_open = any(
            row.verdict != Verdict.INCONCLUSIVE or not self.allow_inconclusive
            for row in decided.undecided
        )
        return self._code(is_there, is_speed_open, any(row.changed_work is None for row in rows))

    def exit_code_of_models(self, verdict_of: Sequence[tuple[str, Verdict | None]]) -> ExitCode:
        """Return the exit code that verdicts on models, one or several of each, stand for."""
        models, verdicts = {model for model, _ in verdict_of}, {each for _, each in verdict_of}
        is_there = {
            GateFinding.SLOWER: Verdict.SLOWER in verdicts,
            GateFinding.FASTER: Verdict.FASTER in verdicts,
            GateFinding.CHANGED_WORK: False,  # the rows of other work were refused
            GateFinding.INCONCLUSIVE: Verdict.INCONCLUSIVE in verdicts,
        }
        decided = {model for model, each in verdict_of if each not in (None, Verdict.INCONCLUSIVE)}
        is_open = Verdict.INCONCLUSIVE in verdicts or models - decided
        return self._code(
            is_there, bool(is_open) and not self.allow_inconclusive, is_work_open=False
        )

    def _code(
        self, is_there: Mapping[GateFinding, bool], is_speed_open: bool, is_work_open: bool
    ) -> ExitCode:
        """Return the exit code: what is there outweighs what could not be decided."""
        findings = set(self.findings or ())
        if any(is_there[finding] for finding in findings):
            return ExitCode.FINDING
        asks_for_speed = bool({GateFinding.SLOWER, GateFinding.FASTER} & findings)
        asks_for_work = GateFinding.CHANGED_WORK in findings
        is_open = (asks_for_speed and is_speed_open) or (asks_for_work and is_work_open)
        return ExitCode.ENVIRONMENT if is_open else ExitCode.OK
