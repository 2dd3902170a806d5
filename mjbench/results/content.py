"""What results come to, whatever shows it: conclusions, tables, figures and notes."""

import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any, TypeVar

from mjbench import formats
from mjbench.formats import Form
from mjbench.host import disturbance
from mjbench.host.disturbance import Disturbance
from mjbench.interval import Interval

if TYPE_CHECKING:
    from mjbench.results.runs import Run

# What a cell can hold: a text, a number, an interval, or nothing.
Cell = str | float | int | Interval | None
_T = TypeVar("_T")


class Tone(StrEnum):
    """What a conclusion means for its reader."""

    CAUTION = "caution"
    GOOD = "good"
    BAD = "bad"
    UNSURE = "unsure"
    NEUTRAL = "neutral"


@dataclass(frozen=True)
class Conclusion:
    """One sentence that a section, or the whole report, comes to.

    Attributes:
      subject: what it is about, where the heading of its section says so; empty where the sentence
        does.
    """

    sentence: str
    tone: Tone = Tone.NEUTRAL
    subject: str = ""

    @property
    def text(self) -> str:
        """The sentence as it stands alone."""
        return f"{self.subject}: {self.sentence}" if self.subject else self.sentence


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
      title: with the unit, where its cells have none.
      form: how its numbers, or intervals, are written; None for a column of text.
      wraps: whether its cells are sentences, which wrap before other texts do.
      leaves: in which order columns leave a table that is too wide, the first one at 1; 0 for one
        that stays.
      is_bar: whether its cells are bars of text, which pages draw as a chart instead.
      has_figures: whether its texts are figures, which are aligned as numbers are.
    """

    title: str
    form: Form | None = None
    wraps: bool = False
    leaves: int = 0
    is_bar: bool = False
    has_figures: bool = False

    @property
    def is_number(self) -> bool:
        return self.form is not None

    @property
    def is_right_aligned(self) -> bool:
        """Whether its cells end below each other, and none may be cut."""
        return self.is_number or self.has_figures

    def number(self, cell: Cell) -> float | None:
        """Return what a cell is sorted by: its number, or the lower end of its interval."""
        match cell:
            case None | str():
                return None
            case int() | float():
                return cell
        return cell.low

    def raw(self, cells: Sequence[Cell]) -> list[list[str | float | None]]:
        """Return the columns of numbers, not rounded, that stand for it: a heading, then cells.

        An interval has two.
        """
        if self.form is None:
            return [[self.title, *map(self.shown, cells)]]
        match next((cell for cell in cells if not isinstance(cell, str | None)), 0.0):
            case int() | float():
                unit = formats.RAW_UNITS.get(self.form)
                parts = {f" ({unit})" if unit else "": "real"}
            case _:
                parts = {" (low)": "low", " (high)": "high"}
        return [
            [
                self.title + suffix,
                *(c if isinstance(c, str | None) else getattr(c, attribute) for c in cells),
            ]
            for suffix, attribute in parts.items()
        ]

    def shown(self, cell: Cell) -> str:
        if cell is None:
            return ""
        return str(cell) if isinstance(cell, str) or self.form is None else self.form(cell)


@dataclass(frozen=True)
class DataTable:
    """A table; each row has one cell a column."""

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]

    @classmethod
    def of(
        cls, title: str, items: Iterable[_T], *columns: tuple[Column, Callable[[_T], Cell]]
    ) -> "DataTable":
        """Return a table with a row for each item; each column comes with the cell of an item."""
        rows = [[cell(item) for _, cell in columns] for item in items]
        return cls(title, [column for column, _ in columns], rows)

    @property
    def texts(self) -> list[list[str]]:
        """Its rows as people read them."""
        return [
            [column.shown(cell) for column, cell in zip(self.columns, row, strict=True)]
            for row in self.rows
        ]

    @property
    def raw_rows(self) -> list[tuple[str | float | None, ...]]:
        columns = (
            column.raw([row[i] for row in self.rows]) for i, column in enumerate(self.columns)
        )
        return list(zip(*itertools.chain(*columns), strict=True))

    def filled_columns(self, with_bars: bool = True) -> "DataTable":
        """Return the table without the columns in which every cell is empty."""
        filled = [
            i
            for i, column in enumerate(self.columns)
            if any(column.shown(row[i]) for row in self.rows) and (with_bars or not column.is_bar)
        ]
        return self._with_columns(filled)

    def without(self, left_out: Collection[str]) -> "DataTable":
        stay = [i for i, column in enumerate(self.columns) if column.title not in left_out]
        return self._with_columns(stay)

    def _with_columns(self, chosen: Sequence[int]) -> "DataTable":
        columns = [self.columns[i] for i in chosen]
        return DataTable(self.title, columns, [[row[i] for i in chosen] for row in self.rows])


@dataclass(frozen=True)
class Figure:
    """A chart, and what a reader has who cannot see it.

    Attributes:
      alternative: what can be seen in it, in a sentence.
      specification: in Vega-Lite; its data are `data`.
    """

    title: str
    alternative: str
    specification: Mapping[str, Any]
    data: DataTable


@dataclass(frozen=True)
class Snippet:
    """Code that does what a result is about: Python, or MJCF."""

    title: str
    code: str


@dataclass(frozen=True)
class Section:
    """What a result comes to.

    Attributes:
      conclusions: what follows from it, first of all.
      facts: what was measured, and on what: lines above the tables.
      tables: those without rows are left out.
      notes: what limits the figures: lines below the tables.
      snippets: code that does what the section is about.
      shows_code: whether a terminal shows it without being asked.
      command: the command line that measured it.
      is_open: whether its tables are shown at once also on a page of many sections.
      is_summary: whether it stands for the conclusions of other sections, at the head of a page.
    """

    heading: str
    conclusions: Sequence[Conclusion] = ()
    facts: Sequence[str] = ()
    figures: Sequence[Figure] = ()
    tables: Sequence[DataTable] = ()
    notes: Sequence[str] = ()
    snippets: Sequence[Snippet] = ()
    shows_code: bool = False
    command: str = ""
    is_open: bool = False
    is_summary: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "tables", filled(*self.tables))

    @property
    def shown_tables(self) -> Sequence[DataTable]:
        return self.tables or [figure.data for figure in self.figures]


@dataclass(frozen=True)
class Report:
    """All that a report says.

    Attributes:
      subtitle: when, where and with which versions it was measured.
      conclusions: the main ones of its sections.
      further: conclusions for which there is no room at the head.
      summaries: sections that stand at the head.
    """

    title: str
    conclusions: Sequence[Conclusion]
    sections: Sequence[Section]
    subtitle: str = ""
    further: Sequence[Conclusion] = ()
    summaries: Sequence[Section] = ()
    machines: DataTable = field(default_factory=lambda: DataTable("Machines", (), ()))


def filled(*tables: DataTable) -> list[DataTable]:
    """Return the tables that have rows."""
    return [table for table in tables if table.rows]


def after_disturbances(run: "Run", sections: Iterable[Section]) -> list[Section]:
    """Return the sections of a run; what disturbed it comes first."""
    cautions = [
        Conclusion(disturbance.sentence(each.clauses), Tone.CAUTION)
        for each in run.of_type(Disturbance)
    ]
    listed = list(sections)
    if listed:
        listed[0] = replace(listed[0], conclusions=[*cautions, *listed[0].conclusions])
    return listed


def failure(name: str, status: str, detail: str) -> Section:
    text = f"{name}: {status}: {detail.removeprefix(f'{name}: ')}"
    return Section(name, [Conclusion(text, Tone.BAD)])
