"""Revisions: what is checked out, and that the user's checkout stays as it is."""

import os
from pathlib import Path

import pytest
from git_checkout import Git, commit, new_repository

from mjbench.errors import InputError, MachineError
from mjbench.releases.revisions import WORKTREE, Repository, Revision


@pytest.fixture
def git(tmp_path: Path) -> Git:
    """Return what runs git in a new repository with two commits."""
    top = tmp_path / "checkout"
    top.mkdir()
    git = new_repository(top)
    (top / "step.py").write_text("old\n")
    (top / ".gitattributes").write_text("step.py export-ignore\n")
    (top / ".gitignore").write_text("ignored\n")
    commit(git, "first", "v1")
    (top / "step.py").write_text("new\n")
    commit(git, "second")
    return git


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


@pytest.mark.parametrize("has_split_index", [False, True])
def test_the_checkout_is_not_touched(git: Git, tmp_path: Path, has_split_index: bool) -> None:
    top = tmp_path / "checkout"
    git("config", "core.splitIndex", str(has_split_index))
    (top / "untracked").write_text("something that no object holds yet")

    def state() -> dict[str, bytes]:
        return {str(file): file.read_bytes() for file in top.rglob("*") if file.is_file()}

    before = state()
    for name in ("v1", "main", WORKTREE):
        checked_out(tmp_path, name)
    assert state() == before


def add_submodule(git: Git, tmp_path: Path) -> None:
    git("clone", "-q", str(tmp_path / "checkout"), str(tmp_path / "other"))
    git(
        "-c", "protocol.file.allow=always", "submodule", "add", "-q", str(tmp_path / "other"), "sub"
    )
    git("commit", "-q", "-m", "submodule")


def test_files_of_submodules_are_checked_out(git: Git, tmp_path: Path) -> None:
    top = tmp_path / "checkout"
    add_submodule(git, tmp_path)
    (top / "sub/step.py").write_text("changed\n")
    assert (checked_out(tmp_path, "HEAD")[0] / "sub/step.py").read_text() == "new\n"
    assert (checked_out(tmp_path, WORKTREE)[0] / "sub/step.py").read_text() == "changed\n"


def test_the_files_of_submodules_are_part_of_the_hash(git: Git, tmp_path: Path) -> None:
    add_submodule(git, tmp_path)
    assert checked_out(tmp_path, WORKTREE)[1] == checked_out(tmp_path, "HEAD")[1]
    (tmp_path / "checkout/sub/step.py").write_text("changed\n")
    git("branch", "again")
    again = Repository(tmp_path / "checkout")
    changed = again.check_out(Revision(WORKTREE), tmp_path / "out", tmp_path / "work")
    assert changed != checked_out(tmp_path, "again")[1]


def test_an_edit_in_the_second_of_the_commit_is_seen(git: Git, tmp_path: Path) -> None:
    top = tmp_path / "checkout"
    git("config", "core.trustctime", "false")
    step, index = top / "step.py", top / ".git/index"
    os.utime(step, (1e9, 1e9))
    git("update-index", "--refresh")
    step.write_text("odd\n")  # as long as before
    for file in (step, index):
        os.utime(file, (1e9, 1e9))
    folder, _ = checked_out(tmp_path, WORKTREE)
    assert (folder / "step.py").read_text() == "odd\n"


def test_commits_that_only_the_baseline_has_are_counted(git: Git, tmp_path: Path) -> None:
    repository = Repository(tmp_path / "checkout")
    old, new = repository.parse("v1"), repository.parse("main")
    assert (repository.lacking(old, new), repository.lacking(new, old)) == (0, 1)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mian", "mian is no revision of .*did you mean main"),
        *((name, r"is no revision of") for name in ("--all", "^HEAD", "v1..main", "", "HEAD:")),
    ],
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


def test_a_history_that_a_shallow_clone_lacks_is_named_as_the_reason(
    git: Git, tmp_path: Path
) -> None:
    shallow = tmp_path / "shallow"
    git("clone", "-q", "--depth", "1", f"file://{tmp_path / 'checkout'}", str(shallow))
    git("-C", str(shallow), "fetch", "-q", "--depth", "1", "origin", "tag", "v1")
    repository = Repository(shallow)
    with pytest.raises(
        InputError, match=r"does not come after v1.*a shallow clone: fetch it first"
    ):
        repository.history(repository.parse("v1"), repository.parse("HEAD"))


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


def test_messages_and_signatures_do_not_disturb_the_history(git: Git, tmp_path: Path) -> None:
    git("config", "log.showSignature", "true")
    git("commit", "-q", "--allow-empty", "-m", "third\u2028and\x0con")
    repository = Repository(tmp_path / "checkout")
    commits = repository.history(repository.parse("v1"), repository.parse("main"))
    assert [commit.subject for commit in commits] == ["second", "third\u2028and\x0con"]


def test_the_path_of_a_checkout_may_have_a_colon(git: Git, tmp_path: Path) -> None:
    top = (tmp_path / "checkout").rename(tmp_path / "a:b")
    (top / "step.py").write_text("changed\n")
    Repository(top).check_out(Revision(WORKTREE), tmp_path / "out", tmp_path / "work")
    assert (tmp_path / "out/step.py").read_text() == "changed\n"


def test_the_first_problem_that_git_names_is_shown(git: Git, tmp_path: Path) -> None:
    (tmp_path / "checkout/.git/index").write_text("no index " * 20)
    repository = Repository(tmp_path / "checkout")
    with pytest.raises(MachineError, match="git add: error: bad signature"):
        repository.check_out(Revision(WORKTREE), tmp_path / "out", tmp_path / "work")


def test_the_text_of_a_file_is_read_from_a_revision(git: Git, tmp_path: Path) -> None:
    repository = Repository(tmp_path / "checkout")
    assert repository.text(repository.parse("v1"), Path("step.py")) == b"old\n"
    assert repository.text(repository.parse("v1"), Path("none.py")) is None
