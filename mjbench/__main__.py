"""Start the command line; without its optional packages, say in one line what to install."""

import importlib.util
import signal
import sys
from typing import NoReturn

from mjbench.status import ExitCode

# Packages of the `cli` extra that every command needs.
_REQUIRED = ("click", "msgspec", "packaging", "platformdirs", "psutil", "rich")


def main() -> None:
    """Run `mjbench` with the process's arguments."""
    # until a command has something to save: an import that is interrupted need not be a traceback
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    missing = [name for name in _REQUIRED if not _is_installed(name)]
    if missing:
        from mjbench.instrument import extras

        _fail(f"the command line needs {', '.join(missing)}: {extras.install_command('cli')}")
    try:
        from mjbench.cli import cli, interrupts
    except Exception as error:  # a broken package, too few file descriptors
        _fail(f"cannot start: {type(error).__name__}: {error}")
    try:
        cli(prog_name="mjbench")
    finally:
        interrupts.disable()
        _end_processes()


def _end_processes() -> None:
    """End what a command has left running, such as a process that was interrupted as it started."""
    if "mjbench.instrument.child" in sys.modules:
        from mjbench.instrument import child

        child.end_descendants()


def _fail(line: str) -> NoReturn:
    sys.stderr.write(f"mjbench: {line}\n")
    sys.exit(ExitCode.ENVIRONMENT)


def _is_installed(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ValueError:  # `sys.modules[name]` is None: blocked on purpose
        return False


if __name__ == "__main__":
    main()
