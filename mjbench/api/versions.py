"""`mjbench.versions`: is a model slower with a new release of MuJoCo than with an old one?"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjbench.api import model_sources
from mjbench.api.functions import with_options
from mjbench.api.result import Result
from mjbench.commands.versions import family
from mjbench.commands.versions.driver import between_releases
from mjbench.commands.versions.family import Family
from mjbench.commands.versions.options import VersionsOptions
from mjbench.errors import InputError
from mjbench.measuring.timing import Progress
from mjbench.paired.records import VerdictRecord, VerdictRow
from mjbench.releases import installs
from mjbench.simulation.models import check_any

if TYPE_CHECKING:
    import os


@dataclass(frozen=True, repr=False, eq=False)
class ReleaseComparison(Result):
    """Verdicts on models in an old and in new releases of MuJoCo."""

    @property
    def verdicts(self) -> tuple[VerdictRow, ...]:
        return tuple(record.row() for record in self.run.of_type(VerdictRecord))

    @property
    def confidence(self) -> float:
        return family.confidence_of(self.run.header)

    @property
    def family(self) -> Family:
        """Which are slower, faster or undecided when one allows for their number."""
        return family.adjust_for_family(self.verdicts, self.confidence)


@with_options(VersionsOptions)
def versions(
    old: str,
    *news: str,
    models: "str | os.PathLike[str] | Iterable[str | os.PathLike[str]]" = (),
    options: VersionsOptions,
    on_progress: Progress | None = None,
) -> ReleaseComparison:
    """Compare models in an old release of MuJoCo and in new ones: are they slower?

    The same as `mjbench versions`. Each release is installed in a folder of its own in the cache.
    Ratios are new over old: above 1 is slower. A model that fails loses only its own verdict,
    unless all fail.

    Args:
      old: a version (`3.5.0`), a wheel, a folder of wheels, `installed`, `newest` or `previous`; or
        packages, with commas, such as `jax==0.7.0,jaxlib==0.7.0`.
      *news: the same, one or several.
      models: names as on the command line, or paths. A compiled model cannot be compared: other
        releases cannot load it.
      on_progress: called with what is measured now, and the share of all work that is done.

    Raises:
      InputError: there is no such release, model or path, an argument is out of its range, or no
        model can be compared.
      MachineError: a package or a release is missing, or processes failed for every model.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """
    if not news:
        raise InputError('name an old and a new release, such as versions("3.3.0", "4.0.0")')
    specs = installs.parse_available(map(str, (old, *news)))
    check_any(names := _several(models))
    sources = model_sources.each_once(map(model_sources.named, names))
    measurement = between_releases(specs, sources, options.paths, options.plan)
    return ReleaseComparison.of(measurement, options.wait, on_progress)


def _several(
    models: "str | os.PathLike[str] | Iterable[str | os.PathLike[str]]",
) -> "Sequence[str | os.PathLike[str]]":
    if isinstance(models, str) or not isinstance(models, Iterable):
        return [models]
    return list(models)
