"""Verdicts: versions, ab, and selfcheck, which tells how often they are wrong."""

import functools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from mjbench.cli.group import cli
from mjbench.cli.shared import (
    INTERRUPTED,
    JSON,
    JUDGING,
    RESULTS,
    SIZES,
    Words,
    check_sizes,
    exit_code,
    output,
    progress,
    with_options,
)
from mjbench.errors import InputError

_FINDINGS = ("slower", "faster", "changed-work", "inconclusive")


def _fail_on(ctx: click.Context, param: click.Parameter, value: str | None) -> list[str]:
    words = [word.strip() for word in (value or "").split(",") if word.strip()]
    unknown = [word for word in words if word not in _FINDINGS]
    if unknown:
        raise click.BadParameter(f"{unknown[0]!r} is not one of {', '.join(_FINDINGS)}")
    return words


_FAIL_ON = click.option(
    "--fail-on",
    metavar="FINDING,…",
    callback=_fail_on,
    help=f"Exit 1 when one of these is found: {', '.join(_FINDINGS)}.",
)


@cli.command()
@click.argument("words", nargs=-1, metavar="[OLD NEW… MODEL…]")
@click.option("--old", metavar="RELEASE", help="The old release, where it is not the first word.")
@click.option("--new", "news", multiple=True, metavar="RELEASE", help="A new release.")
@click.option("--paths", "path_names", type=Words(), help="Ways of stepping  [python_loop]")
@click.option(
    "--metric",
    type=click.Choice(["time", "instructions"]),
    default="time",
    show_default=True,
    help="Instructions need valgrind and no quiet machine; they are the engine's alone, exact, and"
    " know no --confidence, --precision and --time-limit.",
)
@_FAIL_ON
@with_options(*JUDGING, *SIZES, RESULTS, JSON)
def versions(
    words: tuple[str, ...],
    old: str | None,
    news: tuple[str, ...],
    path_names: list[str] | None,
    metric: str,
    fail_on: list[str],
    **chosen: Any,
) -> None:
    """Is MODEL slower with a NEW release of MuJoCo than with the OLD one?

    \b
    A release is a version (3.5.0), a wheel or a folder of wheels, or `installed`. Each is
    installed alone in a cache folder (`mjbench releases installs`); several NEW ones may be given.
      mjbench versions 3.3.0 4.0.0 humanoid
      mjbench versions 3.17.0 4.0.0 robot.xml --fail-on slower,changed-work
      mjbench versions 3.17.0 4.0.0 robot.xml --metric instructions --min-effect 0.5%
      mjbench versions --old installed --new dist/mujoco-4.1.0-cp311-….whl cartpole

    Ratios are new over old: above 1 is slower. A verdict of a release that does other work says
    so beside it.
    """
    from mjbench.paired import targets
    from mjbench.paired.protocol import Target
    from mjbench.releases import installs
    from mjbench.simulation import models

    named = [word for word in words if installs.is_release(word)]
    olds = [old] if old else named[:1]
    new_words = [*news, *(named if old else named[1:])]
    if not olds or not new_words:
        raise InputError("name an OLD and a NEW release, such as `mjbench versions 3.3.0 4.0.0`")
    given = [word for word in words if word not in named]
    sources = [models.resolve(name) for name in given or models.shipped()]
    ways = path_names or ["python_loop"]
    before, *after = [installs.parse_release(word) for word in [*olds, *new_words]]
    if metric == "instructions":
        if ways != ["python_loop"]:
            raise InputError("instructions are counted of python_loop alone: leave out --paths")
        sys.exit(_count(before, after, sources, fail_on, **chosen))
    options = {name: targets.way(name).complete({}) for name in ways}
    pairs = [
        (Target(before, source, name, options[name]), Target(release, source, name, options[name]))
        for release in after
        for source in sources
        for name in ways
    ]
    sys.exit(_decide("versions", pairs, fail_on, **chosen))


