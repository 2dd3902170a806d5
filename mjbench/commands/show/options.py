"""The options of `mjbench show`, and of the lists of what there is to measure."""

from dataclasses import dataclass
from pathlib import Path

from mjbench.commands.shared_options import (
    JsonOptions,
    OutputOptions,
    TimeLimitOptions,
    code_option,
)
from mjbench.commands.versions.fail_on import FailOnOptions
from mjbench.options import FLAG, file, option, text


@dataclass(frozen=True, kw_only=True)
class ShowOptions(FailOnOptions, OutputOptions):
    """What is shown of run files, beside their format."""

    output: str | None = option(
        None,
        text("FILE"),
        "With a format: write to FILE, or - for stdout  [default: report.html, others to stdout]."
        " After --html, a last word that ends in .html is FILE, too.",
        "-o",
        "--output",
    )
    against: Path | None = option(
        None,
        file("OLD"),
        "Compare the speeds of RUN with those of an earlier one, row by row.",
    )
    across: bool = option(
        False,
        FLAG,
        "With --against: compare even where JAX, jaxlib, XLA flags, device or precision differ.",
    )
    code: bool = code_option()
    resume: None = None
    wait: None = None


@dataclass(frozen=True, kw_only=True)
class ListOptions(TimeLimitOptions, JsonOptions):
    """How models are listed."""
