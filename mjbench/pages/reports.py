"""From run files and run sets to the content of a report."""

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mjbench.comparison.planning_run import PlanningRow
from mjbench.comparison.records import ModelRecord
from mjbench.counts.records import ExplainRecord, InstructionsRecord
from mjbench.environment.records import EnvironmentRecord
from mjbench.errors import printable
from mjbench.instrument import run_set
from mjbench.instrument.machine import Machine
from mjbench.instrument.machine_identity import MachineIdentity
from mjbench.instrument.runs import Run
from mjbench.loop.latency import LatencyRow
from mjbench.loop.overhead import OverheadRow
from mjbench.loop.profile import ProfileRow
from mjbench.pages import (
    comparisons,
    environments,
    histories,
    loops,
    machines,
    programs,
    tuning,
    verdicts,
    web,
)
from mjbench.pages.content import Column, Conclusion, DataTable, Report, Section, Tone
from mjbench.paired import family, selfcheck
from mjbench.paired.placement_spread import SpreadRecord
from mjbench.paired.records import VerdictRecord
from mjbench.paired.selfcheck_records import TrialRecord
from mjbench.paired.verdict import CONFIDENCE
from mjbench.program.records import ProgramRow
from mjbench.releases import bundle
from mjbench.releases.release_ratios import RatioRecord
from mjbench.report import across_machines as across
from mjbench.report import history_files
from mjbench.report.documents import RECORD_TYPES
from mjbench.report.results import derive_all
from mjbench.tuning.records import TuneRecord
from mjbench.web.records import WebRecord

# Sections of single runs, at most, where there are several runs: a page of more is of no use.
_MOST_SECTIONS = 100
# Files that the command of a section names, at most.
_MOST_FILES = 3
# Conclusions that stand at the head of a report, at most; the others are in their sections.
_MOST_CONCLUSIONS = 40
# Figures that are drawn, at most: a page of more opens slowly. Tables are always there.
_MOST_FIGURES = 20


@dataclass(frozen=True)
class NamedRun:
    """A run that was read.

    Attributes:
      file: path of its run file, or of the set that it is in.
    """

    file: Path
    run: Run

    @property
    def command(self) -> str:
        """The command that wrote it, as it was typed where that is known."""
        header = self.run.header
        return shlex.join(["mjbench", *(header.command_line or (header.command,))])


@dataclass(frozen=True)
class _Part:
    """A section, and what of it stands at the head of the report."""

    section: Section
    main: Sequence[Conclusion]


def read(files: Sequence[Path]) -> list[NamedRun]:
    """Return the runs of files, each once.

    Args:
      files: run files and run sets.

    Raises:
      InputError: a file is neither.
    """
    sections = run_set.load_files(files, RECORD_TYPES)
    return [NamedRun(file, section.run) for file, section in sections]


def build(named_runs: Sequence[NamedRun]) -> Report:
    """Return the report of runs, of one machine or of several.

    Args:
      named_runs: in the order of their sections.
    """
    results = across.side_by_side([named.run for named in named_runs])
    parts = [
        part
        for named, machine in zip(named_runs, results.machines, strict=True)
        for part in _parts(named, machine.name if results.has_several else "")
    ]
    parts += _history_parts(named_runs)
    chosen = _most_important(parts) if len(named_runs) > 1 else parts
    # several models may say the same
    main = list(dict.fromkeys(conclusion for part in chosen for conclusion in part.main))
    main.sort(key=lambda conclusion: conclusion.tone != Tone.BAD)
    sections = [part.section for part in chosen]
    if results.has_several and (first := machines.section(results, _report_command(named_runs))):
        main = [*first.conclusions, *main]
        # they stand right above it, unless there are too many
        are_all_above = len(first.conclusions) <= _MOST_CONCLUSIONS
        sections.insert(0, replace(first, conclusions=()) if are_all_above else first)
    main.sort(key=lambda conclusion: conclusion.tone != Tone.CAUTION)
    sections = list(_with_fewer_figures(sections))
    if len(sections) == 1:  # its conclusions are those of the report
        sections = [replace(sections[0], conclusions=())]
    if not sections:
        main.append(Conclusion("Nothing was measured.", Tone.UNSURE))
    title = f"mjbench {', '.join(dict.fromkeys(n.run.header.command for n in named_runs))}"
    if len(main) > _MOST_CONCLUSIONS:
        rest = len(main) - _MOST_CONCLUSIONS
        main = main[:_MOST_CONCLUSIONS]
        main.append(Conclusion(f"{rest} further conclusions are in their sections."))
    if len(chosen) < len(parts):
        main.append(_left_out(len(parts) - len(chosen), len(parts)))
    return Report(title, main, sections, _machines(named_runs, results.machines))


