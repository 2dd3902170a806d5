"""What `mjbench doctor` says: what spoils measurements here, and which changes can be decided."""

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.text import Text

from mjbench.instrument.conditions import Condition, Grade
from mjbench.report import tables

# The change of which a gate should be certain.
TRUSTED = 0.01
_STYLES = {Grade.GOOD: "green", Grade.NOTE: "yellow", Grade.BAD: "red"}
_LABELS = {Grade.GOOD: "ok", Grade.NOTE: "note", Grade.BAD: "bad"}


@dataclass(frozen=True, kw_only=True)
class NoiseRow:
    """What a comparison of the cart-pole with itself showed.

    Attributes:
      launches: of both sides.
      deviation: standard deviation of their log ratios.
      ratio: of the one side over the other; 1 but for noise.
      decidable: the smallest change that a verdict of a minute decides, as a share.
      trusted: whether that is 1 % or less.
      detail: why it was not measured, in one line; empty where it was.
    """

    launches: int = 0
    deviation: float | None = None
    ratio: float | None = None
    decidable: float | None = None
    trusted: bool = False
    detail: str = ""


def print_conditions(out: Console, conditions: Sequence[Condition]) -> None:
    """Print what was looked at, a line each, with what to do."""
    width = max(len(condition.name) for condition in conditions)
    for condition in conditions:
        line = Text.assemble(
            (f"{_LABELS[condition.grade]:<5}", _STYLES[condition.grade]),
            f"{condition.name:<{width}}  {condition.detail}",
        )
        out.print(line, soft_wrap=True)
        if condition.remedy:
            out.print(f"{'':<{width + 7}}{condition.remedy}", soft_wrap=True)


def print_noise(out: Console, noise: NoiseRow) -> None:
    """Print which changes can be decided here."""
    out.print()
    if noise.decidable is None or noise.deviation is None:
        out.print(tables.headed("Not measured", f": {noise.detail}"), soft_wrap=True)
        return
    size = tables.plain(100 * noise.decidable, 2)
    heading = f"A verdict of a minute decides changes of {size} % and more"
    rest = (
        f" of a small model, with --min-effect {size}% (the cart-pole beside itself:"
        f" {noise.launches} launches, which differ by {tables.plain(100 * noise.deviation, 2)} %)."
    )
    out.print(tables.headed(heading, rest), soft_wrap=True)
    if not noise.trusted:
        out.print("This machine cannot be trusted with 1 % now.", soft_wrap=True)
