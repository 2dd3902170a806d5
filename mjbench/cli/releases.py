"""`mjbench releases`: which releases of MuJoCo there are, and installs of them."""

import click

from mjbench.api import interrupts
from mjbench.cli.context import RunContext
from mjbench.cli.group import cli
from mjbench.cli.shared import Text, takes
from mjbench.commands.shared_options import JsonOptions
from mjbench.errors import InputError
from mjbench.limits import DAYS
from mjbench.options import count


@cli.group(invoke_without_command=True, subcommand_metavar="[COMMAND] [ARGS]…")
@click.pass_context
def releases(ctx: click.Context) -> None:
    """List MuJoCo releases, and install them side by side.

    Without a subcommand, list the releases.
    """
    if ctx.invoked_subcommand is None:
        ctx.invoke(list_releases)


@releases.command("list", short_help="list the releases there are")
@takes(JsonOptions)
def list_releases(options: JsonOptions) -> None:
    """List releases: on the package index, in the cache folder, installed here."""
    from mjbench.commands.show.available import releases_table
    from mjbench.releases import catalogue
    from mjbench.results.json_form import ResultsDocument

    with RunContext(options) as run:
        known = catalogue.list_releases()
        run.table(releases_table(known.releases))
        if known.problem:
            click.echo(f"The list lacks the package index: {known.problem}", err=True)
        run.write_json(ResultsDocument(results=known.releases))


@releases.command("install", short_help="install releases in the cache")
@click.argument("names", nargs=-1, required=True, metavar="RELEASE…")
def install_releases(names: tuple[str, ...]) -> None:
    """Install releases, each alone, in the cache folder, for `mjbench versions`.

    RELEASE is a version such as 3.5.0, a wheel of mujoco, or a folder with its wheels.

    \b
    Example:
      mjbench releases install 3.17.0 4.0.0
    """
    from mjbench.releases import installs

    interrupts.enable()
    for release in installs.parse_available(names):
        click.echo(installs.install(release))


@releases.command("installs", short_help="list what is installed in the cache")
@takes(JsonOptions)
def list_installs(options: JsonOptions) -> None:
    """List the installs in the cache folder, with their size and when they were last used."""
    from mjbench.commands.show.available import InstallsDocument, install_lines
    from mjbench.releases import installs

    with RunContext(options) as run:
        folder, sizes = installs.cache_folder(), installs.install_sizes()
        run.out.print("\n".join([f"In {folder}:", *install_lines(sizes)]), soft_wrap=True)
        run.write_json(InstallsDocument(folder=str(folder), installs=sizes))


@releases.command("prune", short_help="remove installs not used for some time")
@click.option(
    "--days",
    type=Text(count(DAYS)),
    default=30,
    show_default=True,
    help="Keep what was used within so many days.",
)
def prune_installs(days: int) -> None:
    """Remove installs from the cache folder that were not used for some time.

    They are installed again when they are needed. The folder is MJBENCH_CACHE, or `mjbench` in
    the user's cache folder.

    \b
    Example:
      mjbench releases prune --days 7
    """
    from mjbench.formats import mebibytes
    from mjbench.releases import installs

    freed_bytes = 0
    for install, problem in installs.prune(days):
        if problem:
            click.echo(f"kept {install.name}: {problem}", err=True)
        else:
            freed_bytes += install.size_bytes
            click.echo(f"removed {install.name}")
    click.echo(f"freed {mebibytes(freed_bytes)}")


@releases.command("remove", short_help="remove installs")
@click.argument("names", nargs=-1, metavar="[NAME…]")
@click.option("--all", "all_installs", is_flag=True, help="Remove every install.")
def remove_releases(names: tuple[str, ...], all_installs: bool) -> None:
    """Remove installs from the cache folder.

    NAME is an install's name (`mjbench releases installs`) or a version, which stands for all
    installs of it.

    \b
    Example:
      mjbench releases remove 3.17.0
    """
    from mjbench.releases import installs

    if not names and not all_installs:
        raise InputError("name what to remove (`mjbench releases installs`), or use --all")
    matching = [install for name in names for install in installs.matching(name)]
    for name in installs.install_names() if all_installs else matching:
        installs.remove(name)
        click.echo(f"removed {name}")
