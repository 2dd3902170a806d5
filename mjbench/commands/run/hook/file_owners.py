"""Whose a file of Python is: the user's own, an installed package's, Python's, or mjbench's.

The clocks decide by it which line of a program calls, and the report which lines are the program's.
"""

import os
import re
import sysconfig
from functools import cache

# The package of Python's own modules, and that of mjbench, wherever its folder is.
STANDARD_LIBRARY, MJBENCH = "Python's standard library", "mjbench"
_CLOCKS = os.path.dirname(os.path.realpath(__file__))
_MJBENCH_FOLDER = os.path.dirname(os.path.dirname(os.path.dirname(_CLOCKS)))


def is_own(file: str) -> bool:
    """Return whether a file is the user's own."""
    return not file.startswith("<") and not package_of(file)


def is_of_program(file: str) -> bool:
    """Return whether a file is the user's own, or that of a package that the program uses."""
    return not file.startswith("<") and package_of(file) not in (STANDARD_LIBRARY, MJBENCH)


@cache
def is_of_clocks(file: str) -> bool:
    """Return whether a file is of the clocks, which stand for functions of the engine."""
    return os.path.dirname(os.path.realpath(file)) == _CLOCKS


@cache
def package_of(file: str) -> str:
    """Return the installed package that a file belongs to; nothing for the user's own code."""
    if os.path.realpath(file).startswith(_MJBENCH_FOLDER + os.sep):
        return MJBENCH
    match = re.search(r"/(?:site|dist)-packages/([^/]+)", file)
    if match:
        return match[1].removesuffix(".py")
    return STANDARD_LIBRARY if standard_name(file) else ""


@cache
def standard_name(file: str) -> str:
    """Return a file's name within Python's standard library; nothing for another file."""
    if file.startswith("<frozen"):
        return file
    for folder in _standard_folders():
        if file.startswith(folder) and "site-packages" not in file[len(folder) :]:
            return file[len(folder) :].lstrip("/")
    match = re.search(r"/lib/python3\.\d+/(?!site-packages|dist-packages)(.+)$", file)
    return match[1] if match else ""


@cache
def _standard_folders() -> tuple[str, ...]:
    paths = sysconfig.get_paths()
    folders = {paths["stdlib"], paths["platstdlib"]}
    return tuple(sorted({*folders, *map(os.path.realpath, folders)}))
