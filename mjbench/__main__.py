"""Start the command line; without its optional packages, say in one line what to install."""

import importlib.util
import signal
import sys

# Packages of the `cli` extra that every command needs.
_REQUIRED = ("click", "msgspec", "packaging", "platformdirs", "psutil", "rich")


def main() -> None:
    """Run `mjbench` with the process's arguments."""
    # until a command has something to save: an import that is interrupted need not be a traceback
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    missing = [name for name in _REQUIRED if not _is_installed(name)]
    if missing:
        sys.exit(
            f"mjbench: the command line needs {', '.join(missing)}:"
            ' python -m pip install "mjbench[cli]"'
        )
    from mjbench.cli import cli

    cli(prog_name="mjbench")


def _is_installed(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ValueError:  # `sys.modules[name]` is None: blocked on purpose
        return False


if __name__ == "__main__":
    main()
