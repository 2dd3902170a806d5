"""From run files to the content of a report."""

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mjbench.comparison.planning_run import PlanningRow
from mjbench.comparison.records import ModelRecord
from mjbench.comparison.scaling import ScalingRecord
from mjbench.counts.records import ExplainRecord, InstructionsRecord
from mjbench.environment.records import EnvironmentRecord
from mjbench.instrument.machine import Machine
from mjbench.instrument.runs import Run
from mjbench.loop.latency import LatencyRow
from mjbench.loop.overhead import OverheadRow
from mjbench.loop.profile import ProfileRow
from mjbench.pages import (
    comparisons,
    environments,
    histories,
    loops,
    programs,
    scaling,
    tuning,
    verdicts,
)
from mjbench.pages.content import Column, Conclusion, DataTable, Report, Section, Tone
from mjbench.paired import selfcheck
from mjbench.paired.confirmation import ConfirmationRecord
from mjbench.paired.placement_spread import SpreadRecord
from mjbench.paired.records import VerdictRecord
from mjbench.paired.selfcheck_records import TrialRecord
from mjbench.paired.verdict import CONFIDENCE
from mjbench.program.records import ProgramRow
from mjbench.releases import bundle
from mjbench.releases.release_ratios import RatioRecord
from mjbench.report import history_files
from mjbench.report.results import derive_all
from mjbench.report.speed_history import SpeedHistory
from mjbench.report.thread_advice import by_model
from mjbench.report.verdicts import confidence_of
from mjbench.tuning.accelerated_records import EngineTuneRecord
from mjbench.tuning.records import TuneRecord

# Conclusions that stand at the head of a report, at most; the others are in their sections.
_MOST_CONCLUSIONS = 40
# Figures that are drawn, at most: a page of more opens slowly. Tables are always there.
_MOST_FIGURES = 20


@dataclass(frozen=True)
class NamedRun:
    """A run file that was read.

    Attributes:
      file: its path.
      run: its content.
    """

    file: Path
    run: Run

    @property
    def command(self) -> str:
        """The command that wrote it, as it was typed where that is known."""
        header = self.run.header
        return shlex.join(["mjbench", *(header.command_line or (header.command,))])


def build(named_runs: Sequence[NamedRun]) -> Report:
    """Return the report of run files.

    Args:
      named_runs: in the order of their sections.

    Raises:
      InputError: runs hold ratios of releases that were measured on different machines.
    """
    sections = [section for named in named_runs for section in _sections(named)]
    history = _history(named_runs)
    if history is not None:
        command = next(n.command for n in named_runs if n.run.of_type(RatioRecord))
        sections += histories.sections(history, command)
    sections = list(_with_fewer_figures(sections))
    conclusions = [conclusion for section in sections for conclusion in section.conclusions]
    # what went wrong comes first
    conclusions.sort(key=lambda conclusion: conclusion.tone != Tone.BAD)
    if len(sections) == 1:  # its conclusions are those of the report
        sections = [replace(sections[0], conclusions=())]
    if not sections:
        conclusions.append(Conclusion("Nothing was measured.", Tone.UNSURE))
    title = f"mjbench {', '.join(dict.fromkeys(n.run.header.command for n in named_runs))}"
    if len(conclusions) > _MOST_CONCLUSIONS:
        rest = len(conclusions) - _MOST_CONCLUSIONS
        conclusions = conclusions[:_MOST_CONCLUSIONS]
        conclusions.append(Conclusion(f"{rest} further conclusions are in their sections."))
    return Report(title, conclusions, sections, _machines(named_runs))


def _with_fewer_figures(sections: Sequence[Section]) -> Iterator[Section]:
    """Yield sections, without figures once there are enough; a section says that it lacks them."""
    drawn = 0
    for section in sections:
        drawn += len(section.figures)
        if not section.figures or drawn <= _MOST_FIGURES:
            yield section
            continue
        note = f"Not drawn: a report has {_MOST_FIGURES} charts at most. Report fewer runs."
        tables = section.tables or [figure.data for figure in section.figures]
        yield replace(section, figures=(), tables=tables, notes=[*section.notes, note])


def _history(named_runs: Sequence[NamedRun]) -> SpeedHistory | None:
    """Return the history that runs with ratios of releases hold; None without such runs."""
    if not any(named.run.of_type(RatioRecord) for named in named_runs):
        return None
    causes = bundle.default_path().with_name("causes.toml")
    loaded = {named.file: named.run for named in named_runs}
    return history_files.of_runs(loaded, causes if causes.exists() else None)


