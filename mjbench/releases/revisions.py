"""Revisions of the user's own code: which there are, and their files in a folder of their own.

The user's checkout is read and never written: neither its index, nor its branches, nor its list of
worktrees, nor its objects. Files come out through an index and an object folder of our own.
"""

import contextlib
import hashlib
import os
import re
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mjbench.errors import InputError, MachineError, one_line, shown, suggestion, writing
from mjbench.formats import short_commit

# Names what lies in the user's checkout now: changes that are not committed and files that are not
# tracked included, ignored files not.
WORKTREE = "WORKTREE"
# Variables by which a hook or a script points git elsewhere.
_REDIRECTING = ("GIT_DIR", "GIT_INDEX_FILE", "GIT_WORK_TREE", "GIT_OBJECT_DIRECTORY", "GIT_PREFIX")
# A full hash, as git prints it.
_HASH = re.compile(r"[0-9a-f]{40,}")
# How git begins the line that says what went wrong.
_PROBLEMS = ("error:", "fatal:")
# The mode of a submodule in the listing of a tree.
_SUBMODULE = "160000"


@dataclass(frozen=True)
class Revision:
    """A revision that a user named, with its full hash; WORKTREE has none."""

    name: str
    commit: str = ""

    @property
    def is_worktree(self) -> bool:
        return not self.commit

    def __str__(self) -> str:
        is_named = self.commit and not self.commit.startswith(self.name)
        return f"{self.name} ({short_commit(self.commit)})" if is_named else self.name


@dataclass(frozen=True)
class Commit:
    """A commit, and the first line of its message."""

    commit: str
    subject: str

    @property
    def revision(self) -> Revision:
        return Revision(short_commit(self.commit), self.commit)


