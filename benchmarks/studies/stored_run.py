"""Runs a command of mjbench as users do, for studies that judge what it stores."""

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mjbench.errors import MachineError, one_line
from mjbench.status import ExitCode

if TYPE_CHECKING:
    from mjbench.results.runs import Run


def run_of(command: str, arguments: Sequence[str], folder: Path | None = None) -> "Run":
    """Run a command of mjbench; return its run file.

    Args:
      command: such as `compare`; empty for a check-up, which has no name.
      folder: to run in; None for the current one.

    Raises:
      MachineError: it stored none.
      KeyboardInterrupt: it was interrupted.
    """
    # late: asv imports this module where few packages are
    from mjbench.commands.show import kinds
    from mjbench.results import runs

    with tempfile.TemporaryDirectory() as results:
        # before the arguments: what follows a program is of the program
        words = [*command.split(), "--results", results, *arguments]
        python = [sys.executable, "-m", "mjbench", *words]
        ended = subprocess.run(python, cwd=folder, capture_output=True, text=True, check=False)
        if ended.returncode == ExitCode.INTERRUPTED:
            raise KeyboardInterrupt
        files = sorted(Path(results).glob("*.jsonl"))
        if not files:
            last = one_line(ended.stderr.strip().rpartition("\n")[2])
            name = " ".join(("mjbench", *command.split(), *arguments))
            raise MachineError(f"{name}: exit code {ended.returncode}: {last}")
        return runs.load(files[0], kinds.RECORD_TYPES)
