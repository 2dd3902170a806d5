"""Revisions: what is checked out, and that the user's checkout stays as it is."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from mjbench.errors import InputError, MachineError
from mjbench.releases.revisions import WORKTREE, Repository, Revision

Git = Callable[..., str]


@pytest.fixture
def git(tmp_path: Path) -> Git:
    """Return what runs git in a new repository with two commits."""
    top = tmp_path / "checkout"
    top.mkdir()

    def run(*arguments: str) -> str:
        command = ["git", "-c", "user.name=n", "-c", "user.email=e", *arguments]
        return subprocess.run(command, cwd=top, check=True, capture_output=True, text=True).stdout

    run("init", "-q", "-b", "main")
    (top / "step.py").write_text("old\n")
    (top / ".gitattributes").write_text("step.py export-ignore\n")
    (top / ".gitignore").write_text("ignored\n")
    run("add", "-A")
    run("commit", "-q", "-m", "first")
    run("tag", "v1")
    (top / "step.py").write_text("new\n")
    run("commit", "-q", "-a", "-m", "second")
    return run


def checked_out(tmp_path: Path, name: str) -> tuple[Path, str]:
    repository = Repository(tmp_path / "checkout")
    folder = tmp_path / f"out-{name}"
    tree = repository.check_out(repository.parse(name), folder, tmp_path / f"work-{name}")
    return folder, tree


def test_the_files_of_a_commit_are_checked_out(git: Git, tmp_path: Path) -> None:
    folder, tree = checked_out(tmp_path, "v1")
    assert (folder / "step.py").read_text() == "old\n"
    assert tree == git("rev-parse", "v1^{tree}").strip()


def test_the_worktree_is_what_is_not_ignored(git: Git, tmp_path: Path) -> None:
    top = tmp_path / "checkout"
    (top / "step.py").write_text("changed\n")
    (top / "untracked").write_text("")
    (top / "ignored").write_text("")
    folder, tree = checked_out(tmp_path, WORKTREE)
    assert (folder / "step.py").read_text() == "changed\n"
    assert (folder / "untracked").exists()
    assert not (folder / "ignored").exists()
    assert tree != git("rev-parse", "HEAD^{tree}").strip()


def test_a_worktree_without_changes_has_the_files_of_its_commit(git: Git, tmp_path: Path) -> None:
    assert checked_out(tmp_path, WORKTREE)[1] == checked_out(tmp_path, "HEAD")[1]


def test_the_checkout_is_not_touched(git: Git, tmp_path: Path) -> None:
    top = tmp_path / "checkout"
    (top / "untracked").write_text("something that no object holds yet")

    def state() -> dict[str, bytes]:
        return {str(file): file.read_bytes() for file in top.rglob("*") if file.is_file()}

    before = state()
    for name in ("v1", "main", WORKTREE):
        checked_out(tmp_path, name)
    assert state() == before


def test_files_of_submodules_are_checked_out(git: Git, tmp_path: Path) -> None:
    top = tmp_path / "checkout"
    git("clone", "-q", str(top), str(tmp_path / "other"))
    git(
        "-c", "protocol.file.allow=always", "submodule", "add", "-q", str(tmp_path / "other"), "sub"
    )
    git("commit", "-q", "-m", "submodule")
    (top / "sub/step.py").write_text("changed\n")
    assert (checked_out(tmp_path, "HEAD")[0] / "sub/step.py").read_text() == "new\n"
    assert (checked_out(tmp_path, WORKTREE)[0] / "sub/step.py").read_text() == "changed\n"


def test_commits_that_only_the_baseline_has_are_counted(git: Git, tmp_path: Path) -> None:
    repository = Repository(tmp_path / "checkout")
    old, new = repository.parse("v1"), repository.parse("main")
    assert (repository.lacking(old, new), repository.lacking(new, old)) == (0, 1)


@pytest.mark.parametrize(
    ("name", "message"),
    [("mian", "mian is no revision of .*did you mean main"), ("--all", "--all is no revision")],
)
def test_a_revision_that_does_not_exist_is_reported(
    git: Git, tmp_path: Path, name: str, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Repository(tmp_path / "checkout").parse(name)


def test_a_shallow_clone_is_named_as_the_reason(git: Git, tmp_path: Path) -> None:
    shallow = tmp_path / "shallow"
    git("clone", "-q", "--depth", "1", f"file://{tmp_path / 'checkout'}", str(shallow))
    with pytest.raises(InputError, match="a shallow clone: fetch it first"):
        Repository(shallow).parse("0123456789")


def test_a_folder_outside_of_any_repository_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="in no checkout of a git repository"):
        Repository(tmp_path)


def test_what_git_cannot_read_is_reported_in_one_line(git: Git, tmp_path: Path) -> None:
    gone = Revision("gone", "0" * 40)
    with pytest.raises(MachineError, match="git rev-parse: "):
        Repository(tmp_path / "checkout").check_out(gone, tmp_path / "out", tmp_path / "work")


def test_the_history_begins_after_the_baseline(git: Git, tmp_path: Path) -> None:
    git("commit", "-q", "--allow-empty", "-m", "third")
    repository = Repository(tmp_path / "checkout")
    old, new = repository.parse("v1"), repository.parse("main")
    commits = repository.history(old, new)
    assert [commit.subject for commit in commits] == ["second", "third"]
    assert commits[-1].commit == new.commit
    for baseline, candidate in ((new, old), (new, new)):
        with pytest.raises(InputError, match="does not come after"):
            repository.history(baseline, candidate)
    with pytest.raises(InputError, match="WORKTREE has no history"):
        repository.history(old, Revision(WORKTREE))


def test_the_text_of_a_file_is_read_from_a_revision(git: Git, tmp_path: Path) -> None:
    repository = Repository(tmp_path / "checkout")
    assert repository.text(repository.parse("v1"), Path("step.py")) == b"old\n"
    assert repository.text(repository.parse("v1"), Path("none.py")) is None
