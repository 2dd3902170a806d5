"""The commands. No logic lives here: words are parsed, rooms are called, lines are printed.

Exit codes: 0 fine; 1 a finding (paths disagree); 2 bad usage or input; 3 the environment failed
(a crash, a time limit, a full disk); 130 interrupted.
"""

import contextlib
import functools
import json
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import mjbench
from mjbench.errors import InputError, MachineError, MjbenchError
from mjbench.runs import FOLDER

if TYPE_CHECKING:
    from mjbench.compare import Plan
    from mjbench.models import Source

_FAILED = ("crashed", "timeout", "failed")
_INTERRUPTED = 130


class _Cli(click.Group):
    """A group whose errors are one line with the exit code they stand for."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except MjbenchError as error:
            click.echo(f"mjbench: {error}", err=True)
            sys.exit(error.exit_code)
        except (KeyboardInterrupt, click.Abort):
            click.echo("mjbench: interrupted", err=True)
            sys.exit(_INTERRUPTED)


class _Numbers(click.ParamType[list[int]]):
    """Comma-separated whole numbers, each at least 1."""

    name = "N,N,…"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[int]:
        if isinstance(value, list):
            return value
        try:
            numbers = [int(word) for word in value.split(",")]
        except ValueError:
            self.fail(f"{value!r} is not a list of whole numbers such as 1,2,4", param, ctx)
        if min(numbers) < 1:
            self.fail(f"{min(numbers)} is below 1", param, ctx)
        return list(dict.fromkeys(numbers))


class _Words(click.ParamType[list[str]]):
    """Comma-separated words."""

    name = "NAME,…"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[str]:
        if isinstance(value, list):
            return value
        words = [word.strip() for word in value.split(",") if word.strip()]
        if not words:
            self.fail("names nothing", param, ctx)
        return words


_JSON = click.option(
    "--json", "json_file", metavar="FILE|-", help="Write results as JSON to FILE, or - for stdout."
)
_LIMIT = click.option(
    "--time-limit",
    default=60.0,
    show_default=True,
    type=click.FloatRange(min=0.1),
    metavar="SECONDS",
    help="Kill a model's process when it is silent for longer.",
)
_RESULTS = click.option(
    "--results",
    default=FOLDER,
    show_default=True,
    metavar="DIR",
    type=click.Path(path_type=Path, file_okay=True),
    help="Where run files are kept.",
)


@click.group(cls=_Cli, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(mjbench.__version__, message="mjbench %(version)s")
def cli() -> None:
    """Which way of stepping MuJoCo from Python is fastest, for your model on your machine?

    \b
    Examples:
      mjbench compare                        every path on our ten models
      mjbench compare cartpole humanoid      two of them
      mjbench compare robot.xml --threads 1,2,4 --nbatch 256
      mjbench compare gymnasium:ant --hold 5 --paths python_loop_hold,batch_step
      mjbench models                         what there is to run
      mjbench paths                          what can be compared here
      mjbench releases                       which MuJoCo releases exist, here and elsewhere

    MODEL is one of ours (`mjbench models`), a path to .xml or .mjb, or PACKAGE:NAME for a model
    inside an installed package, such as gymnasium:ant or dm_control:humanoid.

    Exit codes: 0 fine, 1 a finding (paths disagree), 2 bad usage or input, 3 the environment
    failed (crash, time limit, disk), 130 interrupted.
    """


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option("--paths", "path_names", type=_Words(), help="Only these paths (`mjbench paths`).")
@click.option("--threads", type=_Numbers(), help="Thread counts  [default: 1 and usable cores]")
@click.option("--chunk", type=_Numbers(), help="Simulations a thread takes at a time.")
@click.option(
    "--option",
    "chosen",
    multiple=True,
    metavar="NAME=V,V",
    help="Values of any other option of a path, such as pool=new or record=qpos.",
)
@click.option("--nbatch", type=click.IntRange(min=1), help="Simulations  [default: up to 64]")
@click.option("--nstep", type=click.IntRange(min=1), help="Steps of each  [default: up to 200]")
@click.option(
    "--hold",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Steps that each control is held.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Decides start states and controls.",
)
@click.option(
    "--budget",
    type=click.FloatRange(min=0.0),
    metavar="SECONDS",
    help="Time to spend on timing each model  [default: 8]",
)
@_LIMIT
@_RESULTS
@_JSON
def compare(
    names: tuple[str, ...],
    path_names: list[str] | None,
    threads: list[int] | None,
    chunk: list[int] | None,
    chosen: tuple[str, ...],
    nbatch: int | None,
    nstep: int | None,
    hold: int,
    seed: int,
    budget: float | None,
    time_limit: float,
    results: Path,
    json_file: str | None,
) -> None:
    """Compare all ways of stepping MODELs: speed, and whether they compute the same.

    \b
    Final states are compared first, bit by bit; a path that disagrees gets no speed.
    Blocks of every path are timed in turns. Raw samples go to a run file in results/runs;
    `mjbench show` prints it again.
    """
    from mjbench import compare as room
    from mjbench import measure, models

    if nstep and nstep % hold:
        raise InputError(f"--nstep {nstep} is not a multiple of --hold {hold}")
    sources = [models.resolve(name) for name in names or models.shipped()]
    sources = list({source.path: source for source in sources}.values())
    own = any(":" in name for name in path_names or ())
    if own:
        sys.path.insert(0, str(Path.cwd()))
    choices = _choices(chosen, path_names)
    if chunk:
        choices["chunk"] = chunk
    variants = room.variants(path_names or [], threads, choices)
    largest = max(max(o.get("threads", 1), o.get("processes", 1)) for _, o in variants)
    plan = room.Plan(
        variants=variants,
        nbatch=nbatch,
        nstep=nstep,
        hold=hold,
        seed=seed,
        budget_s=measure.BUDGET_S if budget is None else budget,
        limit_s=time_limit,
        largest=largest,
        import_from=str(Path.cwd()) if own else None,
    )
    sys.exit(_compare(sources, plan, results, json_file))


def _compare(sources: Sequence["Source"], plan: "Plan", folder: Path, json_file: str | None) -> int:
    from mjbench import compare as room
    from mjbench import machine
    from mjbench.report import results as derive
    from mjbench.report import tables
    from mjbench.runs import RunFile

    about = machine.describe()
    with _json_target(json_file) as write_json:
        arguments = {"models": [s.name for s in sources], **plan.as_dict()}
        run_file = RunFile(folder, "compare", {"machine": about, "arguments": arguments})
        out = tables.console(stderr=json_file == "-")
        found: list[dict[str, Any]] = []
        interrupted = False
        failure: MachineError | None = None
        with _progress(out, len(sources)) as advance:
            for number, source in enumerate(sources):
                outcome = room.compare_model(source, plan, functools.partial(advance, number))
                try:
                    for record in outcome.records:
                        run_file.append(record)
                except MachineError as error:
                    failure = error
                found += tables.model_report(out, outcome.records)
                interrupted = outcome.interrupted
                if interrupted or failure:
                    break
        run_file.close()
        write_json(derive.document(about, found))
    out.print(f"\nRun file: {run_file.path}", soft_wrap=True)
    if failure:
        raise failure
    if interrupted:
        click.echo("mjbench: interrupted; what was measured is kept", err=True)
        return _INTERRUPTED
    return _exit_code(found)


def _exit_code(results: Sequence[dict[str, Any]]) -> int:
    statuses = {r["status"] for r in results}
    if "disagrees" in statuses:
        return 1
    if statuses & set(_FAILED):
        return 3
    return 2 if "input" in statuses else 0


def _choices(chosen: Sequence[str], path_names: list[str] | None) -> dict[str, list[Any]]:
    """Return option values by name from words such as `pool=new,kept`."""
    from mjbench import paths

    known = {
        option.name: option
        for name in [*paths.registry(), *(path_names or [])]
        for option in paths.find(name).options
    }
    choices = {}
    for word in chosen:
        name, equals, values = word.partition("=")
        if not equals or name not in known:
            raise InputError(f"--option {word}: give NAME=VALUE, NAME one of {', '.join(known)}")
        option = known[name]
        try:
            parsed = [option.parse(value) for value in values.split(",")]
        except ValueError as error:
            raise InputError(f"--option {word}: {error}") from error
        if option.allowed and not set(parsed) <= set(option.allowed):
            raise InputError(f"--option {word}: {name} is one of {', '.join(option.allowed)}")
        if option.parse is int and min(parsed) < 1:
            raise InputError(f"--option {word}: must be at least 1")
        choices[name] = parsed
    return choices


@cli.command()
@click.argument("file", required=False, type=click.Path(path_type=Path))
@_RESULTS
@_JSON
def show(file: Path | None, results: Path, json_file: str | None) -> None:
    """Print a run FILE again (default: the newest in results/runs)."""
    from mjbench import runs, selfcheck
    from mjbench.report import results as derive
    from mjbench.report import tables, verdicts

    header, *records = runs.load(file or runs.latest(results))
    out = tables.console(stderr=json_file == "-")
    found: list[dict[str, Any]] = []
    with _json_target(json_file) as write_json:
        kinds = {record["type"] for record in records}
        if "trial" in kinds:
            rows = selfcheck.summary(records)
            out.print(verdicts.selfcheck_table(rows))
            write_json({"schema": 1, "machine": header["machine"], "results": rows})
            return
        if "verdict" in kinds:
            rows = [record for record in records if record["type"] == "verdict"]
            verdicts.print_table(out, rows)
            for row in rows:
                row.pop("samples")
            write_json({"schema": 1, "machine": header["machine"], "results": rows})
            return
        for group in derive.by_model(records):
            if any(r["type"] == "model" for r in group):
                found += tables.model_report(out, group)
        write_json(derive.document(header["machine"], found))


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@_LIMIT
@_JSON
def models(names: tuple[str, ...], time_limit: float, json_file: str | None) -> None:
    """List models: sizes, contacts and constraints at the start, timestep, integrator, solver."""
    from mjbench import listing
    from mjbench import models as room
    from mjbench.report import tables

    sources = [room.resolve(name) for name in names or room.shipped()]
    with _json_target(json_file) as write_json:
        rows = listing.facts(sources, time_limit)
        tables.print_models(tables.console(stderr=json_file == "-"), rows)
        write_json({"schema": 1, "models": rows})
    sys.exit(_exit_code(rows))


@cli.command()
@_JSON
def paths(json_file: str | None) -> None:
    """List the ways of stepping, what they can do, and why one is not available here."""
    from mjbench import paths as room
    from mjbench.report import tables

    rows = [
        {
            "path": path.name,
            "summary": path.summary,
            "closed_loop": path.closed_loop,
            "unavailable": path.unavailable(),
            "options": {option.name: option.summary for option in path.options},
        }
        for path in room.registry().values()
    ]
    with _json_target(json_file) as write_json:
        tables.console(stderr=json_file == "-").print(tables.paths_table(rows))
        write_json({"schema": 1, "paths": rows})


class _Share(click.ParamType[float]):
    """A percentage such as `1%` or `0.5`, as a share."""

    name = "PERCENT"

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        if isinstance(value, float):
            return value
        try:
            share = float(str(value).removesuffix("%")) / 100
        except ValueError:
            self.fail(f"{value!r} is not a percentage such as 1%", param, ctx)
        if not 0 < share < 1:
            self.fail(f"{value} is not between 0% and 100%", param, ctx)
        return share


def _with(*options: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds options to a command, in their order."""

    def add(command: Callable[..., None]) -> Callable[..., None]:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def _seconds(ctx: click.Context, param: click.Parameter, value: str) -> float:
    try:
        seconds = float(value.removesuffix("s"))
    except ValueError:
        raise click.BadParameter(f"{value!r} is no time such as 60s") from None
    if not 0 < seconds < float("inf"):
        raise click.BadParameter(f"{value} is not above 0")
    return seconds


