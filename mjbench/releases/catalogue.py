"""The releases of MuJoCo: which exist, and the history of them that asv walks.

asv walks commits, so the history is a git repository with one commit for every release, in the
order they were uploaded: a tree that holds nothing but `requirements.txt`, and a tag such as
v3.5.0. Author, dates and messages follow from the release alone, so the hashes, by which results
are kept, are the same wherever it is made. Releases are only ever appended. It is kept as a git
bundle, a repository in one file.
"""

import contextlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from mjbench.errors import InputError, MachineError, one_line
from mjbench.releases import install_check

# The history begins one release before the first supported one, 2.3.7: a search such as
# `asv find v2.3.6..v4.0.0` takes the first commit of its range as the good one.
FIRST = (2, 3, 6)
BRANCH = "releases"
# What a commit says of its maker; fixed, because it is part of the hash.
AUTHOR = "MuJoCo releases <releases@mjbench.invalid>"
# Seconds that an index may take to answer.
PATIENCE_S = 30.0


@dataclass(frozen=True)
class Release:
    """A release of MuJoCo.

    Attributes:
      version: such as `3.5.0`.
      uploaded: when its first file was uploaded, in whole seconds, UTC.
    """

    version: str
    uploaded: datetime

    @property
    def tag(self) -> str:
        """Return its tag in the history, such as `v3.5.0`."""
        return f"v{self.version}"


def key(version: str) -> tuple[int, ...]:
    """Return numbers by which versions sort, such as (3, 2, 0) of `3.2.0` and of `3.2.0.post1`."""
    return tuple(int(n) for n in re.findall(r"\d+", version)[:3])


def bundle_path() -> Path:
    """Return where a checkout keeps the history."""
    return Path(__file__).resolve().parents[2] / "benchmarks" / "releases.bundle"


# -- what exists ------------------------------------------------------------------------------


def index() -> list[Release]:
    """Return the final releases that pip's package index has, in upload order.

    Raises:
      MachineError: the index cannot be reached, or does not tell upload times.
    """
    import http.client
    import urllib.request  # late: every benchmark process imports this module

    try:
        with urllib.request.urlopen(_request(_index_url()), timeout=PATIENCE_S) as answer:
            files = json.load(answer)["releases"]
        return _released(files)
    except (OSError, ValueError, KeyError, TypeError, http.client.HTTPException) as error:
        told = re.sub(r"//[^/@\s]*@", "//", one_line(error))  # no credentials
        raise MachineError(
            f"the package index does not tell the releases of mujoco: {told}"
        ) from error


def _released(files: dict[str, list[dict[str, Any]]]) -> list[Release]:
    """Return the releases among an index's files by version; pre-releases and yanked ones not."""
    found = []
    for version, uploads in files.items():
        times = [
            datetime.fromisoformat(upload["upload_time_iso_8601"])
            for upload in uploads
            if not upload.get("yanked")
        ]
        if times and re.fullmatch(r"[\d.]+(\.post\d+)?", version) and key(version) >= FIRST:
            found.append(Release(version, min(times).astimezone(UTC).replace(microsecond=0)))
    return sorted(found, key=lambda r: (r.uploaded, key(r.version)))


def _request(url: str) -> Any:
    """Return the request of an address; credentials in it become a header."""
    import base64
    import urllib.parse
    import urllib.request

    parts = urllib.parse.urlsplit(url)
    login, at, host = parts.netloc.rpartition("@")
    request = urllib.request.Request(urllib.parse.urlunsplit(parts._replace(netloc=host)))
    if at:
        token = base64.b64encode(urllib.parse.unquote(login).encode()).decode()
        request.add_header("Authorization", f"Basic {token}")
    return request


def _index_url() -> str:
    """Return the address of mujoco's description on the index that pip installs from."""
    known = _pip("config", "list")
    places = re.findall(r"^[\w:.]*\.index-url='([^']+)'", known, flags=re.MULTILINE)
    if places:
        root = re.sub(r"/simple/?$", "", places[-1]).rstrip("/")
        return f"{root}/pypi/mujoco/json"
    default = "from pip._internal.models.index import PyPI; print(PyPI.pypi_url)"
    return f"{_python('-c', default).strip()}/mujoco/json"


def _pip(*words: str) -> str:
    return _python("-m", "pip", "--disable-pip-version-check", *words)


def _python(*words: str) -> str:
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise MachineError(f"pip does not answer in this environment: {one_line(done.stderr)}")
    return done.stdout


def listing(bundle: Path) -> tuple[list[dict[str, Any]], str]:
    """Return a row for every release known here, and why the index is not among the sources.

    Each row has version, uploaded (ISO 8601, UTC), tag, in_history, in_index (None when the
    index does not answer) and installed. A release installed here that neither knows, such as
    one built locally, has a row too; its uploaded is None.
    """
    history = {r.version: r for r in (read(bundle) if bundle.exists() else ())}
    problem = ""
    try:
        indexed: dict[str, Release] | None = {r.version: r for r in index()}
    except MachineError as error:
        indexed, problem = None, str(error)
    known = sorted(
        {**history, **(indexed or {})}.values(), key=lambda r: (r.uploaded, key(r.version))
    )
    here = install_check.installed()
    rows: list[dict[str, Any]] = [
        {
            "version": release.version,
            "uploaded": release.uploaded.isoformat(),
            "tag": release.tag,
            "in_history": release.version in history,
            "in_index": None if indexed is None else release.version in indexed,
            "installed": release.version == here,
        }
        for release in known
    ]
    if here and not any(row["installed"] for row in rows):
        unknown: dict[str, Any] = {"uploaded": None, "tag": f"v{here}", "in_history": False}
        unknown["in_index"] = None if indexed is None else False
        rows.append({"version": here, **unknown, "installed": True})
    return rows, problem


