"""The wheels of a release that a user names: a wheel of mujoco, or a folder with one.

What pip could not install (another project's wheel, one for another Python, a broken file) is
refused before anything is measured.
"""

import functools
import struct
import zipfile
from dataclasses import dataclass
from pathlib import Path

from packaging import tags
from packaging.tags import Tag
from packaging.utils import InvalidWheelFilename, canonicalize_name, parse_wheel_filename
from packaging.version import Version

from mjbench.errors import InputError, one_line, shown
from mjbench.releases import install_check

_PROJECT = "mujoco"
_PATTERN = f"{_PROJECT}-*.whl"
_SUFFIX = ".whl"
_SOURCE_SUFFIX = ".tar.gz"


@dataclass(frozen=True)
class Wheel:
    """A wheel, as its file name describes it."""

    file: Path
    project: str
    version: Version
    tags: frozenset[Tag]

    @property
    def fits(self) -> bool:
        return not self.tags.isdisjoint(_accepted_tags())


@functools.cache
def _accepted_tags() -> frozenset[Tag]:
    return frozenset(tags.sys_tags())


def names_wheels(text: str) -> bool:
    """Return whether an argument names wheels: a wheel, a source archive, a folder of wheels."""
    if text.endswith((_SUFFIX, _SOURCE_SUFFIX)):
        return True
    return is_folder(text) and bool(_files(Path(text), f"*{_SUFFIX}"))


def find(text: str) -> list[Wheel]:
    """Return the wheels of the release that an argument names, that of mujoco first.

    From 4.0.0 on a release is several wheels, which lie in the same folder.
    """
    wheel = _in_folder(Path(text)) if is_folder(text) else _wheel(text)
    if wheel.project != _PROJECT:
        raise InputError(f"{text} is a wheel of {wheel.project}, expected one of {_PROJECT}")
    _check_fits(text, wheel)
    others = [
        other
        for other in map(wheel_of, _files(wheel.file.parent, f"{_PROJECT}_*{_SUFFIX}"))
        if other is not None
        and other.project in install_check.DISTRIBUTIONS
        and other.version == wheel.version
        and other.fits
    ]
    for part in (wheel, *others):
        _check_content(part.file)
    return [wheel, *others]


def is_folder(text: str) -> bool:
    try:
        return bool(text.strip()) and Path(text).is_dir()
    except (OSError, ValueError):  # its name is too long, or has a NUL
        return False


def _in_folder(folder: Path) -> Wheel:
    wheels = [wheel for wheel in map(wheel_of, _files(folder, _PATTERN)) if wheel is not None]
    if not wheels:
        raise InputError(f"{folder} holds no wheel of mujoco ({_PATTERN})")
    fitting = [wheel for wheel in wheels if wheel.fits]
    if not fitting:
        raise InputError(f"{folder} holds no wheel of mujoco for this Python, {_this_python()}")
    if len(fitting) > 1:
        raise InputError(f"{folder} holds several releases: name one of its wheels")
    return fitting[0]


def named(text: str) -> Wheel:
    """Return the wheel that a file name stands for, of whatever project."""
    wheel = _wheel(text)
    _check_fits(text, wheel)
    _check_content(wheel.file)
    return wheel


def _check_fits(text: str, wheel: Wheel) -> None:
    if not wheel.fits:
        raise InputError(f"{text} is for another Python or platform than this, {_this_python()}")


def _wheel(text: str) -> Wheel:
    path = Path(text)
    try:
        exists = path.is_file()
    except (OSError, ValueError):
        exists = False
    if not exists:
        raise InputError(f"no such wheel: {shown(text)}")
    if text.endswith(_SOURCE_SUFFIX):
        raise InputError(f"{text} is a source archive: name a wheel that was built from it")
    wheel = wheel_of(path)
    if wheel is None:
        raise InputError(
            f"{text}: a wheel is named PROJECT-VERSION-PYTHON-ABI-PLATFORM{_SUFFIX};"
            " give it the name it was built with"
        )
    return wheel


def wheel_of(file: Path) -> Wheel | None:
    """Return what a wheel's file name says; None if it is not named as a wheel."""
    try:
        project, version, _, wheel_tags = parse_wheel_filename(file.name)
    except (InvalidWheelFilename, ValueError):  # ValueError: a number of thousands of digits
        return None
    return Wheel(file, canonicalize_name(project), version, wheel_tags)


def _check_content(wheel: Path) -> None:
    try:
        with zipfile.ZipFile(wheel) as archive:
            names = archive.namelist()
    except OSError as error:
        raise InputError(f"cannot read {wheel}: {error.strerror or error}") from error
    except (zipfile.BadZipFile, NotImplementedError, ValueError, struct.error) as error:
        raise InputError(f"{wheel} is broken: {one_line(error)}; copy it again") from error
    if not any(name.endswith(".dist-info/RECORD") for name in names):
        raise InputError(f"{wheel} is broken: it holds no package; build it again")


def _files(folder: Path, pattern: str) -> list[Path]:
    try:
        return sorted(folder.glob(pattern))
    except OSError as error:
        raise InputError(f"cannot read {folder}: {error.strerror}") from error


def _this_python() -> str:
    """Return the tag of this Python and platform, such as `cp311-cp311-linux_x86_64`."""
    return str(next(tags.sys_tags()))
