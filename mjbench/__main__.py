"""Start the command line; without its packages, say in one line what to install."""

import contextlib
import sys
from typing import NoReturn

from mjbench.api import interrupts
from mjbench.status import ExitCode


def main() -> None:
    """Run `mjbench` with the process's arguments."""
    interrupts.end_at_once()  # until a command has something to save; imports have not
    try:
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
