"""Which releases of MuJoCo there are: on the package index, in the history, installed here."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mjbench.errors import MachineError
from mjbench.releases import bundle, install_check, package_index
from mjbench.releases.release import version_key


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
    """The releases known here.

    Attributes:
      problem: why the package index is not among the sources; empty if it is.
    """

    releases: Sequence[ReleaseRow]
    problem: str


def list_releases(history: Path) -> Catalogue:
    """Return every release on the index, in the history, or installed here.

    A release that is installed but neither in the history nor on the index, such as a local
    build, comes last.

    Raises:
      MachineError: git is missing, or cannot read the history.
    """
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