# -- the history ------------------------------------------------------------------------------


def read(bundle: Path) -> list[Release]:
    """Return the releases of a history, in its order.

    Raises:
      InputError: not a history.
      MachineError: git is missing or fails.
    """
    with _opened(bundle) as repository:
        log = _git(repository, "log", "--first-parent", "--reverse", "--format=%ct %s", BRANCH)
    found = []
    for line in log.splitlines():
        seconds, _, message = line.partition(" ")
        version = message.removeprefix("MuJoCo ")
        found.append(Release(version, datetime.fromtimestamp(int(seconds), UTC)))
    return found


def hashes(bundle: Path) -> dict[str, str]:
    """Return the commit hash of every branch and tag of a history, by name."""
    with _opened(bundle) as repository:
        return _refs(repository)


def write(bundle: Path, releases: Sequence[Release]) -> None:
    """Write the history of `releases`, in their order; a reader sees the old one or the new one.

    Raises:
      MachineError: git is missing or fails, or the file cannot be written.
    """
    with tempfile.TemporaryDirectory() as folder:
        repository = Path(folder) / "history.git"
        _make(repository, releases)
        made = Path(folder) / "releases.bundle"
        _git(repository, "bundle", "create", "--quiet", str(made), "HEAD", BRANCH, "--tags")
        partial = bundle.with_name(f".{bundle.name}.{os.getpid()}")
        try:
            partial.write_bytes(made.read_bytes())
            partial.replace(bundle)
        except OSError as error:
            partial.unlink(missing_ok=True)
            raise MachineError(f"cannot write {bundle}: {error.strerror}") from error


def update(bundle: Path, known: Sequence[Release]) -> list[Release]:
    """Append the releases of `known` that a history lacks; return those appended.

    Raises:
      InputError: one is older than the history's last: it could only be inserted, which would
        change every later hash.
    """
    old = read(bundle) if bundle.exists() else []
    versions = {r.version for r in old}
    new = [r for r in known if r.version not in versions]
    if old:
        inserted = [r.version for r in new if r.uploaded < old[-1].uploaded]
        if inserted:
            raise InputError(
                f"{', '.join(inserted)} came before {old[-1].version}, which the history ends"
                " with; a history is only appended to"
            )
    if new:
        write(bundle, [*old, *new])
    return new


def verify(bundle: Path, known: Sequence[Release] | None = None) -> list[str]:
    """Return what is wrong with a history, in lines; none when it is what it should be.

    It is made again from its own list of releases, and every hash compared; the list itself is
    compared with `known`, what the index says, where given.
    """
    releases = read(bundle)
    with tempfile.TemporaryDirectory() as folder:
        repository = Path(folder) / "history.git"
        _make(repository, releases)
        wanted = _refs(repository)
    found = hashes(bundle)
    problems = [
        f"{name}: hash {found.get(name, 'missing')}, made again {wanted.get(name, 'missing')}"
        for name in sorted({*found, *wanted})
        if found.get(name) != wanted.get(name)
    ]
    times = {r.version: r.uploaded for r in known or ()}
    if known is not None:
        problems += [
            f"{r.tag}: uploaded {r.uploaded:%Y-%m-%d %H:%M:%S}, the index says"
            f" {times.get(r.version, 'there is no such release')}"
            for r in releases
            if times.get(r.version) != r.uploaded
        ]
    return problems


def _make(repository: Path, releases: Sequence[Release]) -> None:
    """Make a bare git repository with the history of `releases`."""
    _git(None, "init", "--quiet", "--bare", f"--initial-branch={BRANCH}", str(repository))
    stream = []
    for number, release in enumerate(releases, start=1):
        who = f"{AUTHOR} {int(release.uploaded.timestamp())} +0000"
        parent = f"from :{number - 1}\n" if number > 1 else ""
        stream.append(
            f"commit refs/heads/{BRANCH}\nmark :{number}\nauthor {who}\ncommitter {who}\n"
            f"{_blob(f'MuJoCo {release.version}')}{parent}"
            f"M 100644 inline requirements.txt\n{_blob(f'mujoco=={release.version}' + chr(10))}"
            f"reset refs/tags/{release.tag}\nfrom :{number}\n\n"
        )
    _git(repository, "fast-import", "--quiet", stdin="".join(stream))


def _blob(text: str) -> str:
    return f"data {len(text.encode())}\n{text}\n"


def _refs(repository: Path) -> dict[str, str]:
    lines = _git(repository, "for-each-ref", "--format=%(refname:short) %(objectname)")
    return dict(line.split(" ") for line in lines.splitlines())


@contextlib.contextmanager
def _opened(bundle: Path) -> Iterator[Path]:
    """Yield a bare clone of a bundle, for as long as the block lasts."""
    if not bundle.is_file():
        raise InputError(f"no history at {bundle}: `mjbench releases update` makes one")
    with tempfile.TemporaryDirectory() as folder:
        repository = Path(folder) / "history.git"
        _git(None, "clone", "--quiet", "--bare", str(bundle), str(repository))
        yield repository


def _git(repository: Path | None, *words: str, stdin: str | None = None) -> str:
    """Run git apart from the user's own configuration; return what it prints."""
    where = [f"--git-dir={repository}"] if repository else []
    environment = {k: v for k, v in os.environ.items() if not k.startswith("GIT_")}
    environment |= {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_NOSYSTEM": "1"}
    try:
        done = subprocess.run(
            ["git", *where, *words],
            input=stdin,
            capture_output=True,
            text=True,
            check=False,
            env=environment,
        )
    except OSError:
        raise MachineError("git is not installed; the history of releases needs it") from None
    if done.returncode:
        raise MachineError(f"git {words[0]} failed: {one_line(done.stderr)}")
    return done.stdout