_JUDGING = (
    click.option(
        "--min-effect",
        type=_Share(),
        default="1%",
        show_default=True,
        help="Smallest change that matters; what is surely within it is `same`.",
    ),
    click.option(
        "--confidence",
        type=_Share(),
        default="99%",
        show_default=True,
        help="That a verdict is right.",
    ),
    click.option(
        "--precision",
        type=_Share(),
        default="0.5%",
        show_default=True,
        help="Stop when the interval is this narrow (half of its width).",
    ),
    click.option(
        "--time-limit",
        default="60s",
        show_default=True,
        metavar="SECONDS",
        callback=_seconds,
        help="Of launches, for each verdict; after it, `inconclusive` if it is not certain.",
    ),
)
_SIZES = (
    click.option("--nbatch", type=click.IntRange(min=1), help="Simulations of a block."),
    click.option("--nstep", type=click.IntRange(min=1), help="Steps of each simulation."),
    click.option(
        "--hold",
        type=click.IntRange(min=1),
        default=1,
        show_default=True,
        help="Steps that each control is held.",
    ),
    click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True),
)


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
@click.option("--paths", "path_names", type=_Words(), help="Ways of stepping  [python_loop]")
@_FAIL_ON
@_with(*_JUDGING, *_SIZES, _RESULTS, _JSON)
def versions(
    words: tuple[str, ...],
    old: str | None,
    news: tuple[str, ...],
    path_names: list[str] | None,
    fail_on: list[str],
    **chosen: Any,
) -> None:
    """Is MODEL slower with a NEW release of MuJoCo than with the OLD one?

    \b
    A release is a version (3.5.0), a wheel or a folder of wheels, or `installed`. Each is
    installed alone in a cache folder (`mjbench releases installs`); several NEW ones may be given.
      mjbench versions 3.3.0 4.0.0 humanoid
      mjbench versions 3.17.0 4.0.0 robot.xml --fail-on slower,changed-work
      mjbench versions --old installed --new dist/mujoco-4.1.0-cp311-….whl cartpole

    Ratios are new time over old time: above 1 is slower. A verdict of a release that does other
    work says so beside it.
    """
    from mjbench import installs, models, paths, sides
    from mjbench.paired import Side

    named = [word for word in words if installs.is_release(word)]
    olds = [old] if old else named[:1]
    new_words = [*news, *(named if old else named[1:])]
    if not olds or not new_words:
        raise InputError("name an OLD and a NEW release, such as `mjbench versions 3.3.0 4.0.0`")
    given = [word for word in words if word not in named]
    sources = [models.resolve(name) for name in given or models.shipped()]
    ways = path_names or ["python_loop"]
    before, *after = [installs.wanted(word) for word in [*olds, *new_words]]
    options = {way: sides.complete(paths.find(way), {}) for way in ways}
    pairs = [
        (Side(before, source, way, options[way]), Side(release, source, way, options[way]))
        for release in after
        for source in sources
        for way in ways
    ]
    sys.exit(_decide("versions", pairs, fail_on, **chosen))


