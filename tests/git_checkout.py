"""Repositories of git with commits of their own, for tests of what reads revisions."""

import subprocess
from collections.abc import Callable
from pathlib import Path

Git = Callable[..., str]


def new_repository(top: Path) -> Git:
    """Make a folder a repository; return what runs git there, and returns what git prints."""

    def git(*arguments: str) -> str:
        command = ["git", "-c", "user.name=n", "-c", "user.email=e", *arguments]
        return subprocess.run(command, cwd=top, check=True, capture_output=True, text=True).stdout

    git("init", "-q", "-b", "main")
    return git


def commit(git: Git, message: str, tag: str = "") -> None:
    """Commit all files, with a tag if one is named."""
    git("add", "-A")
    git("commit", "-q", "-m", message)
    if tag:
        git("tag", tag)
