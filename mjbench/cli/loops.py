"""The Python loop: overhead, profile, falls, lint."""

import contextlib
import sys
from collections.abc import Iterator
from typing import Any

import click

from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, LIMIT, Numbers, exit_code, output
from mjbench.errors import InputError, MjbenchError


@cli.command()
@click.argument("names", nargs=-1, metavar="[MODEL]…")
@click.option("--code", is_flag=True, help="Print each habit's loop, and its cheaper form.")
@LIMIT
@JSON
def overhead(names: tuple[str, ...], code: bool, time_limit: float, json_file: str | None) -> None:
    """What does each habit of a Python loop cost beside mj_step, and what is cheaper?

    MODEL is cartpole unless named. Every habit is timed inside a stepping loop, in turns with the
    bare loop, in several processes.
    """
    from dataclasses import asdict

    from mjbench.instrument import machine
    from mjbench.loop import overhead
    from mjbench.report import habits as report
    from mjbench.report import tables
    from mjbench.simulation import models

    sources = [models.resolve(name) for name in names or ("cartpole",)]
    out = tables.console(stderr=json_file == "-")
    found: list[dict[str, Any]] = []
    with output(json_file) as write_json:
        for source in sources:
            with _costs_its_row(source.name, found):
                table = overhead.measure(source, time_limit)
                report.print_table(out, table, code)
                found.append({"status": "ok", "detail": "", **asdict(table)})
        write_json({"schema": 1, "machine": machine.describe(), "results": found})
    sys.exit(exit_code(row["status"] for row in found))


@cli.command()
@click.argument("names", nargs=-1, required=True, metavar="MODEL…")
@LIMIT
@JSON
def profile(names: tuple[str, ...], time_limit: float, json_file: str | None) -> None:
    """Where does a step's time go: engine stages, Python around it, rendering?

    Stages are MuJoCo's own timers. Rendering is tried by EGL and OSMesa.
    """
    from mjbench.instrument import machine
    from mjbench.loop import profile as room
    from mjbench.report import profile as report
    from mjbench.report import tables
    from mjbench.simulation import models

    sources = [models.resolve(name) for name in names]
    out = tables.console(stderr=json_file == "-")
    found: list[dict[str, Any]] = []
    with output(json_file) as write_json:
        for source in sources:
            with _costs_its_row(source.name, found):
                one = room.measure(source, time_limit)
                report.print_profile(out, one)
                found.append({"status": "ok", "detail": "", **report.as_result(one)})
        write_json({"schema": 1, "machine": machine.describe(), "results": found})
    sys.exit(exit_code(row["status"] for row in found))


@contextlib.contextmanager
def _costs_its_row(model: str, found: list[dict[str, Any]]) -> Iterator[None]:
    """Tell a model's failure in a line and a row; the other models go on."""
    try:
        yield
    except MjbenchError as error:
        detail = str(error).removeprefix(f"{model}: ")
        click.echo(f"mjbench: {model}: {detail}", err=True)
        status = "input" if error.exit_code == 2 else "failed"
        found.append({"model": model, "status": status, "detail": detail})


@cli.command()
@click.option("--angles", metavar="RAD,…", help="Initial angles  [default: 0 to 0.4 by 0.05]")
@click.option("--samples", type=click.IntRange(min=1), default=1000, show_default=True)
@click.option("--threads", type=Numbers(), default="1,4,16", show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@JSON
def falls(
    angles: str | None, samples: int, threads: list[int], seed: int, json_file: str | None
) -> None:
    """How likely does the cart-pole fall, by initial angle? One question, asked by every path.

    The pole is left alone from random starts around each angle; it has fallen when it passes
    0.5 rad within a second. All paths must count the same falls; then their times are compared.
    """
    from mjbench.instrument import machine
    from mjbench.loop import pole_example as room
    from mjbench.report import falls as report
    from mjbench.report import tables

    try:
        asked = tuple(float(word) for word in angles.split(",")) if angles else room.ANGLES
    except ValueError as error:
        raise InputError(f"--angles {angles}: {error}") from error
    out = tables.console(stderr=json_file == "-")
    with output(json_file) as write_json:
        found = room.ask(asked, samples, threads, seed)
        report.print_falls(out, found, machine.usable_cores())
        write_json({"schema": 1, **room.as_result(found)})


@cli.command()
@click.argument("names", nargs=-1, required=True, metavar="FILE.py…")
@JSON
def lint(names: tuple[str, ...], json_file: str | None) -> None:
    """Find in a script what makes a stepping loop slow or its log wrong; it is not executed.

    \b
    Findings are FILE:LINE:COLUMN CODE MESSAGE, with about what it costs in each step; exit 1 if
    there are any. A folder stands for all Python files below it. `# noqa: MJB001` at the end of a
    line excuses it.
    """
    from dataclasses import asdict

    from mjbench.loop import lint as room

    found, broken = [], []
    with output(json_file) as write_json:
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