def _sections(named: NamedRun) -> Iterator[Section]:
    """Yield the sections of a run."""
    run, command = named.run, named.command
    if run.of_type(ModelRecord):
        yield from comparisons.sections(derive_all(run.records), command)
    for results in by_model(run.of_type(ScalingRecord), run.of_type(ConfirmationRecord)):
        yield scaling.section(results, command)
    if rows := [record.row() for record in run.of_type(VerdictRecord)]:
        yield verdicts.section(rows, confidence_of(run.header), command)
    yield from loops.overhead_sections(run.of_type(OverheadRow), command)
    yield from loops.profile_sections(run.of_type(ProfileRow), command)
    yield from loops.latency_sections(run.of_type(LatencyRow), command)
    yield from loops.planning_sections(run.of_type(PlanningRow), command)
    yield from programs.sections(run.of_type(ProgramRow), command)
    yield from environments.sections(run.of_type(EnvironmentRecord), command)
    yield from tuning.sections(run.of_type(TuneRecord), command)
    yield from tuning.engine_sections(run.of_type(EngineTuneRecord), command)
    yield from verdicts.explanation_sections(run.of_type(ExplainRecord), command)
    yield from verdicts.count_sections(run.of_type(InstructionsRecord), command)
    if trials := run.of_type(TrialRecord):
        yield _selfcheck_section(trials, command)
    if spreads := run.of_type(SpreadRecord):
        yield _spread_section(spreads, command)


def _selfcheck_conclusion(trials: Sequence[TrialRecord]) -> Conclusion:
    rows = selfcheck.summary(trials)
    wrong = sum(round(row.wrong * row.trials) for row in rows)
    count = sum(row.trials for row in rows)
    tone = Tone.GOOD if wrong <= (1 - CONFIDENCE) * count else Tone.BAD
    return Conclusion(f"{wrong} of {count} verdicts on known truths are wrong", tone)


def _selfcheck_section(trials: Sequence[TrialRecord], command: str) -> Section:
    columns = (
        Column("model"),
        Column("builds"),
        Column("slowdown, %", 3),
        Column("averaged"),
        Column("trials", 3),
        Column("detected, share", 3),
        Column("wrong, share", 3),
        Column("bias, %", 2),
        Column("seconds", 3),
    )
    rows = [
        (
            row.model,
            f"{row.old} → {row.new}" if row.old != row.new else row.old,
            None if row.slowdown is None else 100 * row.slowdown,
            "yes" if row.averaged else "no",
            row.trials,
            row.detected,
            row.wrong,
            None if row.error is None else 100 * row.error,
            row.seconds,
        )
        for row in selfcheck.summary(trials)
    ]
    return Section(
        "How often is a verdict wrong?",
        command,
        [_selfcheck_conclusion(trials)],
        tables=[DataTable("Trials", columns, rows)],
    )


def _spread_section(spreads: Sequence[SpreadRecord], command: str) -> Section:
    columns = (
        Column("model"),
        Column("release"),
        Column("spread, %", 2),
        Column("low, %", 2),
        Column("high, %", 2),
        Column("launches", 3),
        Column("why not"),
    )
    rows = [record.row() for record in spreads]
    cells = [
        (
            row.model,
            row.release,
            *(
                (None,) * 3
                if row.spread is None
                else map(_percent, (row.spread.estimate, row.spread.low, row.spread.high))
            ),
            row.launches,
            row.detail,
        )
        for row in rows
    ]
    return Section(
        "How far does speed depend on where code lies?",
        command,
        tables=[DataTable("Spreads", columns, cells)],
    )


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _machines(named_runs: Sequence[NamedRun]) -> DataTable:
    columns = (
        Column("run file"),
        Column("processor"),
        Column("usable cores", 3),
        Column("system"),
        Column("Python"),
        Column("versions"),
    )
    return DataTable("Machines", columns, [_machine_cells(named) for named in named_runs])


def _machine_cells(named: NamedRun) -> tuple[str | int, ...]:
    machine: Machine = named.run.header.machine
    versions = ", ".join(f"{name} {version}" for name, version in machine.versions.items())
    cpu = f"{machine.cpu} (virtual)" if machine.hypervisor else machine.cpu
    return named.file.name, cpu, machine.usable_cores, machine.system, machine.python, versions