@cli.command()
@click.argument("old", metavar="SIDE")
@click.argument("new", metavar="SIDE")
@_FAIL_ON
@_with(*_JUDGING, *_SIZES, _RESULTS, _JSON)
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
    from mjbench import sides

    sys.exit(_decide("ab", [sides.parse(old, new)], fail_on, **chosen))


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
@_with(*_JUDGING, _RESULTS, _JSON)
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
    from mjbench import machine, models, verdict
    from mjbench import selfcheck as room
    from mjbench.fleet import Fleet
    from mjbench.report import tables, verdicts
    from mjbench.runs import RunFile

    try:
        sizes = [float(word.removesuffix("%")) / 100 for word in slowdowns.split(",")]
    except ValueError as error:
        raise InputError(f"--slowdowns {slowdowns}: {error}") from error
    uneven = [s for s in sizes if s < 0 or abs(s * room.NBATCH - round(s * room.NBATCH)) > 1e-9]
    if uneven:
        raise InputError(f"--slowdowns: {100 * uneven[0]:g} is no multiple of 0.5")
    sources = [models.resolve(name) for name in names or ("cartpole", "humanoid")]
    arms = [room.Arm(source, size) for source in sources for size in sizes]
    plan_keys = ("min_effect", "confidence", "precision")
    plan = verdict.Plan(**{k: chosen[k] for k in plan_keys}, time_limit_s=chosen["time_limit"])
    about: dict[str, Any] = machine.describe()
    found: list[dict[str, Any]] = []
    code = 0
    with _json_target(json_file) as write_json:
        arguments = {**plan.as_dict(), "trials": trials, "busy": busy}
        run_file = RunFile(results, "selfcheck", {"machine": about, "arguments": arguments})
        out = tables.console(stderr=json_file == "-")
        with _progress(out, trials * len(arms)) as advance:

            def on_trial(record: dict[str, Any]) -> None:
                run_file.append(record)
                found.append(record)
                advance(len(found), f"{record['model']} {100 * record['slowdown']:g} %", 0.0)

            with room.neighbour(busy), Fleet() as fleet:
                try:
                    room.run(fleet, arms, trials, plan, on_trial)
                except KeyboardInterrupt:
                    click.echo("mjbench: interrupted; what was measured is kept", err=True)
                    code = _INTERRUPTED
        run_file.close()
        rows = room.summary(found)
        out.print(verdicts.selfcheck_table(rows))
        write_json({"schema": 1, "machine": about, "busy": busy, "results": rows})
    out.print(f"\nRun file: {run_file.path}", soft_wrap=True)
    sys.exit(code)


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option(
    "--release",
    "words",
    multiple=True,
    metavar="RELEASE",
    help="May be given several times  [default: installed]",
)
@click.option("--top", type=click.IntRange(min=1), default=10, show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--time-limit", default="600s", show_default=True, callback=_seconds)
@_JSON
def instructions(
    names: tuple[str, ...],
    words: tuple[str, ...],
    top: int,
    seed: int,
    time_limit: float,
    json_file: str | None,
) -> None:
    """Count instructions per step, by function and stage, exact on any machine.

    Needs valgrind. Every release does the work that the first one named drew.
    """
    import tempfile

    from mjbench import installs, models
    from mjbench import instructions as room
    from mjbench.report import counts, tables

    sources = [models.resolve(name) for name in names or models.shipped()]
    releases = [installs.wanted(word) for word in words or (installs.HERE,)]
    out = tables.console(stderr=json_file == "-")
    found = []
    _interruptible()
    with _json_target(json_file) as write_json, tempfile.TemporaryDirectory() as kept:
        with _progress(out, len(releases)) as advance:
            for number, release in enumerate(releases):
                advance(number, f"MuJoCo {release.version}", 0.0)
                folder = Path(kept)
                found += room.count(
                    release, sources, time_limit, given=folder, keep=folder, seed=seed
                )
        counts.print_counts(out, found, top)
        write_json({"schema": 1, "results": [room.as_result(count) for count in found]})
    sys.exit(_count_code(found))


@cli.command()
@click.argument("words", nargs=-1, required=True, metavar="OLD NEW MODEL…")
@click.option("--top", type=click.IntRange(min=1), default=15, show_default=True)
@click.option("--clock/--no-clock", default=True, help="Compare wall-clock times too.")
@_with(*_JUDGING, *_SIZES, _JSON)
def explain(
    words: tuple[str, ...],
    top: int,
    clock: bool,
    json_file: str | None,
    **chosen: Any,
) -> None:
    """Tell what changed from the OLD release to the NEW one: code, work, or the clock alone.

    Needs valgrind. Instructions per step by function and by stage, sorted by what they contribute
    to the difference; beside them the work done and the paired wall-clock ratio.
    """
    import tempfile

    from mjbench import explain as derive
    from mjbench import installs, models, paired, verdict
    from mjbench import instructions as room
    from mjbench.fleet import Fleet
    from mjbench.report import counts, tables

    named = [word for word in words if installs.is_release(word)]
    if len(named) != 2:
        raise InputError("name an OLD and a NEW release, such as `mjbench explain 3.17.0 4.0.0`")
    releases = [installs.wanted(word) for word in named]
    given = [word for word in words if word not in named]
    sources = [models.resolve(name) for name in given or models.shipped()]
    plan = verdict.Plan(
        chosen["min_effect"],
        chosen["confidence"],
        chosen["precision"],
        chosen["time_limit"],
        paired.Sizes(chosen["nbatch"], chosen["nstep"], chosen["hold"], chosen["seed"]),
    )
    if chosen["nstep"] and chosen["nstep"] % chosen["hold"]:
        raise InputError(f"--nstep {chosen['nstep']} is not a multiple of --hold {chosen['hold']}")
    out = tables.console(stderr=json_file == "-")
    results: list[dict[str, Any]] = []
    found: list[Any] = []
    failed = False
    _interruptible()
    with _json_target(json_file) as write_json, tempfile.TemporaryDirectory() as kept:
        folder = Path(kept)
        found += [
            room.count(release, sources, given=folder, keep=folder, seed=chosen["seed"])
            for release in releases
        ]
        with Fleet() as fleet:
            for old, new, source in zip(*found, sources, strict=True):
                outcome = None
                if clock and old.status == new.status == "ok":
                    before, after = (paired.Side(release, source) for release in releases)
                    outcome = verdict.decide(fleet, before, after, plan)
                    if outcome.status == "interrupted":
                        raise KeyboardInterrupt
                    failed |= outcome.status != "ok"
                counts.print_explanation(out, old, new, outcome, top)
                results.append(derive.as_result(old, new, outcome))
        write_json({"schema": 1, "results": results})
    sys.exit(3 if failed else _count_code([count for counted in found for count in counted]))


def _count_code(found: Sequence[Any]) -> int:
    statuses = {count.status for count in found}
    return 3 if statuses & set(_FAILED) else 2 if "input" in statuses else 0


def _decide(
    command: str,
    pairs: Sequence[tuple[Any, Any]],
    fail_on: list[str],
    *,
    min_effect: float,
    confidence: float,
    precision: float,
    time_limit: float,
    nbatch: int | None,
    nstep: int | None,
    hold: int,
    seed: int,
    results: Path,
    json_file: str | None,
) -> int:
    from mjbench import machine, paired, verdict
    from mjbench.fleet import Fleet
    from mjbench.report import tables, verdicts
    from mjbench.runs import RunFile

    if nstep and nstep % hold:
        raise InputError(f"--nstep {nstep} is not a multiple of --hold {hold}")
    sizes = paired.Sizes(nbatch, nstep, hold, seed)
    plan = verdict.Plan(min_effect, confidence, precision, time_limit, sizes)
    about, found = machine.describe(), []
    with _json_target(json_file) as write_json:
        run_file = RunFile(results, command, {"machine": about, "arguments": plan.as_dict()})
        out = tables.console(stderr=json_file == "-")
        with _progress(out, len(pairs)) as advance, Fleet() as fleet:
            for number, (old, new) in enumerate(pairs):
                name = f"{new.model.name} {new.release.version}"
                shown = functools.partial(_show_launch, advance, number, name)
                outcome = verdict.decide(fleet, old, new, plan, shown)
                run_file.append(outcome.as_record())
                found.append(outcome.as_result())
                if outcome.status == "interrupted":
                    break
        run_file.close()
        verdicts.print_table(out, found)
        write_json({"schema": 1, "machine": about, "results": found})
    out.print(f"\nRun file: {run_file.path}", soft_wrap=True)
    return _verdict_code(found, fail_on)


def _show_launch(advance: Any, number: int, name: str, judged: Any) -> None:
    share = 1 - 1 / (1 + judged.launches / 15)
    advance(number, f"{name} {100 * (judged.ratio - 1):+.2f} %", share)


def _verdict_code(found: Sequence[dict[str, Any]], fail_on: Sequence[str]) -> int:
    statuses = {row["status"] for row in found}
    if "interrupted" in statuses:
        click.echo("mjbench: interrupted; what was measured is kept", err=True)
        return _INTERRUPTED
    if "failed" in statuses:
        return 3
    if "input" in statuses:
        return 2
    hits = {row["verdict"] for row in found}
    hits |= {"changed-work"} if any(row["changed_work"] for row in found) else set()
    return 1 if hits & set(fail_on) else 0


_HISTORY = click.option(
    "--history",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="The git bundle  [default: benchmarks/releases.bundle of the checkout]",
)


@cli.group(invoke_without_command=True)
@click.pass_context
def releases(ctx: click.Context) -> None:
    """Tell which MuJoCo releases exist; keep the history that asv walks."""
    if ctx.invoked_subcommand is None:
        ctx.invoke(list_releases)


@releases.command("list")
@_HISTORY
@_JSON
def list_releases(history: Path | None = None, json_file: str | None = None) -> None:
    """List releases: on the package index, in the history, installed here."""
    from mjbench import releases as room
    from mjbench.report import tables

    with _json_target(json_file) as write_json:
        rows, problem = room.listing(history or room.bundle_path())
        out = tables.console(stderr=json_file == "-")
        out.print(tables.releases_table(rows))
        if problem:
            click.echo(f"Shown is what is here: {problem}", err=True)
        write_json({"schema": 1, "releases": rows})


@releases.command("update")
@_HISTORY
def update_releases(history: Path | None) -> None:
    """Append to the history what the package index has beyond it."""
    from mjbench import releases as room

    bundle = history or room.bundle_path()
    appended = room.update(bundle, room.index())
    if appended:
        click.echo(f"appended {', '.join(r.tag for r in appended)} to {bundle}")
    else:
        click.echo(f"nothing to append: {bundle} ends with {room.read(bundle)[-1].tag}")


@releases.command("verify")
@_HISTORY
def verify_releases(history: Path | None) -> None:
    """Make the history again and compare every hash; exit 1 if one differs."""
    from mjbench import releases as room

    bundle = history or room.bundle_path()
    known, problem = None, ""
    try:
        known = room.index()
    except MachineError as error:
        problem = str(error)
    wrong = room.verify(bundle, known)
    for line in wrong:
        click.echo(line)
    if problem:
        click.echo(f"Upload times were not checked: {problem}", err=True)
    if wrong:
        sys.exit(1)
    count = len(room.read(bundle))
    click.echo(f"{bundle}: {count} releases, every hash as made again from them")


@releases.command("install")
@click.argument("names", nargs=-1, required=True, metavar="RELEASE…")
def install_releases(names: tuple[str, ...]) -> None:
    """Install releases, each alone in the cache folder, for `mjbench versions`."""
    from mjbench import installs

    for release in [installs.wanted(name) for name in names]:
        click.echo(installs.install(release))


@releases.command("installs")
def list_installs() -> None:
    """List the releases that are installed in the cache folder."""
    from mjbench import installs

    click.echo(f"In {installs.cache()}:")
    for name in installs.installed():
        click.echo(name)


@releases.command("remove")
@click.argument("names", nargs=-1, metavar="[NAME…]")
@click.option("--all", "every", is_flag=True, help="Remove every install.")
def remove_releases(names: tuple[str, ...], every: bool) -> None:
    """Remove installs from the cache folder, by their names there or by version."""
    from mjbench import installs

    there = installs.installed()
    if not names and not every:
        raise InputError("name what to remove (`mjbench releases installs`), or --all")
    for name in there if every else names:
        found = [k for k in there if k == name or k.startswith((f"{name}-", f"{name}+"))]
        for one in found or [name]:
            installs.remove(one)
            click.echo(f"removed {one}")


@cli.command()
@click.option(
    "--results",
    default="results/asv",
    show_default=True,
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Where asv keeps its results.",
)
@click.option("--machine", metavar="NAME", help="Whose results, where asv has several machines'.")
@click.option(
    "--threshold",
    default=5.0,
    show_default=True,
    type=click.FloatRange(min=0.1),
    metavar="PERCENT",
    help="The smallest change that is told.",
)
@click.option(
    "--causes",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Causes of steps, by hand  [default: benchmarks/causes.toml of the checkout]",
)
@click.option("-o", "--output", metavar="FILE", type=click.Path(path_type=Path))
@_HISTORY
def history(
    results: Path,
    machine: str | None,
    threshold: float,
    causes: Path | None,
    output: Path | None,
    history: Path | None,
) -> None:
    """Tell what the results of `asv run` show: every step between releases, with its cause.

    The page is Markdown, on the terminal or in the file that -o names; docs/history.md is
    written by this command.
    """
    from mjbench import history as room
    from mjbench import releases as known
    from mjbench.report import history as report

    bundle = history or known.bundle_path()
    measured = room.load(results, bundle, machine)
    told = report.causes(causes or bundle.with_name("causes.toml"))
    text = report.page(measured, told, threshold / 100)
    if output is None:
        click.echo(text, nl=False)
        return
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise MachineError(f"cannot write {output}: {error.strerror}") from error


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option("--code", is_flag=True, help="Print each habit's loop, and its cheaper form.")
@_LIMIT
@_JSON
def overhead(names: tuple[str, ...], code: bool, time_limit: float, json_file: str | None) -> None:
    """What does each habit of a Python loop cost beside mj_step, and what is cheaper?

    MODEL is cartpole unless named. Every habit is timed inside a stepping loop, in turns with the
    bare loop, in several processes.
    """
    from dataclasses import asdict

    from mjbench import habits, models
    from mjbench.report import habits as report
    from mjbench.report import tables

    sources = [models.resolve(name) for name in names or ("cartpole",)]
    out = tables.console(stderr=json_file == "-")
    found = []
    with _json_target(json_file) as write_json:
        for source in sources:
            table = habits.measure(source, time_limit)
            report.print_table(out, table, code)
            found.append(asdict(table))
        write_json({"schema": 1, "results": found})


@cli.command()
@click.option("--angles", metavar="RAD,…", help="Initial angles  [default: 0 to 0.4 by 0.05]")
@click.option("--samples", type=click.IntRange(min=1), default=1000, show_default=True)
@click.option("--threads", type=_Numbers(), default="1,4,16", show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@_JSON
def falls(
    angles: str | None, samples: int, threads: list[int], seed: int, json_file: str | None
) -> None:
    """How likely does the cart-pole fall, by initial angle? One question, asked by every path.

    The pole is left alone from random starts around each angle; it has fallen when it passes
    0.5 rad within a second. All paths must count the same falls; then their times are compared.
    """
    from mjbench import falls as room
    from mjbench import machine
    from mjbench.report import falls as report
    from mjbench.report import tables

    try:
        asked = tuple(float(word) for word in angles.split(",")) if angles else room.ANGLES
    except ValueError as error:
        raise InputError(f"--angles {angles}: {error}") from error
    out = tables.console(stderr=json_file == "-")
    with _json_target(json_file) as write_json:
        found = room.ask(asked, samples, threads, seed)
        report.print_falls(out, found, machine.usable_cores())
        write_json({"schema": 1, **room.as_result(found)})


@cli.command()
@click.argument("names", nargs=-1, required=True, metavar="FILE.py…")
@_JSON
def lint(names: tuple[str, ...], json_file: str | None) -> None:
    """Find in a script what makes a stepping loop slow or its log wrong; it is not executed.

    \b
    Findings are FILE:LINE:COLUMN CODE MESSAGE, with about what it costs in each step; exit 1 if
    there are any. A folder stands for all Python files below it. `# noqa: MJB001` at the end of a
    line excuses it.
    """
    from dataclasses import asdict

    from mjbench import lint as room

    found, broken = [], []
    with _json_target(json_file) as write_json:
        for file in room.files(names):
            try:
                found += room.check(file)
            except InputError as error:
                broken.append(str(error))
        for one in found:
            cost = f" (about {one.ns_per_step:.0f} ns per step)" if one.ns_per_step else ""
            where = f"{one.file}:{one.line}:{one.col}"
            click.echo(f"{where} {one.code} {one.message}{cost}", err=json_file == "-")
        write_json({"schema": 1, "findings": [asdict(one) for one in found]})
    for line in broken:
        click.echo(f"mjbench: {line}", err=True)
    sys.exit(2 if broken else int(bool(found)))


@contextlib.contextmanager
def _json_target(name: str | None) -> Iterator[Callable[[Any], None]]:
    """Yield a function that writes a document; the target is opened before the work begins."""
    if name is None:
        yield lambda document: None
        return
    if name == "-":
        yield lambda document: click.echo(json.dumps(document, indent=1))
        return
    with contextlib.ExitStack() as closing:
        try:
            stream = closing.enter_context(Path(name).open("w", encoding="utf-8"))
        except OSError as error:
            raise MachineError(f"cannot write {name}: {error.strerror}") from error
        yield lambda document: json.dump(document, stream, indent=1)


@contextlib.contextmanager
def _progress(out: Any, count: int) -> Iterator[Callable[[int, str, float], None]]:
    """Yield a function that moves a progress bar; there is none unless `out` is a terminal."""
    _interruptible()
    if not out.is_terminal:
        yield lambda number, name, share: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    # no refreshing thread: it would take time from the blocks being timed
    with Progress(*columns, console=out, auto_refresh=False, transient=True) as bar:
        task = bar.add_task("starting", total=count)

        def advance(number: int, name: str, share: float) -> None:
            bar.update(task, completed=number + share, description=name, refresh=True)

        yield advance


def _interruptible() -> None:
    """Have signals end the command by way of its cleaning up."""
    signal.signal(signal.SIGTERM, _interrupt)
    signal.signal(signal.SIGINT, _interrupt)


def _interrupt(signum: int, frame: Any) -> None:
    raise KeyboardInterrupt
