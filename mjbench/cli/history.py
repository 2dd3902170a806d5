"""Releases of MuJoCo, and what asv measured of them."""

import sys
from pathlib import Path

import click

from mjbench.cli.group import cli
from mjbench.cli.shared import JSON, interruptible, output
from mjbench.errors import InputError, MachineError

HISTORY = click.option(
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
@HISTORY
@JSON
def list_releases(history: Path | None = None, json_file: str | None = None) -> None:
    """List releases: on the package index, in the history, installed here."""
    from mjbench.releases import catalogue as room
    from mjbench.report import tables

    with output(json_file) as write_json:
        rows, problem = room.listing(history or room.bundle_path())
        out = tables.console(stderr=json_file == "-")
        out.print(tables.releases_table(rows))
        if problem:
            click.echo(f"Shown is what is here: {problem}", err=True)
        write_json({"schema": 1, "releases": rows})


@releases.command("update")
@HISTORY
def update_releases(history: Path | None) -> None:
    """Append to the history what the package index has beyond it."""
    from mjbench.releases import catalogue as room

    bundle = history or room.bundle_path()
    appended = room.update(bundle, room.index())
    if appended:
        click.echo(f"appended {', '.join(r.tag for r in appended)} to {bundle}")
    else:
        click.echo(f"nothing to append: {bundle} ends with {room.read(bundle)[-1].tag}")


@releases.command("verify")
@HISTORY
def verify_releases(history: Path | None) -> None:
    """Make the history again and compare every hash; exit 1 if one differs."""
    from mjbench.releases import catalogue as room

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
    from mjbench.releases import installs

    interruptible()
    for release in [installs.parse_release(name) for name in names]:
        click.echo(installs.install(release))


@releases.command("installs")
def list_installs() -> None:
    """List the releases that are installed in the cache folder."""
    from mjbench.releases import installs

    click.echo(f"In {installs.cache()}:")
    for name in installs.installed():
        click.echo(name)


@releases.command("remove")
@click.argument("names", nargs=-1, metavar="[NAME…]")
@click.option("--all", "every", is_flag=True, help="Remove every install.")
def remove_releases(names: tuple[str, ...], every: bool) -> None:
    """Remove installs from the cache folder, by their names there or by version."""
    from mjbench.releases import installs

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
@HISTORY
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
    from mjbench.releases import catalogue as known
    from mjbench.releases import history as room
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
