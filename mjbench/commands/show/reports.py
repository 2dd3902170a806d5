"""From run files to the content of a report."""

import itertools
import shlex
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mjbench import command_names, formats
from mjbench.commands.show import kinds, machine_comparison
from mjbench.errors import one_line, printable
from mjbench.formats import count_of
from mjbench.results import runs
from mjbench.results.content import Column, Conclusion, DataTable, Report, Section, Tone
from mjbench.results.machine_identity import MachineIdentity
from mjbench.results.runs import Run

# Sections of single runs, at most, where there are several runs: a page of more is of no use.
_MOST_SECTIONS = 100
# Files that the command of a section names, at most.
_MOST_FILES = 3
# Conclusions that stand at the head of a report, at most; the others are in their sections.
_MOST_CONCLUSIONS = 8
# Characters of a title, and parts of a subtitle, at most.
_TITLE_LENGTH, _MOST_FACTS = 80, 8
# Sections that are shown at once, at most.
_MOST_OPEN = 3
# Figures that are drawn, at most: a page of more opens slowly. Tables are always there.
_MOST_FIGURES = 20


@dataclass(frozen=True)
class NamedRun:
    """A run that was read, and its run file."""

    file: Path
    run: Run

    @property
    def command(self) -> str:
        """The command that wrote it, as it was typed."""
        return shlex.join(["mjbench", *self.run.header.command_line])


@dataclass(frozen=True)
class _Part:
    """A section, and what of it stands at the head of the report.

    Attributes:
      source: name of the file that it is from; empty if it is from several.
    """

    section: Section
    main: Sequence[Conclusion]
    source: str = ""


def read(files: Sequence[Path]) -> list[NamedRun]:
    """Return the runs of run files; InputError for what is none."""
    return [NamedRun(file, runs.load(file, kinds.RECORD_TYPES)) for file in dict.fromkeys(files)]


def build(named_runs: Sequence[NamedRun]) -> Report:
    compared = machine_comparison.of_runs([named.run for named in named_runs])
    parts = [
        replace(part, source=printable(named.file.stem))
        for named, machine in zip(named_runs, compared.identities, strict=True)
        for part in _parts(named, machine.name if compared.has_several else "")
    ]
    chosen = _with_unique_headings(_most_important(parts)) if len(named_runs) > 1 else parts
    # several models may say the same
    main = list(dict.fromkeys(conclusion for part in chosen for conclusion in part.main))
    main.sort(key=lambda conclusion: conclusion.tone != Tone.BAD)
    summaries = [replace(p.section, conclusions=()) for p in chosen if p.section.is_summary]
    sections = [part.section for part in chosen if not part.section.is_summary]
    if compared.has_several and (first := machine_comparison.section(compared)):
        summaries.insert(0, replace(first, conclusions=(), command=_report_command(named_runs)))
        main = [*first.conclusions, *main]
    main.sort(key=lambda conclusion: conclusion.tone != Tone.CAUTION)
    summaries, sections = _with_fewer_figures(summaries, sections)
    if len(sections) <= _MOST_OPEN and not summaries:
        sections = [replace(section, is_open=True) for section in sections]
        if len(main) <= _MOST_CONCLUSIONS:  # they are those of the report
            sections = [replace(section, conclusions=()) for section in sections]
            sections = [each for each in sections if _has_content(each)] or sections
    if not (sections or summaries):
        main.append(Conclusion("Nothing was measured.", Tone.UNSURE))
    if len(chosen) < len(parts):
        main.insert(0, _left_out(len(parts) - len(chosen), len(parts)))
    return Report(
        title(named_runs),
        main[:_MOST_CONCLUSIONS],
        sections,
        _subtitle(named_runs),
        main[_MOST_CONCLUSIONS:],
        summaries,
        _machines(named_runs, compared.identities),
    )


def _with_unique_headings(parts: Sequence[_Part]) -> list[_Part]:
    """Return parts with headings of their own: equal ones get their file's name, or a number."""
    names = [part.section.heading for part in parts]
    repeats = Counter(names)
    names = [
        f"{name} ({part.source})" if repeats[name] > 1 and part.source else name
        for name, part in zip(names, parts, strict=True)
    ]
    repeats, numbers = Counter(names), defaultdict[str, Iterator[int]](lambda: itertools.count(1))
    names = [f"{name} ({next(numbers[name])})" if repeats[name] > 1 else name for name in names]
    return [
        replace(part, section=replace(part.section, heading=name))
        for part, name in zip(parts, names, strict=True)
    ]


