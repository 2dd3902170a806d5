"""The history of releases that asv walks: a git repository in one file, a git bundle.

asv walks commits, so the history has one commit for every release, in the order of upload. Each
commit's tree holds nothing but `requirements.txt`, and each has a tag such as v3.5.0. Author, dates
and messages follow from the release alone, so the hashes, under which asv stores results, are the
same wherever the history is built. Releases are only ever appended.
"""

import contextlib
import os
import subprocess
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

from mjbench.errors import InputError, MachineError, one_line, writing
from mjbench.host import files
from mjbench.releases.release import Release

BRANCH = "releases"
# Author and committer of every commit; fixed, because they are part of the hash.
AUTHOR = "MuJoCo releases <releases@mjbench.invalid>"


def default_path() -> Path:
    return Path(__file__).resolve().parents[1] / "releases.bundle"


def read(bundle: Path) -> list[Release]:
    """Return the releases of a history, in its order; InputError without the file."""
    with _cloned(bundle) as repository:
        log = _git(repository, "log", "--first-parent", "--reverse", "--format=%ct %s", BRANCH)
    releases = []
    for line in log.splitlines():
        seconds, _, message = line.partition(" ")
        version = message.removeprefix("MuJoCo ")
        releases.append(Release(version, datetime.fromtimestamp(int(seconds), UTC)))
    return releases


def hashes(bundle: Path) -> dict[str, str]:
    with _cloned(bundle) as repository:
        lines = _git(repository, "for-each-ref", "--format=%(refname:short) %(objectname)")
    return dict(line.split(" ") for line in lines.splitlines())


def write(bundle: Path, releases: Sequence[Release]) -> None:
    """Write the history of `releases`; a reader sees the file from before, or the whole new one."""
    with files.temporary_folder() as folder:
        repository = folder / "history.git"
        _build(repository, releases)
        complete = folder / "releases.bundle"
        _git(repository, "bundle", "create", "--quiet", str(complete), "HEAD", BRANCH, "--tags")
        with writing(bundle), files.replacing(bundle) as partial:
            partial.write_bytes(complete.read_bytes())


def update(bundle: Path, indexed: Sequence[Release]) -> list[Release]:
    """Append the releases of the index that a history lacks or begin one; return these releases.

    InputError says that one is older than the history's last.
    """
    recorded = read(bundle) if bundle.exists() else []
    versions = {r.version for r in recorded}
    missing = [r for r in indexed if r.version not in versions]
    if recorded:
        last = recorded[-1]
        older = [r.version for r in missing if r.uploaded < last.uploaded]
        if older:
            raise InputError(
                f"{', '.join(older)} came before {last.version}, the last release of the history;"
                " releases are only appended, because inserting one would change later hashes"
            )
    if missing:
        write(bundle, [*recorded, *missing])
    return missing


def verify(bundle: Path, indexed: Sequence[Release] | None = None) -> list[str]:
    """Check a history; return one line for each problem.

    The history is built again from its own list of releases, and every hash is compared. The list
    itself is compared with that of the package index, if it can be asked.
    """
    releases = read(bundle)
    with files.temporary_folder() as folder:
        write(folder / "again.bundle", releases)
        expected = hashes(folder / "again.bundle")
    actual = hashes(bundle)
    problems = [
        f"{name}: hash {actual.get(name, 'missing')}, expected {expected.get(name, 'none')}"
        for name in sorted({*actual, *expected})
        if actual.get(name) != expected.get(name)
    ]
    if indexed is not None:
        uploads = {r.version: r.uploaded for r in indexed}
        problems += [
            f"{r.tag}: uploaded {r.uploaded:%Y-%m-%d %H:%M:%S}, the index says"
            f" {uploads.get(r.version, 'there is no such release')}"
            for r in releases
            if uploads.get(r.version) != r.uploaded
        ]
    return problems


def _build(repository: Path, releases: Sequence[Release]) -> None:
    """Create a bare git repository with the history of `releases`.

    All commits go to git at once, as a stream for `git fast-import`: each has its parent
    (`from :MARK`), its one file, and its tag (`reset refs/tags/…`).
    """
    _git(None, "init", "--quiet", "--bare", f"--initial-branch={BRANCH}", str(repository))
    commands = []
    for number, release in enumerate(releases, start=1):
        signature = f"{AUTHOR} {int(release.uploaded.timestamp())} +0000"
        parent = f"from :{number - 1}\n" if number > 1 else ""
        requirements = f"mujoco=={release.version}\n"
        commands.append(
            f"commit refs/heads/{BRANCH}\n"
            f"mark :{number}\n"
            f"author {signature}\n"
            f"committer {signature}\n"
            f"{_data(f'MuJoCo {release.version}')}"
            f"{parent}"
            f"M 100644 inline requirements.txt\n"
            f"{_data(requirements)}"
            f"reset refs/tags/{release.tag}\n"
            f"from :{number}\n\n"
        )
    _git(repository, "fast-import", "--quiet", stdin="".join(commands))


def _data(text: str) -> str:
    """Return `text` as fast-import reads it: behind its length in bytes."""
    return f"data {len(text.encode())}\n{text}\n"


@contextlib.contextmanager
def _cloned(bundle: Path) -> Iterator[Path]:
    if not bundle.is_file():
        raise InputError(f"no history at {bundle}; python -m benchmarks.history append creates it")
    with files.temporary_folder() as folder:
        repository = folder / "history.git"
        _git(None, "clone", "--quiet", "--bare", str(bundle), str(repository))
        yield repository


def _git(repository: Path | None, *arguments: str, stdin: str | None = None) -> str:
    """Run git without the user's own configuration; return what it prints."""
    location = [f"--git-dir={repository}"] if repository else []
    environment = {k: v for k, v in os.environ.items() if not k.startswith("GIT_")}
    environment |= {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_NOSYSTEM": "1"}
    try:
        done = subprocess.run(
            ["git", *location, *arguments],
            input=stdin,
            capture_output=True,
            text=True,
            check=False,
            env=environment,
        )
    except OSError:
        raise MachineError("git is not installed; the history of releases needs it") from None
    if done.returncode:
        raise MachineError(f"git {arguments[0]} failed: {one_line(done.stderr)}")
    return done.stdout
