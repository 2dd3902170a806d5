"""Checks that the MuJoCo of this process is exactly the expected release, with all its files.

Every process that measures a release asks this first. It runs inside the environments of old
releases, so it imports only the standard library and MuJoCo.
"""

import base64
import contextlib
import csv
import hashlib
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from importlib import metadata
from pathlib import Path

# The distributions that together make the `mujoco` package (one until 3.17, three from 4.0.0).
DISTRIBUTIONS = ("mujoco", "mujoco-core", "mujoco-studio")
# What the names of their files begin with.
_FOLDER = "mujoco/"


def installed_version() -> str | None:
    """Return the version of MuJoCo installed in this environment, or None; imports nothing."""
    try:
        return metadata.version("mujoco")
    except metadata.PackageNotFoundError:
        return None


def damaged_file(folder: Path) -> str | None:
    """Return what is wrong with a folder that releases were installed into; None if nothing is.

    Every file that the installer recorded must be there with its size; MuJoCo's files and all
    shared libraries must have the recorded hash, too. That takes 0.2 s for MuJoCo 4.0.0, half as
    long as hashing every file.
    """
    distributions = sorted(folder.glob("*.dist-info"))
    if not any(info.name.startswith("mujoco-") for info in distributions):
        return "MuJoCo is missing"
    for info in distributions:
        try:
            record = (info / "RECORD").read_text(encoding="utf-8")
        except (OSError, ValueError):
            return f"{info.name}/RECORD cannot be read"
        problem = _damaged_file(record, folder)
        if problem:
            return problem
    return None


def changed_file() -> str | None:
    """Return which file of this environment's MuJoCo is not as it was recorded; None if all are."""
    return _changed_file(_distributions(), compare_hashes=True)


def imported_problem(expected: str | None = None) -> str | None:
    """Return why the MuJoCo of this process is not the expected release; None if it is.

    A release installed over another, or next to another on the path, imports without an error
    and mixes the two.
    """
    import mujoco

    recorded = installed_version()
    if recorded is None:
        return "MuJoCo can be imported, but no installer recorded it"
    expected = expected or recorded
    distributions = list(_distributions())
    wrong = _wrong_versions(expected, distributions)
    if wrong:
        return f"expected MuJoCo {expected}, but {', '.join(wrong)}"
    folder = Path(mujoco.__file__).resolve().parent
    folders = {Path(p).resolve() for p in mujoco.__path__}
    folders |= {Path(str(d.locate_file("mujoco"))).resolve() for d in distributions}
    if folders != {folder}:
        return f"MuJoCo {expected} is mixed from {', '.join(sorted(map(str, folders)))}"
    stray = _stray_module(Path(mujoco.__file__).parent)
    if stray:
        return stray
    changed = _changed_file(distributions, compare_hashes=False)
    return f"MuJoCo {expected}: {changed}" if changed else None


def engine_problem(expected: str) -> str | None:
    """Return `imported_problem` for what can change between two processes of one install."""
    wrong = _wrong_engine_versions(expected)
    return f"expected MuJoCo {expected}, but {', '.join(wrong)}" if wrong else None


def _wrong_versions(expected: str, distributions: Sequence[metadata.Distribution]) -> list[str]:
    """Return what says that it is another version, such as `the C library is 2.0.0`."""
    return _wrong_engine_versions(expected) + [
        f"the distribution {each.metadata['Name']} is {each.version}"
        for each in distributions
        if each.version != expected
    ]


def _wrong_engine_versions(expected: str) -> list[str]:
    import mujoco

    # The engine, and the package after it, know only numbers: 4.1.0 also in 4.1.0rc1 and in
    # 4.1.0+g1a2b3c. Which of these it is, the distributions say.
    numbers = re.match(r"[\d.]*\d", expected)
    engine_versions = {"package": mujoco.__version__, "C library": mujoco.mj_versionString()}
    accepted = {expected, numbers[0] if numbers else expected}
    return [
        f"the {name} is {version}"
        for name, version in engine_versions.items()
        if version not in accepted
    ]


def _distributions() -> Iterator[metadata.Distribution]:
    for name in DISTRIBUTIONS:
        with contextlib.suppress(metadata.PackageNotFoundError):
            yield metadata.distribution(name)


def _stray_module(package: Path) -> str | None:
    """Return which module was not loaded from the folder of the package; None if all were."""
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if name.split(".")[0] != "mujoco" or not file:
            continue
        # subfolders of a moved install are links
        if (
            package not in Path(file).parents
            and package.resolve() not in Path(file).resolve().parents
        ):
            return f"module {name} was loaded from {file}, not from {package}"
    return None


def _changed_file(
    distributions: Iterable[metadata.Distribution], compare_hashes: bool
) -> str | None:
    for distribution in distributions:
        # Read directly: `distribution.files` of newer Pythons leaves out missing files.
        record = distribution.read_text("RECORD") or ""
        own = "\n".join(row for row in record.splitlines() if row.startswith(_FOLDER))
        problem = _damaged_file(own, Path(str(distribution.locate_file(""))), compare_hashes)
        if problem:
            return problem
    return None


def _damaged_file(record: str, folder: Path, compare_hashes: bool = True) -> str | None:
    """Return which file of a RECORD's text is not as it was installed; None if all are.

    Of MuJoCo's files and shared libraries, hashes may be compared beside the sizes.
    """
    try:
        # RECORD and compiled Python have no size; pip puts scripts elsewhere than it says (`..`)
        recorded = [
            (name, recorded_hash, int(size))
            for name, recorded_hash, size in filter(None, csv.reader(record.splitlines()))
            if size and not name.startswith("..") and not name.endswith(".pyc")
        ]
    except (ValueError, csv.Error) as error:
        return f"a RECORD is broken: {error}"
    for name, recorded_hash, size_bytes in recorded:
        file = folder / name
        try:
            changed = file.stat().st_size != size_bytes or (
                compare_hashes
                and (name.startswith(_FOLDER) or ".so" in file.suffixes)
                and _hash(file, recorded_hash) != recorded_hash
            )
        except FileNotFoundError:
            return f"{name} is missing"
        except OSError as error:
            return f"{name} cannot be read: {error.strerror}"
        if changed:
            return f"{name} has been changed"
    return None


def _hash(file: Path, like: str) -> str:
    """Return a file's hash as RECORD writes it, such as `sha256=…`; `like` if that is unknown."""
    algorithm = like.partition("=")[0]
    if algorithm not in hashlib.algorithms_guaranteed:
        return like
    with file.open("rb") as stream:
        digest = hashlib.file_digest(stream, algorithm).digest()
    return f"{algorithm}={base64.urlsafe_b64encode(digest).decode().rstrip('=')}"
