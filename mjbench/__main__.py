"""Start the command line; without its packages, say in one line what to install."""

import contextlib
import signal
import sys
from typing import NoReturn

from mjbench.status import ExitCode


def main() -> None:
    """Run `mjbench` with the process's arguments."""
    # until a command has something to save: an import that is interrupted need not be a traceback
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        from mjbench.api import interrupts
        from mjbench.cli import cli
    except ModuleNotFoundError as error:  # mjbench is run where it was not installed
        from mjbench import extras

        _fail(f"{error.name} is missing: {extras.install_command()}")
    except Exception as error:  # a broken package, too few file descriptors
        _fail(f"cannot start: {type(error).__name__}: {error}")
    try:
        cli(prog_name="mjbench")
    finally:
        interrupts.disable()
        _end_processes()


def _end_processes() -> None:
    """End what a command has left running, such as a process that was interrupted as it started."""
    if "mjbench.host.child" in sys.modules:
        from mjbench.host import child

        child.end_descendants()


def _fail(line: str) -> NoReturn:
    with contextlib.suppress(OSError, AttributeError):  # it is closed, or its disk is full
        sys.stderr.write(f"mjbench: {line}\n")
    sys.exit(ExitCode.ENVIRONMENT)


if __name__ == "__main__":
    main()