def first_of(conclusions: Sequence[Conclusion]) -> list[Conclusion]:
    """Return what to know before the numbers, and what went wrong."""
    return [each for each in conclusions if each.tone in (Tone.CAUTION, Tone.BAD)]


def _report_command(named_runs: Sequence[NamedRun]) -> str:
    files = list(dict.fromkeys(str(named.file) for named in named_runs))
    more = ["…"] if len(files) > _MOST_FILES else []
    return " ".join([shlex.join(["mjbench", "report", *files[:_MOST_FILES]]), *more])


def _most_important(parts: Sequence[_Part]) -> list[_Part]:
    """Return as many parts as a report has room for: those in which something went wrong first."""
    is_bad = [any(c.tone == Tone.BAD for c in part.section.conclusions) for part in parts]
    ranked = sorted(range(len(parts)), key=lambda n: not is_bad[n])
    return [parts[n] for n in sorted(ranked[:_MOST_SECTIONS])]


def _left_out(count: int, total: int) -> Conclusion:
    return Conclusion(
        f"Left out: {count:,} of {total:,} sections of single runs. Those in which something went"
        " wrong come first. Report fewer runs to see all; mjbench.load has all results.",
        Tone.UNSURE,
    )


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


def _history_parts(named_runs: Sequence[NamedRun]) -> list[_Part]:
    """Return the sections of the history that runs with ratios of releases hold."""
    timed = [named for named in named_runs if named.run.of_type(RatioRecord)]
    if not timed:
        return []
    causes = bundle.default_path().with_name("causes.toml")
    each = history_files.of_runs(
        [named.run for named in named_runs], causes if causes.exists() else None
    )
    sections = histories.of_machines(each, timed[0].command)
    return [_Part(section, section.conclusions) for section in sections]


def _parts(named: NamedRun, machine: str) -> Iterator[_Part]:
    """Yield the sections of a run.

    Args:
      named: the run.
      machine: its name, where there are several: then what machines show side by side stands at the
        head, in place of what one of them shows.
    """
    run, command = named.run, named.command

    def part(section: Section, is_side_by_side: bool = False) -> _Part:
        if not machine:
            return _Part(section, section.conclusions)
        headed = replace(section, heading=f"{machine}: {section.heading}")
        return _Part(headed, () if is_side_by_side else section.conclusions)

    if run.of_type(ModelRecord):
        for section in comparisons.sections(derive_all(run.records), command):
            first = [replace(c, text=f"{machine}: {c.text}") for c in first_of(section.conclusions)]
            yield replace(part(section), main=first) if machine else part(section)
    if rows := [record.row() for record in run.of_type(VerdictRecord)]:
        confidence = family.confidence_of(run.header)
        yield part(verdicts.section(rows, confidence, command), is_side_by_side=True)
    for section in _other_sections(run, command):
        yield part(section)


def _other_sections(run: Run, command: str) -> Iterator[Section]:
    """Yield the sections of a run of which nothing stands side by side with other machines."""
    yield from loops.overhead_sections(run.of_type(OverheadRow), command)
    yield from loops.profile_sections(run.of_type(ProfileRow), command)
    yield from loops.latency_sections(run.of_type(LatencyRow), command)
    yield from loops.planning_sections(run.of_type(PlanningRow), command)
    yield from programs.sections(run.of_type(ProgramRow), command)
    yield from environments.sections(run.of_type(EnvironmentRecord), command)
    yield from web.sections(run.of_type(WebRecord), command)
    yield from tuning.sections(run.of_type(TuneRecord), command)
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
        for row in spreads
    ]
    return Section(
        "How far does speed depend on where code lies?",
        command,
        tables=[DataTable("Spreads", columns, cells)],
    )


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _machines(named_runs: Sequence[NamedRun], identities: Sequence[MachineIdentity]) -> DataTable:
    columns = (
        Column("machine"),
        Column("run file"),
        Column("processor"),
        Column("usable cores", 3),
        Column("system"),
        Column("Python"),
        Column("versions"),
    )
    pairs = zip(named_runs, identities, strict=True)
    # a set may hold many runs of a machine
    rows = dict.fromkeys((identity.name, *_machine_cells(named)) for named, identity in pairs)
    return DataTable("Machines", columns, list(rows))


def _machine_cells(named: NamedRun) -> tuple[str | int, ...]:
    machine: Machine = named.run.header.machine
    versions = ", ".join(f"{name} {version}" for name, version in machine.versions.items())
    cpu = f"{machine.cpu} (virtual)" if machine.hypervisor else machine.cpu
    return (
        printable(named.file.name),
        cpu,
        machine.usable_cores,
        machine.system,
        machine.python,
        versions,
    )
