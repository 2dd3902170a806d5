"""The releases of MuJoCo on the package index that pip installs from."""

import base64
import bisect
import contextlib
import re
import subprocess
import sys
import urllib.parse
import urllib.request
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from http.client import HTTPException
from pathlib import Path
from typing import Any

from packaging.version import InvalidVersion, Version

from mjbench.errors import MachineError, one_line
from mjbench.releases.release import OLDEST, Release, version_key
from mjbench.releases.wheels import wheel_of

# The history begins one release before the first supported one, 2.3.7: a search such as
# `asv find v2.3.6..v4.0.0` takes the first commit of its range as the good one.
FIRST = (2, 3, 6)
# How long the index may take to answer.
_TIMEOUT_S = 30.0
# How many other versions an error names.
_NEAREST = 4


@dataclass(frozen=True)
class Upload:
    """A file of a release, as the index's JSON describes it (other keys are ignored).

    Some indexes leave out what they do not know, or have null in its place.
    """

    upload_time_iso_8601: datetime | None = None
    filename: str | None = None
    yanked: bool | None = None


@dataclass(frozen=True)
class _Answer:
    releases: Mapping[str, Sequence[Mapping[str, Any]]]


def releases() -> list[Release]:
    return _final_releases(_uploads())


def files() -> dict[str, list[str]]:
    return _files(_uploads())


def missing(versions: Iterable[str]) -> dict[str, str]:
    """Return the versions that are not there for this Python; a line for each names those near it.

    Raises:
      MachineError: the index cannot be read.
    """
    files_of = files()
    available = sorted(
        Version(version)
        for version, names in files_of.items()
        if any(wheel is not None and wheel.fits for wheel in map(wheel_of, map(Path, names)))
    )
    reasons = {}
    for version in versions:
        if Version(version) not in available:
            on_index = Version(version) in map(Version, files_of)
            where = "for this Python" if on_index else "on the package index"
            nearest = _nearest(version, available)
            reasons[version] = f"there is no MuJoCo {version} {where}{nearest}"
    return reasons


def _nearest(version: str, available: Sequence[Version]) -> str:
    final = [v for v in available if not v.is_prerelease and version_key(str(v)) >= OLDEST]
    if not final:
        return ""
    position = bisect.bisect(final, Version(version)) - _NEAREST // 2
    first = max(0, min(position, len(final) - _NEAREST))
    return f"; the nearest are {', '.join(map(str, final[first : first + _NEAREST]))}"


def _uploads() -> Mapping[str, Sequence[Upload]]:
    """Return the files of each version that the index has, without those that make no sense."""
    import msgspec  # late: asv's environments lack it

    def understood(described: Sequence[Mapping[str, Any]]) -> Iterator[Upload]:
        for each in described:
            with contextlib.suppress(msgspec.ValidationError):
                yield msgspec.convert(each, Upload)

    try:
        with urllib.request.urlopen(_request(_index_url()), timeout=_TIMEOUT_S) as answer:
            described = msgspec.json.decode(answer.read(), type=_Answer).releases
        return {version: list(understood(uploads)) for version, uploads in described.items()}
    except (OSError, ValueError, HTTPException) as error:
        reason = re.sub(r"//[^/@\s]*@", "//", one_line(error))  # without credentials
        raise MachineError(
            f"cannot read the releases of mujoco from the package index: {reason}"
        ) from error


def _files(uploads_of: Mapping[str, Sequence[Upload]]) -> dict[str, list[str]]:
    return {
        version: [upload.filename for upload in uploads if upload.filename]
        for version, uploads in uploads_of.items()
        if _parsed(version) is not None
    }


def _final_releases(uploads_of: Mapping[str, Sequence[Upload]]) -> list[Release]:
    """Return the final releases with times, in upload order, from FIRST on, unless yanked."""
    final = []
    for version, uploads in uploads_of.items():
        times = [
            upload.upload_time_iso_8601
            for upload in uploads
            if upload.upload_time_iso_8601 is not None and not upload.yanked
        ]
        parsed = _parsed(version)
        is_final = parsed is not None and not parsed.is_prerelease
        if times and is_final and version_key(version) >= FIRST:
            final.append(Release(version, min(times).astimezone(UTC).replace(microsecond=0)))
    return sorted(final, key=lambda r: (r.uploaded, version_key(r.version)))


def _parsed(version: str) -> Version | None:
    try:
        return Version(version)
    except InvalidVersion:
        return None


def _request(url: str) -> urllib.request.Request:
    """Return the request of an address; credentials in the address become a header."""
    parts = urllib.parse.urlsplit(url)
    credentials, at_sign, host = parts.netloc.rpartition("@")
    request = urllib.request.Request(urllib.parse.urlunsplit(parts._replace(netloc=host)))
    if at_sign:
        token = base64.b64encode(urllib.parse.unquote(credentials).encode()).decode()
        request.add_header("Authorization", f"Basic {token}")
    return request


def _index_url() -> str:
    # pip lists its settings in rising precedence: the last index-url is the one it uses.
    settings = _run_python("-m", "pip", "--disable-pip-version-check", "config", "list")
    configured = re.findall(r"^[\w:.]*\.index-url='([^']+)'", settings, flags=re.MULTILINE)
    if configured:
        root = re.sub(r"/simple/?$", "", configured[-1]).rstrip("/")
        return f"{root}/pypi/mujoco/json"
    # Nothing is configured: ask pip for the address of its default index.
    default = "from pip._internal.models.index import PyPI; print(PyPI.pypi_url)"
    return f"{_run_python('-c', default).strip()}/mujoco/json"


def _run_python(*arguments: str) -> str:
    done = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise MachineError(f"cannot run pip in this environment: {one_line(done.stderr)}")
    return done.stdout
