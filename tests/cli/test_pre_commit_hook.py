"""The pre-commit hook installs what `mjbench lint` imports."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

from commands import ROOT

PROGRAM = """
import sys
sys.modules.update(dict.fromkeys(sys.argv[1].split(",")))  # importing them raises ImportError
sys.argv[1:] = ["lint", sys.argv[2]]
from mjbench.__main__ import main
main()
"""


def names(requirements: list[str]) -> set[str]:
    return {re.split(r"[<>=!~ ]", requirement, maxsplit=1)[0] for requirement in requirements}


def test_the_hook_takes_python_files_and_notebooks() -> None:
    assert "types_or: [python, jupyter]" in (ROOT / ".pre-commit-hooks.yaml").read_text()


def test_lint_runs_with_the_packages_that_the_hook_installs(tmp_path: Path) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    hook = (ROOT / ".pre-commit-hooks.yaml").read_text()
    (listed,) = re.findall(r"additional_dependencies: \[(.*)\]", hook)
    installed = names([*project["dependencies"], *listed.split(", ")])
    missing = names(project["optional-dependencies"]["cli"]) - installed
    assert missing
    script = tmp_path / "script.py"
    script.write_text("x = 1\n")
    completed = subprocess.run(
        [sys.executable, "-c", PROGRAM, ",".join(missing), str(script)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (completed.returncode, completed.stderr) == (0, "")