def _has_content(section: Section) -> bool:
    """Return whether a section says more than its conclusions."""
    return bool(
        section.facts or section.tables or section.figures or section.notes or section.snippets
    )


def title(named_runs: Sequence[NamedRun]) -> str:
    if len(named_runs) != 1:
        names = (command_names.command_of(named.run.header.command) for named in named_runs)
        return f"mjbench {', '.join(dict.fromkeys(names))}"
    (named,) = named_runs
    return one_line(named.command, _TITLE_LENGTH)


def _subtitle(named_runs: Sequence[NamedRun]) -> str:
    days = sorted({named.run.header.began[:10] for named in named_runs} - {""})
    machines = [named.run.header.machine for named in named_runs]
    parts = [
        " to ".join(dict.fromkeys([*days[:1], *days[-1:]])),
        *dict.fromkeys(f"{m.cpu}, {count_of(m.usable_cores, 'core')}" for m in machines),
        *dict.fromkeys(
            f"MuJoCo {m.versions['mujoco']}" for m in machines if "mujoco" in m.versions
        ),
        *dict.fromkeys(f"Python {m.python}" for m in machines),
    ]
    shown = [part for part in parts if part]
    return " · ".join(shown[:_MOST_FACTS]) + " …" * (len(shown) > _MOST_FACTS)


def first_of(conclusions: Sequence[Conclusion]) -> list[Conclusion]:
    """Return what to know before the numbers, and what went wrong."""
    return [each for each in conclusions if each.tone in (Tone.CAUTION, Tone.BAD)]


def _report_command(named_runs: Sequence[NamedRun]) -> str:
    files = list(dict.fromkeys(str(named.file) for named in named_runs))
    more = ["…"] if len(files) > _MOST_FILES else []
    return " ".join([shlex.join(["mjbench", "show", *files[:_MOST_FILES]]), *more, "--html FILE"])


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


def _with_fewer_figures(*groups: Sequence[Section]) -> list[list[Section]]:
    """Return sections, without figures once there are enough; a section says that it lacks some."""
    room = _MOST_FIGURES

    def fewer(section: Section) -> Section:
        nonlocal room
        drawn, others = section.figures[:room], section.figures[room:]
        room -= len(drawn)
        if not others:
            return section
        note = f"Not drawn: a report has {_MOST_FIGURES} charts at most. Report fewer runs."
        tables = section.tables or [figure.data for figure in others]
        return replace(section, figures=drawn, tables=tables, notes=[*section.notes, note])

    return [[fewer(section) for section in group] for group in groups]


def _parts(named: NamedRun, machine: str) -> Iterator[_Part]:
    """Yield the sections of a run.

    Args:
      machine: its name where there are several: what they show side by side then stands at the
        head, in place of what one of them shows.
    """
    of_run = kinds.kinds_of(named.run)
    for kind in of_run:
        is_detail = kinds.CHECKUP in of_run and kind is not kinds.CHECKUP
        sections = [*kind.sections(named.run)]
        has_summary = any(section.is_summary for section in sections)
        for section in sections:
            section = replace(section, command=named.command)
            if not machine or is_detail:
                main = section.conclusions
                if has_summary and not section.is_summary:
                    main = first_of(main)
                yield _Part(section, () if is_detail else main)
                continue
            section = replace(section, heading=f"{machine}: {section.heading}")
            yield _Part(section, _main(kind, section, machine))


def _main(kind: kinds.Kind, section: Section, machine: str) -> Sequence[Conclusion]:
    """Return what of a section stands at the head of a report of several machines."""
    if kind is kinds.VERDICT:  # they stand side by side
        return ()
    conclusions = section.conclusions
    if kind is kinds.COMPARE:  # its advice stands side by side
        conclusions = first_of(conclusions)
    return [Conclusion(f"{machine}: {each.text}", each.tone) for each in conclusions]


def _machines(named_runs: Sequence[NamedRun], identities: Sequence[MachineIdentity]) -> DataTable:
    return DataTable.of(
        "Machines",
        [
            (identity.name, printable(named.file.name), named.run.header.machine)
            for named, identity in zip(named_runs, identities, strict=True)
        ],
        (Column("machine"), lambda row: row[0]),
        (Column("run file"), lambda row: row[1]),
        (Column("processor"), lambda row: f"{row[2].cpu}{' (virtual)' * row[2].hypervisor}"),
        (Column("usable cores", formats.count), lambda row: row[2].usable_cores),
        (Column("system"), lambda row: row[2].system),
        (Column("Python"), lambda row: row[2].python),
        (Column("versions"), lambda row: ", ".join(map(" ".join, row[2].versions.items()))),
    )
