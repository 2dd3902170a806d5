"""The pre-commit hook."""

from commands import ROOT


def test_the_hook_takes_python_files_and_notebooks() -> None:
    assert "types_or: [python, jupyter]" in (ROOT / ".pre-commit-hooks.yaml").read_text()
