"""Start the command line; without its optional packages, say in one line what to install."""

import signal
import sys


def main() -> None:
    """Run `mjbench` with the process's arguments."""
    # until a command has something to save: an interrupted import is no KeyboardInterrupt
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        import click  # noqa: F401
        import rich  # noqa: F401
    except ModuleNotFoundError as error:
        sys.exit(
            f"mjbench: the command line needs the package {error.name!r}:"
            ' python -m pip install "mjbench[cli]"'
        )
    from mjbench.cli import cli

    cli(prog_name="mjbench")


if __name__ == "__main__":
    main()
