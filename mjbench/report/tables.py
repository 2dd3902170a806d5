"""What all tables share: the console, an empty table, options and numbers as people write them."""

import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from mjbench.errors import printable
from mjbench.instrument.ratio import Ratio
from mjbench.instrument.units import count_of as count_of
from mjbench.instrument.units import plain as plain
from mjbench.status import ExitCode

_PLAIN_WIDTH, _MIN_WIDTH = 160, 80
# Values of mjtWarning by which MuJoCo says that memory was full and it left something out.
_MEMORY_WARNINGS = ("CONTACTFULL", "CNSTRFULL", "VGEOMFULL")


class _Console(Console):
    """A console that prints text as it is: no markup, and no control character of foreign text.

    It ends the command with exit code 3 when nobody reads on (`… | head`).
    """

    def render_str(self, text: str, **style: Any) -> Text:  # every str in a line or a cell
        return super().render_str(_printable_lines(text), **style)

    def on_broken_pipe(self) -> None:
        try:
            super().on_broken_pipe()
        except SystemExit:
            raise SystemExit(ExitCode.ENVIRONMENT) from None


def console(stderr: bool = False) -> Console:
    """Return a console that never squeezes a table: the terminal wraps long lines."""
    out = _Console(stderr=stderr, highlight=False, markup=False, emoji=False)
    out.width = max(out.width, _MIN_WIDTH) if out.is_terminal else _PLAIN_WIDTH
    return out


def text_of(render: Callable[[Console], None]) -> str:
    """Return what a function prints to a console, as plain text.

    Args:
      render: prints to the console that it is given.
    """
    file = io.StringIO()
    # in a notebook, a console of Rich shows what it prints, whatever its file is
    out = _Console(
        file=file,
        width=_PLAIN_WIDTH,
        highlight=False,
        markup=False,
        emoji=False,
        color_system=None,
        force_terminal=False,
        force_jupyter=False,
    )
    render(out)
    return "\n".join(line.rstrip() for line in file.getvalue().strip("\n").split("\n"))


def headed(heading: str, rest: str) -> Text:
    """Return a line whose beginning is bold."""
    return Text.assemble((_printable_lines(heading), "bold"), _printable_lines(rest))


def _printable_lines(text: str) -> str:
    return "\n".join(map(printable, text.split("\n")))


def plain_table(
    headings: Sequence[str], right: Sequence[int] | range = (), wrapped: Sequence[int] = ()
) -> Table:
    """Return an empty table without frames.

    Args:
      headings: of its columns.
      right: columns that are right-aligned.
      wrapped: columns whose cells may have several lines; without any, the last one.
    """
    table = Table(box=None, pad_edge=False, header_style="bold")
    for i, heading in enumerate(headings):
        is_wrapped = i in (wrapped or [len(headings) - 1])
        table.add_column(
            heading,
            justify="right" if i in right else "left",
            no_wrap=not is_wrapped,
            overflow="fold",
        )
    return table


def short_names(names: Iterable[str]) -> dict[str, str]:
    """Return a short name for each: of a file, its own name where no other file has the same."""
    full = list(dict.fromkeys(names))
    own = [name.rpartition("/")[2] for name in full]
    return {
        name: short if own.count(short) == 1 else name
        for name, short in zip(full, own, strict=True)
    }


def all_machines(count: int) -> str:
    """Return `both machines` or, of more, such as `all 4 machines`."""
    return "both machines" if count == 2 else f"all {count} machines"


def warning_lines(warnings: Mapping[str, int] | None) -> list[str]:
    """Return what MuJoCo's warnings mean for a measurement, a line each.

    Args:
      warnings: how many simulations, none of which diverged, raised each; by its name.
    """
    counts = warnings or {}
    full = {name: count for name, count in counts.items() if name in _MEMORY_WARNINGS}
    other = {name: count for name, count in counts.items() if name not in _MEMORY_WARNINGS}
    lines = []
    if full:
        lines.append(
            f"The model's memory was full ({_simulations(full)}), so MuJoCo left out contacts or"
            ' constraints: enlarge it with <size memory="…"/>'
        )
    if other:
        lines.append(f"MuJoCo warned ({_simulations(other)}) but the simulations did not diverge")
    return lines


def _simulations(counts: Mapping[str, int]) -> str:
    """Return numbers of simulations by warning, such as `CNSTRFULL in 64 simulations`."""
    return ", ".join(
        f"{name} in {count} simulation{'s' * (count > 1)}" for name, count in counts.items()
    )


def factor(ratio: float) -> str:
    """Return a speed-up in the digits that mean something."""
    return f"{ratio:.2f}" if ratio >= 0.1 else plain(ratio, 1)


def ends(interval: Ratio | None) -> str:
    """Return the ends of the interval of a speed-up; empty without."""
    if interval is None or interval.low is None or interval.high is None:
        return ""
    return f"{factor(interval.low)}–{factor(interval.high)}"


def yes_no(value: bool) -> str:
    """Return `yes` or `no`."""
    return "yes" if value else "no"
