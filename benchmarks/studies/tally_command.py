"""Commands of benchmarks: their parser; and errors and Ctrl-C are a line, and an exit code."""

import argparse
import sys
from collections.abc import Callable

from mjbench.errors import MjbenchError
from mjbench.status import ExitCode


def parser(module_doc: str | None) -> argparse.ArgumentParser:
    """Return the parser of a command; its module's docstring is the help."""
    return argparse.ArgumentParser(
        description=module_doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )


def run(name: str, action: Callable[[], ExitCode], stored: str = "nothing was stored") -> ExitCode:
    """Run the action of a command; return its exit code.

    Args:
      stored: what an interrupted action has stored.
    """
    try:
        return action()
    except MjbenchError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"{name}: interrupted; {stored}", file=sys.stderr)
        return ExitCode.INTERRUPTED


def run_measuring(name: str, command: Callable[..., object]) -> ExitCode:
    """Run a click command that measures; end what it has started, and return its exit code."""
    from mjbench.api import interrupts
    from mjbench.host import child

    def action() -> ExitCode:
        try:
            command(prog_name=f"python -m benchmarks.{name}")
        finally:
            interrupts.disable()
            child.end_descendants()
        return ExitCode.OK

    return run(name, action, "what was measured is saved")
