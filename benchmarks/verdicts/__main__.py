r"""How often verdicts are wrong or undecided on this machine, and how long they take.

    python -m benchmarks.verdicts [MODEL]…

compares the installed release with itself, with a slowdown of known size or none, and prints false
alarms, power, the error of the estimate and the time of a verdict. As between releases, launches
move the machine code of both targets. Without a MODEL: cartpole and humanoid, and all shipped
models for --between-builds.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from benchmarks.studies import tally_command
from benchmarks.verdicts import planted, section, trials
from benchmarks.verdicts.records import TrialRecord
from mjbench.cli.context import measure_and_print
from mjbench.cli.shared import Text, takes
from mjbench.commands.shared_options import RunFileOptions, results_option
from mjbench.commands.versions import family
from mjbench.commands.versions.options import JudgingOptions
from mjbench.options import COUNT
from mjbench.results.content import Section, after_disturbances
from mjbench.results.runs import Run

RESULTS = Path("results/verdicts")


@dataclass(frozen=True, kw_only=True)
class TrialOptions(JudgingOptions, RunFileOptions):
    """What a trial may cost, and where the run file lies."""

    results: Path = results_option(RESULTS)


@click.command(help=__doc__)
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option(
    "--trials",
    "count",
    type=Text(COUNT),
    default=20,
    show_default=True,
    help="Comparisons for each row of the table.",
)
@click.option(
    "--slowdown",
    "percentages",
    type=click.FloatRange(0, 1000),
    multiple=True,
    metavar="PERCENT",
    help="By how much longer each block of the candidate lasts; 0 compares identical targets. May"
    " be repeated  [default: 0, 0.5, 1, 2, 5; none with --inside-step or --between-builds]",
)
@click.option(
    "--inside-step",
    "functions",
    type=click.Choice(list(planted.FUNCTIONS)),
    multiple=True,
    metavar="FUNCTION",
    help="Slow the candidate down inside mj_step, by one more call of this C function of MuJoCo:"
    f" {', '.join(planted.FUNCTIONS)}. May be repeated.",
)
@click.option(
    "--between-builds",
    "builds",
    is_flag=True,
    help="Compare releases whose steps execute equally many instructions, which should be `same`.",
)
@click.option("--busy", "is_busy", is_flag=True, help="Keep the last core busy during the trials.")
@takes(TrialOptions)
def verdicts(percentages: Sequence[float], options: TrialOptions, **values: Any) -> None:
    """Measure trials, store them, and print what they come to."""
    slowdowns = [percentage / 100 for percentage in percentages]
    measurement = trials.measurement(slowdowns=slowdowns, plan=options.plan, **values)
    measure_and_print(measurement, options, summary=_summary).exit()


def _summary(run: Run) -> Iterator[Section]:
    confidence, min_effect = family.rule_of(run.header)
    rows = trials.summary(run.of_type(TrialRecord), min_effect)
    yield from after_disturbances(run, [section.section(rows, confidence, min_effect)])


if __name__ == "__main__":
    sys.exit(tally_command.run_measuring("verdicts", verdicts))
