"""Which releases of MuJoCo there are: on the package index, in the cache, installed here."""

from collections.abc import Sequence
from dataclasses import dataclass

from packaging.version import Version

from mjbench.errors import InputError, MachineError
from mjbench.releases import install_check, installs, package_index
from mjbench.releases.release import version_key
from mjbench.releases.release_names import ReleaseSpec


@dataclass(frozen=True)
class ReleaseRow:
    """A release, and where it is.

    Attributes:
      version: such as `3.5.0`.
      uploaded: when its first file was uploaded (ISO 8601, UTC); None when unknown.
      in_index: whether the package index has it; None when the index did not answer.
      in_cache: whether the cache folder has an install of it.
      installed: whether it is the release of this environment.
    """

    version: str
    uploaded: str | None
    in_index: bool | None
    in_cache: bool
    installed: bool


@dataclass(frozen=True)
class Catalogue:
    """The releases known here; `problem` says why the package index is not among the sources."""

    releases: Sequence[ReleaseRow]
    problem: str


def list_releases() -> Catalogue:
    """Return every release on the index, then those that are only in the cache or installed."""
    uploads: dict[str, str | None] = {}
    problem = ""
    try:
        uploads |= {r.version: r.uploaded.isoformat() for r in package_index.releases()}
    except MachineError as error:
        problem = str(error)
    indexed, installed = set(uploads), install_check.installed_version()
    cached = {name.partition("-")[0] for name in installs.install_names()}
    others = cached | ({installed} if installed else set())
    uploads |= dict.fromkeys(sorted(others - indexed, key=version_key))
    rows = [
        ReleaseRow(
            version=version,
            uploaded=uploaded,
            in_index=None if problem else version in indexed,
            in_cache=version in cached,
            installed=version == installed,
        )
        for version, uploaded in uploads.items()
    ]
    return Catalogue(rows, problem)


@dataclass(frozen=True)
class ReleaseRange:
    """Releases in the order of their versions: both ends, and the final releases between them."""

    specs: Sequence[ReleaseSpec]
    index_problem: str = ""

    @property
    def notes(self) -> list[str]:
        problem = self.index_problem
        return [f"only releases that are installed here take part: {problem}"] if problem else []


def releases_between(baseline: ReleaseSpec, candidate: ReleaseSpec) -> ReleaseRange:
    """Return the releases from one to another; InputError if the candidate is not newer."""
    old, new = (Version(release.version) for release in (baseline, candidate))
    if old > new or baseline.key == candidate.key:
        raise InputError(
            f"MuJoCo {candidate.version} does not come after {baseline.version}:"
            " name the older release first"
        )
    known = list_releases()
    # without the index, those that were installed from it
    published = (
        row.version
        for row in known.releases
        if row.uploaded is not None or (known.problem and row.version.replace(".", "").isdigit())
    )
    low, high = version_key(baseline.version), version_key(candidate.version)
    between = sorted((v for v in published if low < version_key(v) < high), key=version_key)
    specs = [baseline, *(ReleaseSpec(version, version) for version in between), candidate]
    return ReleaseRange(specs, known.problem)
