"""What a report holds: conclusions, sections, figures and tables, whatever their form."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from mjbench.report import tables

# What a cell can hold: a text, a number, or nothing.
Cell = str | float | int | None


class Tone(StrEnum):
    """What a conclusion means for its reader."""

    CAUTION = "caution"
    GOOD = "good"
    BAD = "bad"
    UNSURE = "unsure"
    NEUTRAL = "neutral"


@dataclass(frozen=True)
class Conclusion:
    """One sentence that a section, or the whole report, comes to."""

    text: str
    tone: Tone = Tone.NEUTRAL


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
      title: with the unit, where there is one.
      digits: significant digits of its numbers; None for a column of text.
      is_factor: whether its numbers are speed-ups, which are written alike everywhere.
    """

    title: str
    digits: int | None = None
    is_factor: bool = False

    @property
    def is_number(self) -> bool:
        """Whether it holds numbers."""
        return self.digits is not None

    def shown(self, cell: Cell) -> str:
        """Return a cell as people read it."""
        if cell is None:
            return ""
        if isinstance(cell, str) or self.digits is None:
            return str(cell)
        if self.is_factor:
            return tables.factor(float(cell))
        if abs(cell) >= 1000:
            return f"{cell:,.0f}"
        return tables.plain(float(cell), self.digits)


@dataclass(frozen=True)
class DataTable:
    """A table.

    Attributes:
      rows: cells, one a column.
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]


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
class Section:
    """A part of a report.

    Attributes:
      conclusions: what follows from it, first of all.
      tables: what they are made of, and more.
      notes: what a reader must know besides.
      is_open: whether its tables are shown at once also on a page of many sections.
    """

    heading: str
    command: str
    conclusions: Sequence[Conclusion] = ()
    figures: Sequence[Figure] = ()
    tables: Sequence[DataTable] = ()
    notes: Sequence[str] = ()
    is_open: bool = False


@dataclass(frozen=True)
class Report:
    """All that a report says.

    Attributes:
      conclusions: the main ones of its sections.
      sections: in the order of their runs.
    """

    title: str
    conclusions: Sequence[Conclusion]
    sections: Sequence[Section]
    machines: DataTable = field(default_factory=lambda: DataTable("Machines", (), ()))