class Repository:
    """The git repository around a folder."""

    def __init__(self, folder: Path):
        """Find the repository; InputError outside of one, MachineError without git."""
        problem = f"{folder} is in no checkout of a git repository"
        self.top = Path(_git(folder, ["rev-parse", "--show-toplevel"], problem).rstrip("\n"))

    def parse(self, name: str) -> Revision:
        """Return the revision of a branch, a tag, a commit, or WORKTREE; InputError without it."""
        if name == WORKTREE:
            return Revision(name)
        commit = ""
        with contextlib.suppress(MachineError):
            commit = self._run("rev-parse", "--verify", "--end-of-options", f"{name}^{{commit}}")
        commit = commit.strip()
        if not _HASH.fullmatch(commit):  # of `^HEAD`, git prints a hash with a `^`
            raise InputError(f"{shown(name)} is no revision of {self.top}{self._hint(name)}")
        return Revision(short_commit(commit) if name == commit else name, commit)

    def lacking(self, baseline: Revision, candidate: Revision) -> int:
        newer = candidate.commit or "HEAD"
        old = baseline.commit or "HEAD"
        return int(self._run("rev-list", "--count", f"{newer}..{old}"))

    def history(self, baseline: Revision, candidate: Revision) -> list[Commit]:
        """Return the commits after a baseline up to a candidate, the oldest first.

        Only first parents are followed; InputError if the baseline is none of the candidate's.
        """
        if baseline.is_worktree or candidate.is_worktree:
            raise InputError(f"{WORKTREE} has no history: name commits")
        span = f"{baseline.commit}..{candidate.commit}"
        options = ("--first-parent", "--reverse", "--no-show-signature", "-z")
        texts = iter(self._run("log", *options, "--format=%H %P%x00%s", span).split("\0")[:-1])
        commits = list[Commit]()
        for hashes, subject in zip(texts, texts, strict=True):
            commit, *parents = hashes.split()
            if not commits and baseline.commit not in parents[:1]:
                break
            commits.append(Commit(commit, subject))
        if not commits:
            same = " (they are the same commit)" if baseline.commit == candidate.commit else ""
            problem = f"{candidate} does not come after {baseline}, by first parents{same}"
            raise InputError(problem + ("" if same else self._shallow_hint()))
        return commits

    def text(self, revision: Revision, file: Path) -> bytes | None:
        if revision.is_worktree:
            return (self.top / file).read_bytes() if (self.top / file).is_file() else None
        name = f"{revision.commit}:{file.as_posix()}"
        try:
            return self._run("cat-file", "blob", name).encode("utf-8", "surrogateescape")
        except MachineError:
            return None

    def check_out(self, revision: Revision, folder: Path, work: Path) -> str:
        """Write the files of a revision into a new folder; return a hash of all of them.

        Submodules that the checkout has are written, too. Without any, it is the hash of the tree.
        """
        with writing(folder):
            folder.mkdir(parents=True)
            (work / "objects").mkdir(parents=True)
        variables = {"GIT_INDEX_FILE": str(work / "index")}
        if revision.is_worktree:
            with writing(work):
                (work / "objects/info").mkdir()
                alternates = f"{self._git_path('objects')}\n"
                (work / "objects/info/alternates").write_text(alternates)
            variables["GIT_OBJECT_DIRECTORY"] = str(work / "objects")
            tree = self._worktree_tree(work / "index", variables)
        else:
            tree = self._run("rev-parse", f"{revision.commit}^{{tree}}").strip()
            self._run("read-tree", "--no-sparse-checkout", tree, variables=variables)
        self._run("checkout-index", "--all", f"--prefix={folder}/", variables=variables)
        trees = [tree]
        for number, (path, commit) in enumerate(self._submodules(tree, variables)):
            if not (self.top / path / ".git").exists():
                continue  # nor does the checkout have its files
            own = Revision(f"{revision.name}:{path}", commit)
            inner = revision if revision.is_worktree else own
            shutil.rmtree(folder / path, ignore_errors=True)
            submodule = Repository(self.top / path)
            trees += [path, submodule.check_out(inner, folder / path, work / str(number))]
        if len(trees) == 1:
            return tree
        text = "\0".join(trees).encode("utf-8", "surrogateescape")
        return hashlib.blake2b(text, digest_size=20).hexdigest()

    def _worktree_tree(self, index: Path, variables: Mapping[str, str]) -> str:
        """Return the tree of what lies in the checkout; its objects are written elsewhere."""
        own = self._git_path("index")
        with writing(index):
            if own.exists():  # it knows which files have not changed before it was written itself
                shutil.copy2(own, index)
        self._run("add", "--all", ".", variables=variables)
        return self._run("write-tree", variables=variables).strip()

    def _submodules(self, tree: str, variables: Mapping[str, str]) -> list[tuple[str, str]]:
        listing = self._run("ls-tree", "-r", "-z", tree, variables=variables)
        entries = [entry.partition("\t") for entry in listing.split("\0") if entry]
        return [
            (path, description.split()[2])
            for description, _, path in entries
            if description.startswith(_SUBMODULE)
        ]

    def _git_path(self, name: str) -> Path:
        return (self.top / self._run("rev-parse", "--git-path", name).rstrip("\n")).resolve()

    def _hint(self, name: str) -> str:
        """Return what may be meant by an unknown revision, as the end of a sentence."""
        format_ = "--format=%(refname:short)"
        names = self._run("for-each-ref", format_, "refs/heads", "refs/tags", "refs/remotes")
        if meant := suggestion(name, [WORKTREE, "HEAD", *names.split()]):
            return meant
        return self._shallow_hint()

    def _shallow_hint(self) -> str:
        """Return how a shallow clone gets its history, as the end of a sentence."""
        if self._run("rev-parse", "--is-shallow-repository").strip() != "true":
            return ""
        return ", a shallow clone: fetch it first (in actions/checkout: fetch-depth: 0)"

    def _run(self, *arguments: str, variables: Mapping[str, str] | None = None) -> str:
        return _git(self.top, arguments, variables=variables)


def _git(
    folder: Path,
    arguments: Sequence[str],
    problem: str = "",
    variables: Mapping[str, str] | None = None,
) -> str:
    """Return what a command of git prints; `problem` is what it means that the command fails."""
    environment = {k: v for k, v in os.environ.items() if k not in _REDIRECTING}
    settings = ("core.fsmonitor=false", "core.hooksPath=/dev/null", "core.splitIndex=false")
    try:
        done = subprocess.run(
            ["git", *(word for each in settings for word in ("-c", each)), *arguments],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            encoding="utf-8",
            errors="surrogateescape",
            check=False,
            env={**environment, "GIT_OPTIONAL_LOCKS": "0", "LC_ALL": "C", **(variables or {})},
        )
    except OSError as error:
        raise MachineError(f"cannot run git, which revisions need: {error.strerror}") from error
    if done.returncode == 0:
        return done.stdout
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    said = [line for line in lines if line.startswith(_PROBLEMS)] or lines[-1:]
    reason = one_line((said or ["it failed without a message"])[0])
    if problem and "dubious ownership" not in done.stderr:
        raise InputError(problem)
    raise MachineError(f"git {arguments[0]}: {reason}")
