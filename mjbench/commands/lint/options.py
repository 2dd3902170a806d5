"""The options of `mjbench lint`."""

from dataclasses import dataclass, replace

from mjbench.commands.shared_options import JsonOptions, output_option
from mjbench.options import FLAG, NAMES, option

_CODES = replace(NAMES, metavar="CODE,…")


@dataclass(frozen=True, kw_only=True)
class LintOptions(JsonOptions):
    """Which rules are checked, and where findings go beside standard output."""

    select: list[str] | None = option(
        None,
        _CODES,
        "Check only rules with these codes or prefixes of codes",
        unset="`select` in pyproject.toml, else all",
    )
    ignore: list[str] | None = option(
        None,
        _CODES,
        "Leave out rules with these codes or prefixes of codes",
        unset="`ignore` in pyproject.toml",
    )
    statistics: bool = option(False, FLAG, "Print the number of findings of each rule instead.")
    github_file: str | None = output_option("--github", "annotations of GitHub Actions")
    sarif_file: str | None = output_option("--sarif", "findings as SARIF, for code scanning,")
