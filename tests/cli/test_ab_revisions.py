"""`mjbench ab OLD NEW FUNCTION` in a scratch repository: from the command line to the comment."""

import json
import subprocess
from pathlib import Path

import pytest
from commands import PYTHONPATH, mjbench
from git_checkout import commit, new_repository

from mjbench.commands.versions import function_verdict
from mjbench.paired import verdict

OLD = """
def advance(x):
    for _ in range(300):
        x = 0.5 * x + 1
    return x
def results(): return 1
"""
NEW = (
    OLD.replace("range(300)", "range(600)")
    .replace("return x", "return 2.0")
    .replace("return 1", "return 2")
    + "def added(): pass\n"
)
BENCH = """
from physics import advance, results
def step(): advance(1.0)
def other(): return results()
def new():
    from physics import added
    added()
def elsewhere():
    import mine
    mine.step()
"""


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a repository whose HEAD is slower than the tag `old`; benchmarks are not committed."""
    top = tmp_path_factory.mktemp("checkout")
    git = new_repository(top)
    for text, tag in ((OLD, "old"), (NEW, "new")):
        (top / "physics.py").write_text(text)
        commit(git, tag, tag)
    (top / "bench.py").write_text(BENCH)
    (top / "lib").mkdir()
    (top / "lib/mine.py").write_text("def step(): pass\n")
    return top


def ab(checkout: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return mjbench("ab", *arguments, cwd=checkout, env=variables)


def test_functions_are_compared_and_become_a_comment(
    checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (function_verdict, verdict):  # a difference as large as this needs few launches
        monkeypatch.setattr(module, "MIN_LAUNCHES", 3)
    file, runs = tmp_path / "out.json", ("--results", str(tmp_path))
    functions = [f"bench.py::{name}" for name in ("step", "other", "new")]
    fail_on = ("--fail-on", "slower", "--json", str(file))
    done = ab(checkout, "old", "rev=WORKTREE", *functions, *fail_on, *runs)
    assert done.returncode == 1, done.stderr
    step, other, new = json.loads(file.read_text())["results"]
    assert (step["verdict"], step["status"]) == ("slower", "ok")
    assert step["ratio"]["estimate"] > 1.3
    assert step["control"]["launches"] == 3
    assert (other["verdict"], other["status"]) == (None, "disagrees")
    assert "call 1 returns 2 instead of 1" in other["detail"]
    assert (new["verdict"], new["status"]) == (None, "new")
    assert "cannot import name 'added'" in new["detail"]
    comment = mjbench("show", "--comment", "-", *runs, cwd=checkout)
    assert "❌ 1 slower · ❌ 1 with other results · 🆕 1 new: action needed" in comment.stdout
    status = ["git", "status", "--porcelain"]
    listed = subprocess.run(status, cwd=checkout, capture_output=True, text=True, check=True)
    assert listed.stdout.splitlines() == ["?? bench.py", "?? lib/"]


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("rev=old", "rev=nwe", "bench.py::step"), 2, "nwe is no revision"),
        (("old", "nwe", "bench.py::step"), 2, "nwe is no revision"),
        (("old", "path=rollout", "bench.py::step"), 2, "a revision is compared with a revision"),
        (("rev=old", "rev=new"), 2, "name a function of your code"),
        (("rev=old", "path=rollout"), 2, "a revision is compared with a revision"),
        (("bench.py::step", "bench.py::other"), 2, "give two, and functions after them"),
        (("path=rollout", "path=rollout", "cartpole"), 2, "a revision is compared with a revision"),
        (("old", "new", "cartpole"), 2, "name a function of your code, FILE.py::FUNCTION"),
        (("old", "new", "physics:step"), 2, "such as bench.py::step, not physics:step"),
        (("old", "new"), 2, "two revisions need a function after them"),
        (("rev=old", "rev=new", "bench.py::step", "--nbatch", "4"), 2, "are of models"),
        (("rev=old", "rev=new", "bench.py::step", "--metric", "load"), 2, "is of models"),
        (("rev=old", "rev=new", "bench.py::none"), 2, "bench has no none"),
        (("rev=old", "rev=new", "bench.py::new"), 6, "new, so not compared"),
        (("rev=new", "rev=old", "bench.py::new"), 3, "cannot import name 'added'"),
        (("rev=old", "rev=new", "bench.py::elsewhere"), 5, "which is not the revision's"),
    ],
)
def test_what_cannot_be_compared_has_an_exit_code_and_a_line(
    checkout: Path, tmp_path: Path, arguments: tuple[str, ...], code: int, message: str
) -> None:
    done = ab(
        checkout,
        *(*arguments, "--results", str(tmp_path)),
        PYTHONPATH=f"{PYTHONPATH}:{checkout / 'lib'}",  # as of an editable install
    )
    assert done.returncode == code, done.stderr
    lines = (done.stdout + done.stderr).splitlines()
    assert len([line for line in lines if message in line]) == 1
    assert "Traceback" not in done.stderr


def test_the_same_files_are_said_to_be_the_same(checkout: Path, tmp_path: Path) -> None:
    done = ab(checkout, "new", "HEAD", "physics.py::added", "--results", str(tmp_path))
    assert done.returncode == 0
    assert "same: both revisions have the same files, so nothing was timed" in done.stdout


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["new", "rev=old", "bench.py::step"], 2, "does not come after new"),
        (
            ["old", "new", "physics.py::results", "--own-files"],
            1,
            "physics.py::results: results differ: call 1 returns 2 instead of 1",
        ),
    ],
)
def test_a_search_needs_a_history_and_ends_that_do_the_same_work(
    checkout: Path, tmp_path: Path, words: list[str], code: int, message: str
) -> None:
    done = mjbench("bisect", *words, "--results", str(tmp_path), cwd=checkout)
    assert done.returncode == code
    assert message in done.stdout + done.stderr
