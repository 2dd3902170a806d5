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
    from mjbench import runs
    from mjbench.report import results as derive
    from mjbench.report import tables

    header, *records = runs.load(file or runs.latest(results))
    out = tables.console(stderr=json_file == "-")
    found: list[dict[str, Any]] = []
    with _json_target(json_file) as write_json:
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
    signal.signal(signal.SIGTERM, _interrupt)
    signal.signal(signal.SIGINT, _interrupt)
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


def _interrupt(signum: int, frame: Any) -> None:
    raise KeyboardInterrupt