@cli.command()
@click.argument("old", metavar="SIDE")
@click.argument("new", metavar="SIDE")
@_FAIL_ON
@with_options(*JUDGING, *SIZES, RESULTS, JSON)
def ab(old: str, new: str, fail_on: list[str], **chosen: Any) -> None:
    """Compare two of anything, each SIDE given as KEY=VALUE,KEY=VALUE.

    \b
    Keys: model, path, release, an option of the path (threads, chunk, pool, data, …), a field of
    MjOption (solver, integrator, iterations, tolerance, …). Where one side names no model, path
    or release, it has the other side's; cartpole, python_loop, installed where neither does.
      mjbench ab path=rollout,threads=2 path=batch_rollout,threads=2
      mjbench ab model=a.xml model=b.xml
      mjbench ab model=humanoid,solver=newton solver=cg
    """
    from mjbench.paired import targets

    sys.exit(_decide("ab", [targets.parse(old, new)], fail_on, **chosen))


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option("--trials", type=click.IntRange(min=1), default=20, show_default=True)
@click.option(
    "--slowdowns",
    default="0,0.5,1,2,5",
    show_default=True,
    metavar="PERCENT,…",
    help="Slowdowns to inject; 0 is an A/A comparison.",
)
@click.option("--busy", is_flag=True, help="Keep the last core busy meanwhile.")
@with_options(*JUDGING, RESULTS, JSON)
def selfcheck(
    names: tuple[str, ...],
    trials: int,
    slowdowns: str,
    busy: bool,
    results: Path,
    json_file: str | None,
    **chosen: Any,
) -> None:
    """How often are verdicts wrong or undecided on this machine, now, and how long do they take?

    Compares the installed release with itself, with a slowdown of known size injected or none:
    false alarms, power, error of the estimate, seconds for a verdict. MODEL is cartpole and
    humanoid unless named.
    """
    from mjbench.instrument import machine
    from mjbench.instrument.runs import RunFile
    from mjbench.paired import selfcheck as room
    from mjbench.paired import verdict
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.report import tables, verdicts
    from mjbench.simulation import models

    try:
        sizes = [float(word.removesuffix("%")) / 100 for word in slowdowns.split(",")]
    except ValueError as error:
        raise InputError(f"--slowdowns {slowdowns}: {error}") from error
    sources = [models.resolve(name) for name in names or ("cartpole", "humanoid")]
    arms = [room.Arm(source, size) for source in sources for size in sizes]
    for arm in arms:
        _ = arm.sizes  # each must be possible
    plan_keys = ("min_effect", "confidence", "precision")
    plan = verdict.VerdictPlan(
        **{k: chosen[k] for k in plan_keys}, time_limit_s=chosen["time_limit"]
    )
    about: dict[str, Any] = machine.describe()
    found: list[dict[str, Any]] = []
    code = 0
    with output(json_file) as write_json:
        arguments = {**plan.as_dict(), "trials": trials, "busy": busy}
        run_file = RunFile(results, "selfcheck", {"machine": about, "arguments": arguments})
        out = tables.console(stderr=json_file == "-")
        with progress(out, trials * len(arms)) as advance:

            def on_trial(record: dict[str, Any]) -> None:
                run_file.append(record)
                found.append(record)
                advance(len(found), f"{record['model']} {100 * record['slowdown']:g} %", 0.0)

            with room.neighbour(busy), WorkerPool() as pool:
                try:
                    room.run(pool, arms, trials, plan, on_trial)
                except KeyboardInterrupt:
                    click.echo("mjbench: interrupted; what was measured is kept", err=True)
                    code = INTERRUPTED
        run_file.close()
        rows = room.summary(found)
        out.print(verdicts.selfcheck_table(rows))
        write_json({"schema": 1, "machine": about, "busy": busy, "results": rows})
    out.print(f"\nRun file: {run_file.path}", soft_wrap=True)
    sys.exit(code)


