"""Which packages an extra of mjbench adds, and which command installs them.

The command names the packages themselves. It works wherever mjbench came from: a clone, or an
address of a version-control system.
"""

import importlib
import importlib.util
import re
import sys
from collections.abc import Iterable, Iterator

from mjbench.errors import MachineError, one_line

# `name>=1 ; extra == 'mjx'`, as the metadata of a package has it.
_OF_EXTRA = re.compile(
    r"^(?P<package>[^;]*?)\s*(;.*\bextra\s*==\s*['\"](?P<extra>[\w-]+)['\"].*)?$"
)
_OWN = re.compile(r"^mjbench\[(?P<extras>[\w,-]+)\]$")


def missing(packages: Iterable[str]) -> list[str]:
    """Return which of some packages cannot be imported, without importing them."""
    return [name for name in packages if not _is_installed(name)]


def require(what: str, extra: str, packages: Iterable[str]) -> None:
    """Refuse to go on without packages.

    Args:
      what: needs the packages, such as `a report`.
      packages: names by which they are imported.

    Raises:
      MachineError: one is missing, or cannot be imported; the message has the command that
        installs it.
    """
    names = list(packages)
    if absent := missing(names):
        raise MachineError(f"{what} needs {', '.join(absent)}: {install_command(extra)}")
    for name in names:
        try:
            importlib.import_module(name)
        except Exception as error:  # whatever a broken package raises
            cause = one_line(f"{type(error).__name__}: {error}")
            raise MachineError(
                f"{what} needs {name}, which cannot be imported ({cause}):"
                f" {install_command(extra)} --force-reinstall"
            ) from error


def _is_installed(name: str) -> bool:
    if name in sys.modules:
        return sys.modules[name] is not None  # None: blocked on purpose
    try:
        return importlib.util.find_spec(name) is not None
    except (ImportError, ValueError):
        return False


def install_command(names: str = "") -> str:
    """Return the command that installs the packages of extras, such as `mjx,warp`.

    Without a name, they are those that mjbench always needs.

    Where the metadata of mjbench is missing, because it was not installed, the command is that for
    a clone.
    """
    import importlib.metadata  # late: it takes longer to import than the rest

    try:
        requirements = importlib.metadata.requires("mjbench") or []
    except importlib.metadata.PackageNotFoundError:
        requirements = []
    packages = [each for name in names.split(",") for each in _packages(name, requirements)]
    arguments = list(dict.fromkeys(packages)) or [f".[{names}]" if names else "."]
    return f"python -m pip install {' '.join(map(_quoted, arguments))}"


def _packages(extra: str, requirements: list[str]) -> Iterator[str]:
    """Yield what an extra requires; extras that it contains are replaced by theirs."""
    for requirement in requirements:
        match = _OF_EXTRA.match(requirement)
        if match is None or (match["extra"] or "") != extra:
            continue
        own = _OWN.match(match["package"])
        if own is None:
            yield match["package"]
            continue
        for contained in own["extras"].split(","):
            yield from _packages(contained, requirements)


def _quoted(argument: str) -> str:
    """Return an argument quoted for a shell; double quotes work in those of Windows, too."""
    return argument if re.fullmatch(r"[\w.-]+", argument) else f'"{argument}"'
