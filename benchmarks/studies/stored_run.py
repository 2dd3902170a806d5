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


def run_of(arguments: Sequence[str], folder: Path | None = None) -> "Run":
    """Run `mjbench ARGUMENTS`; return its run file.

    Args:
      folder: to run in; None for the current one.

    Raises:
      MachineError: it stored none.
      KeyboardInterrupt: it was interrupted.
    """
    # late: asv imports this module where few packages are
    from mjbench.commands.show import kinds
    from mjbench.results import runs

    with tempfile.TemporaryDirectory() as results:
        # right after the name of the command: what follows `--` is of a program
        words = [arguments[0], "--results", results, *arguments[1:]]
        command = [sys.executable, "-m", "mjbench", *words]
        ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if ended.returncode == ExitCode.INTERRUPTED:
            raise KeyboardInterrupt
        files = sorted(Path(results).glob("*.jsonl"))
        if not files:
            last = one_line(ended.stderr.strip().rpartition("\n")[2])
            name = " ".join(arguments)
            raise MachineError(f"mjbench {name}: exit code {ended.returncode}: {last}")
        return runs.load(files[0], kinds.RECORD_TYPES)
