"""The help of a command: its own options first, then those that commands share, under headings."""

from collections.abc import Mapping, Sequence

import click

# The options of each heading, in the order of help; all others are a command's own.
HEADINGS: Mapping[str, Sequence[str]] = {
    "Workload": ("--nbatch", "--nstep", "--hold", "--seed", "--settle", "--states", "--actions"),
    "Statistics": ("--min-effect", "--confidence", "--precision", "--as-shipped", "--family"),
    "Files": (
        *("--results", "--resume", "--html", "--markdown", "--csv", "--json", "--junit"),
        *("--comment", "--github-benchmark", "--github", "--sarif"),
    ),
    "Other options": ("--time-limit", "--wait", "--help"),
}
_SHARED = {flag for flags in HEADINGS.values() for flag in flags}
# Characters of the column of flags, unless one is longer.
_MAX_COLUMN = 28


class Command(click.Command):
    """A command whose help has its options under headings."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, those without a heading first, with all texts in one column."""
        lines = {
            option.opts[-1]: line
            for option in self.get_params(ctx)
            if isinstance(option, click.Option) and (line := option.get_help_record(ctx))
        }
        short = (len(flags) for flags, _ in lines.values() if len(flags) <= _MAX_COLUMN)
        width = max(short, default=0)
        own = [flag for flag in lines if flag not in _SHARED]
        for heading, flags in {"Options": own, **HEADINGS}.items():
            if section := [lines[flag] for flag in flags if flag in lines]:
                with formatter.section(heading):
                    formatter.write_dl(
                        [(flags.ljust(width), text) for flags, text in section], width
                    )
