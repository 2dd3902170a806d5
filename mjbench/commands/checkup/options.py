"""The options of `mjbench checkup`."""

from dataclasses import dataclass

from mjbench.commands.shared_options import (
    LoopStartOptions,
    OutputOptions,
    TimeLimitOptions,
    WholeBudgetOptions,
    code_option,
)
from mjbench.options import option, text


@dataclass(frozen=True, kw_only=True)
class CheckupOptions(WholeBudgetOptions, LoopStartOptions, TimeLimitOptions, OutputOptions):
    """What a check-up may cost, and where it is written."""

    EACH_S, QUICK_S = 60.0, 15.0
    html: str | None = option(
        None, text("FILE"), "Also write the report as an HTML page.", of_functions=False
    )
    markdown: str | None = option(
        None, text("FILE|-"), "Also write the report as Markdown.", of_functions=False
    )
    code: bool = code_option()
    resume: None = None
