"""Checks that the MuJoCo of this process is exactly the expected release, with all its files.

Every process that measures a release asks this first. It runs inside the environments of old
releases, so it imports only the standard library and MuJoCo.
"""

import contextlib
import csv
import re
import sys
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path

# The distributions that together make the `mujoco` package (one until 3.17, three from 4.0.0).
DISTRIBUTIONS = ("mujoco", "mujoco-core", "mujoco-studio")


def installed_version() -> str | None:
    """Return the version of MuJoCo installed in this environment, or None; imports nothing."""
    try:
        return metadata.version("mujoco")
    except metadata.PackageNotFoundError:
        return None


def imported_problem(expected: str | None = None, check_files: bool = True) -> str | None:
    """Return why the MuJoCo of this process is not the expected release; None if it is.

    A release installed over another, or next to another on the path, imports without an error
    and mixes the two. Checked are the versions of the package, of the C library and of the
    installed distributions; that nothing else was found on the path; that every loaded module
    comes from MuJoCo's folder; and that every file of the release is there with its size.

    Args:
      expected: the version; by default the one that the installer recorded.
      check_files: whether to look at every file of the release, which takes longest.
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
    return _stray_module(folder) or (_broken_file(distributions) if check_files else None)


def _wrong_versions(expected: str, distributions: Sequence[metadata.Distribution]) -> list[str]:
    """Return what says that it is another version, such as `the C library is 2.0.0`."""
    import mujoco

    versions = {f"distribution {d.metadata['Name']}": d.version for d in distributions}
    wrong = [
        f"the {name} is {version}" for name, version in versions.items() if version != expected
    ]
    # The engine, and the package after it, know only numbers: 4.1.0 also in 4.1.0rc1 and in
    # 4.1.0+g1a2b3c. Which of these it is, the distributions say.
    numbers = re.match(r"[\d.]*\d", expected)
    engine_versions = {"package": mujoco.__version__, "C library": mujoco.mj_versionString()}
    accepted = {expected, numbers[0] if numbers else expected}
    return [
        f"the {name} is {version}"
        for name, version in engine_versions.items()
        if version not in accepted
    ] + wrong


def _distributions() -> Iterator[metadata.Distribution]:
    for name in DISTRIBUTIONS:
        with contextlib.suppress(metadata.PackageNotFoundError):
            yield metadata.distribution(name)


def _stray_module(folder: Path) -> str | None:
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if name.split(".")[0] == "mujoco" and file and folder not in Path(file).resolve().parents:
            return f"module {name} was loaded from {file}, not from {folder}"
    return None


def _broken_file(distributions: Sequence[metadata.Distribution]) -> str | None:
    for distribution in distributions:
        # Read directly: `distribution.files` of newer Pythons leaves out missing files.
        record = distribution.read_text("RECORD") or ""
        for name, _, recorded_size in csv.reader(record.splitlines()):
            if not name.startswith("mujoco/") or not recorded_size:
                continue
            try:
                size = Path(str(distribution.locate_file(name))).stat().st_size
            except OSError:
                return f"{name} of MuJoCo {distribution.version} is missing"
            if size != int(recorded_size):
                return f"{name} of MuJoCo {distribution.version} has been changed"
    return None
