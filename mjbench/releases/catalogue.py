"""Which releases of MuJoCo there are: on the package index, in the history, installed here."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from packaging.version import Version

from mjbench.errors import InputError, MachineError
from mjbench.releases import bundle, install_check, package_index
from mjbench.releases.release import version_key
from mjbench.releases.release_names import ReleaseSpec


@dataclass(frozen=True)
class ReleaseRow:
    """A release, and where it is.

    Attributes:
      version: such as `3.5.0`.
      uploaded: when its first file was uploaded (ISO 8601, UTC); None when unknown.
      tag: its tag in the history, such as `v3.5.0`.
      in_history: whether the history that asv walks has it.
      in_index: whether the package index has it; None when the index did not answer.
      installed: whether it is the release of this environment.
    """

    version: str
    uploaded: str | None
    tag: str
    in_history: bool
    in_index: bool | None
    installed: bool


@dataclass(frozen=True)
class Catalogue:
    """The releases known here; `problem` says why the package index is not among the sources."""

    releases: Sequence[ReleaseRow]
    problem: str


def list_releases(history: Path) -> Catalogue:
    """Return every release on the index, in the history, or, at the end, only installed here."""
    recorded = {r.version: r for r in (bundle.read(history) if history.exists() else ())}
    indexed, problem = {}, ""
    try:
        indexed = {r.version: r for r in package_index.releases()}
    except MachineError as error:
        problem = str(error)
    installed = install_check.installed_version()
    known = sorted(
        {**recorded, **indexed}.values(), key=lambda r: (r.uploaded, version_key(r.version))
    )
    uploads: dict[str, str | None] = {r.version: r.uploaded.isoformat() for r in known}
    if installed:
        uploads.setdefault(installed, None)
    rows = [
        ReleaseRow(
            version=version,
            uploaded=uploaded,
            tag=f"v{version}",
            in_history=version in recorded,
            in_index=None if problem else version in indexed,
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


def releases_between(baseline: ReleaseSpec, candidate: ReleaseSpec, history: Path) -> ReleaseRange:
    """Return the releases from one to another; InputError if the candidate is not newer."""
    old, new = (Version(release.version) for release in (baseline, candidate))
    if old > new or baseline.key == candidate.key:
        raise InputError(
            f"MuJoCo {candidate.version} does not come after {baseline.version}:"
            " name the older release first"
        )
    known = list_releases(history)
    published = (row.version for row in known.releases if row.uploaded is not None)
    low, high = version_key(baseline.version), version_key(candidate.version)
    between = sorted((v for v in published if low < version_key(v) < high), key=version_key)
    specs = [baseline, *(ReleaseSpec(version, version) for version in between), candidate]
    return ReleaseRange(specs, known.problem)