def _decide(
    command: str,
    pairs: Sequence[tuple[Any, Any]],
    fail_on: list[str],
    *,
    results: Path,
    json_file: str | None,
    **chosen: Any,
) -> int:
    from mjbench.instrument import machine
    from mjbench.instrument.runs import RunFile
    from mjbench.paired import verdict
    from mjbench.paired.worker_pool import WorkerPool
    from mjbench.report import tables, verdicts

    plan = plan_of(**chosen)
    about, found = machine.describe(), []
    with output(json_file) as write_json:
        run_file = RunFile(results, command, {"machine": about, "arguments": plan.as_dict()})
        out = tables.console(stderr=json_file == "-")
        with progress(out, len(pairs)) as advance, WorkerPool() as pool:
            for number, (old, new) in enumerate(pairs):
                name = f"{new.model.name} {new.release.version}"
                shown = functools.partial(_show_launch, advance, number, name)
                outcome = verdict.decide(pool, old, new, plan, shown)
                run_file.append(outcome.as_record())
                found.append(outcome.as_result())
                if outcome.status == "interrupted":
                    break
        run_file.close()
        verdicts.print_table(out, found)
        write_json({"schema": 1, "machine": about, "results": found})
    out.print(f"\nRun file: {run_file.path}", soft_wrap=True)
    return _verdict_code(found, fail_on)


def _count(
    old: Any,
    news: Sequence[Any],
    sources: Sequence[Any],
    fail_on: list[str],
    *,
    results: Path,
    json_file: str | None,
    **chosen: Any,
) -> int:
    from mjbench.counts import explain, instructions
    from mjbench.instrument import machine
    from mjbench.instrument.runs import RunFile
    from mjbench.report import tables, verdicts

    plan, about = plan_of(**chosen), machine.describe()
    with output(json_file) as write_json, instructions.InstructionCounter(plan.sizes) as counter:
        arguments = {**plan.as_dict(), "metric": "instructions"}
        run_file = RunFile(results, "versions", {"machine": about, "arguments": arguments})
        out = tables.console(stderr=json_file == "-")
        counts = []
        with progress(out, 1 + len(news)) as advance:
            for number, release in enumerate([old, *news]):
                advance(number, f"MuJoCo {release.version}", 0.0)
                counts.append(counter.count(release, sources))
        found = [
            explain.verdict_row(before, after, plan.min_effect)
            for counted in counts[1:]
            for before, after in zip(counts[0], counted, strict=True)
        ]
        for row in found:
            run_file.append({"type": "verdict", **row, "samples": []})
        run_file.close()
        verdicts.print_table(out, found)
        write_json({"schema": 1, "machine": about, "results": found})
    out.print(f"\nRun file: {run_file.path}", soft_wrap=True)
    return _verdict_code(found, fail_on)


def plan_of(
    *,
    min_effect: float,
    confidence: float,
    precision: float,
    time_limit: float,
    nbatch: int | None,
    nstep: int | None,
    hold: int,
    seed: int,
) -> Any:
    """Return the verdict.VerdictPlan that options ask for."""
    from mjbench.paired import protocol, verdict

    check_sizes(nstep, hold)
    sizes = protocol.Sizes(nbatch, nstep, hold, seed)
    return verdict.VerdictPlan(min_effect, confidence, precision, time_limit, sizes)


def _show_launch(advance: Any, number: int, name: str, judged: Any) -> None:
    share = 1 - 1 / (1 + judged.launches / 15)
    advance(number, f"{name} {100 * (judged.ratio - 1):+.2f} %", share)


def _verdict_code(found: Sequence[dict[str, Any]], fail_on: Sequence[str]) -> int:
    statuses = {row["status"] for row in found}
    if "interrupted" in statuses:
        click.echo("mjbench: interrupted; what was measured is kept", err=True)
        return INTERRUPTED
    if code := exit_code(statuses):
        return code
    hits = {row["verdict"] for row in found}
    hits |= {"changed-work"} if any(row["changed_work"] for row in found) else set()
    return 1 if hits & set(fail_on) else 0
