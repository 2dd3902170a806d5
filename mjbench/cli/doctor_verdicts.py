"""`mjbench doctor --verdicts`: how often verdicts are wrong."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from mjbench.cli.context import OutputOptions, measure_and_print
from mjbench.cli.group import cli
from mjbench.cli.shared import COUNT, SHARES, STORING, TRIAL_PLAN, with_options
from mjbench.errors import Failure
from mjbench.simulation import engine_library, models

if TYPE_CHECKING:
    from mjbench.api.session import Observer
    from mjbench.paired.selfcheck import Case
    from mjbench.paired.verdict import VerdictPlan
    from mjbench.store.runs import Record

# The arm of known slowdowns, unless other arms are asked for.
_SLOWDOWNS = (0.0, 0.005, 0.01, 0.02, 0.05)


@cli.command("doctor --verdicts")
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option(
    "--trials",
    type=COUNT,
    default=20,
    show_default=True,
    help="Comparisons for each row of the table.",
)
@click.option(
    "--slowdowns",
    type=SHARES,
    help="Slowdowns to inject: by how much longer each block of the candidate lasts; 0 compares"
    " identical targets  [default: 0,0.5,1,2,5; none with --inside-step or --between-builds]",
)
@click.option(
    "--inside-step",
    "functions",
    type=click.Choice(list(engine_library.FUNCTIONS)),
    multiple=True,
    metavar="FUNCTION",
    help="Slow the candidate down inside mj_step, by one more call of this C function of MuJoCo:"
    f" {', '.join(engine_library.FUNCTIONS)}. Can be given several times.",
)
@click.option(
    "--between-builds",
    is_flag=True,
    help="Compare releases whose steps execute equally many instructions, which should be `same`.",
)
@click.option("--busy", is_flag=True, help="Keep the last core busy during the trials.")
@with_options(TRIAL_PLAN, STORING)
def doctor_verdicts(
    names: tuple[str, ...],
    trials: int,
    slowdowns: list[float] | None,
    functions: tuple[str, ...],
    between_builds: bool,
    busy: bool,
    plan: "VerdictPlan",
    output: OutputOptions,
) -> None:
    """How often are verdicts wrong or undecided on this machine, now, and how long do they take?

    Compares the installed release with itself, with a slowdown of known size injected or none, and
    reports false alarms, power, the error of the estimate, and seconds per verdict. As between
    releases, the machine code of both targets is moved from launch to launch, unless --as-shipped
    is given.

    Without a MODEL: cartpole and humanoid, and all shipped models for --between-builds.

    \b
    Examples:
      mjbench doctor --verdicts
      mjbench doctor --verdicts cartpole --slowdowns 0,1 --trials 20
    """
    from mjbench.api.session import Item, Measurement, input_files, pinning_notes
    from mjbench.paired import selfcheck
    from mjbench.paired.selfcheck_records import trial_records
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.report.selfcheck import describe_case

    if slowdowns is None:
        slowdowns = [] if functions or between_builds else list(_SLOWDOWNS)
    functions = tuple(dict.fromkeys(functions))
    cases = _cases(names, slowdowns, functions, between_builds)
    sources = list(dict.fromkeys(case.candidate.model for case in cases))

    def items(earlier: "Sequence[Record]", observer: "Observer") -> "Iterator[Item]":
        done = trial_records(earlier)
        remaining = selfcheck.remaining(cases, trials, done)
        with (
            selfcheck.busy_neighbour_core() if busy else contextlib.nullcontext(),
            WorkerPool() as pool,
        ):
            for number, (case, ended) in enumerate(selfcheck.run(pool, remaining, plan), len(done)):
                name = f"{case.model}, {describe_case(case)}"
                if isinstance(ended, Failure):
                    yield Item(failure=Failure(ended.status, f"{name}: {ended.detail}"))
                    continue
                observer(name, (number + 1) / (trials * len(cases)))
                yield Item([ended])

    measurement = Measurement(
        "selfcheck",
        {
            **asdict(plan),
            "trials": trials,
            "busy": busy,
            "slowdowns": slowdowns,
            "models": [source.name for source in sources],
            "inside_step": list(functions),
            "between_builds": between_builds,
        },
        input_files(sources, [], plan.sizes.starts),
        items,
        trial_records,
        pinning_notes(),
    )
    measure_and_print(measurement, output, at_end=True).exit()


def _cases(
    names: Sequence[str], slowdowns: Sequence[float], functions: Sequence[str], between_builds: bool
) -> list["Case"]:
    from mjbench.paired import selfcheck
    from mjbench.releases.release import NO_CHANGE_PAIRS

    few = [models.resolve(name) for name in names or ("cartpole", "humanoid")]
    cases = [selfcheck.slowed(source, share) for source in few for share in slowdowns]
    cases += [selfcheck.inside_step(source, name) for source in few for name in functions]
    if between_builds:
        sources = [models.resolve(name) for name in names or models.shipped()]
        cases += [
            selfcheck.between_builds(source, pair) for source in sources for pair in NO_CHANGE_PAIRS
        ]
    return cases
