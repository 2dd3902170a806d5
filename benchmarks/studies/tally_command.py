"""How a command that writes a tally ends: errors and Ctrl-C are a line, and an exit code."""

import sys
from collections.abc import Callable

from mjbench.errors import MjbenchError
from mjbench.status import ExitCode


def run(name: str, action: Callable[[], ExitCode], stored: str) -> ExitCode:
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
