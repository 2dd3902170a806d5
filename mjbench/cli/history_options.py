"""What the subcommands of `mjbench history` share: which releases, which models, which folder."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mjbench.errors import InputError

if TYPE_CHECKING:
    from mjbench.paired.operations import Operation
    from mjbench.releases.installs import ReleaseSpec
    from mjbench.simulation.models import ModelSource

STEPS = click.option(
    "--steps/--no-steps", default=True, show_default=True, help="Include steps of models."
)
OPERATIONS = click.option(
    "--operations/--no-operations",
    default=None,
    help="Include loading, MjSpec, MjData, resets, rays, rollout and Batch on shipped models"
    "  [default: unless --model is given]",
)
SELECTING = (
    click.option(
        "--since",
        metavar="VERSION",
        help="Without a RELEASE: those of the git history from VERSION on, rather than all.",
    ),
    click.option(
        "--model",
        "models",
        multiple=True,
        metavar="MODEL",
        help="A model; may be given several times  [default: all shipped models]",
    ),
    click.option(
        "--results",
        default="results/history",
        show_default=True,
        metavar="DIR",
        type=click.Path(path_type=Path),
        help="Folder for the run file.",
    ),
)


@dataclass(frozen=True)
class Selection:
    """What a subcommand works on.

    Attributes:
      reference: release that others are compared with.
      releases: in the order of the command line, or of the history.
      sources: models whose steps are included.
      operations: operations around the step; their inputs are fixed.
    """

    reference: "ReleaseSpec"
    releases: Sequence["ReleaseSpec"]
    sources: Sequence["ModelSource"]
    operations: Sequence["Operation"]

    def arguments(self) -> dict[str, object]:
        """Return what a run file's header says of it."""
        return {
            "reference": self.reference.key,
            "releases": [release.key for release in self.releases],
            "models": [source.name for source in self.sources],
            "operations": bool(self.operations),
        }


def select(
    names: Sequence[str],
    since: str | None,
    models: Sequence[str],
    history: Path | None,
    steps: bool,
    operations: bool | None,
) -> Selection:
    """Return what the options and arguments of a subcommand select; see `_releases`."""
    from mjbench.paired.operations import registry
    from mjbench.releases import installs, release_ratios
    from mjbench.simulation import models as model_sources

    if not steps and models:
        raise click.UsageError("--model is for steps; leave it out with --no-steps")
    if not steps and operations is False:
        raise click.UsageError("without steps and operations, nothing is left")
    model_names = (models or model_sources.shipped()) if steps else ()
    has_operations = not models if operations is None else operations
    return Selection(
        installs.parse_release(release_ratios.REFERENCE),
        _releases(names, since, history),
        [model_sources.resolve(name) for name in model_names],
        list(registry().values()) if has_operations else [],
    )


def _releases(names: Sequence[str], since: str | None, history: Path | None) -> list["ReleaseSpec"]:
    """Return the releases that arguments name, or those of the git history.

    Args:
      since: first release of the history to return; None for all.
      history: a git bundle; None for the checkout's.
    """
    from mjbench.releases import bundle, installs
    from mjbench.releases.release import OLDEST, version_key

    if names and since:
        raise InputError("give RELEASEs or --since, not both")
    if names:
        return [installs.parse_release(name) for name in names]
    path = history or bundle.default_path()
    versions = [
        release.version
        for release in bundle.read(path)
        if version_key(release.version) >= OLDEST  # the history begins one release earlier, for asv
    ]
    if since is not None and since not in versions:
        raise InputError(
            f"{path} has no release {since}; it has {len(versions)},"
            f" from {versions[0]} to {versions[-1]}"
        )
    first = versions.index(since) if since else 0
    return [installs.parse_release(version) for version in versions[first:]]
