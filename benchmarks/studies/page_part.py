"""The part of a page that a command writes; the rest of the page is written by people."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
_END = "<!-- end -->"


@dataclass(frozen=True)
class PagePart:
    """The lines of a page between two comments, of which the first one names the part.

    Attributes:
      page: below `docs/`.
      name: no other part of the page has it.
      writer: the module that writes the part.
    """

    page: str
    name: str
    writer: str

    @property
    def file(self) -> Path:
        """Where the page is."""
        return DOCS / self.page

    def text(self) -> str:
        """Return what the page has."""
        return self._split()[1]

    def write(self, lines: Iterable[str]) -> None:
        """Replace what the page has."""
        before, _, after = self._split()
        self.file.write_text(f"{before}{of_lines(lines)}{after}", encoding="utf-8")

    def _split(self) -> tuple[str, str, str]:
        """Return what is before, inside and after the part.

        Raises:
          ValueError: the page does not have the part exactly once.
        """
        page = self.file.read_text(encoding="utf-8")
        begin = f"<!-- {self.name}: written by {self.writer} -->\n"
        before, after_begin = page.split(begin)
        inside, _, after = after_begin.partition(_END)
        return f"{before}{begin}", inside, f"{_END}{after}"


def of_lines(lines: Iterable[str]) -> str:
    """Return lines as a part has them."""
    return "".join(f"{line}\n" for line in lines)
