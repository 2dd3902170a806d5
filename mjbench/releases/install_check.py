"""Is the MuJoCo of this process the release meant, whole? Asked by every process that measures."""

import contextlib
import csv
import sys
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path

# The distributions that together make the `mujoco` package (one until 3.17, three from 4.0.0).
DISTRIBUTIONS = ("mujoco", "mujoco-core", "mujoco-studio")


def installed() -> str | None:
    """Return the version of MuJoCo installed in this environment, or None; imports nothing."""
    try:
        return metadata.version("mujoco")
    except metadata.PackageNotFoundError:
        return None


def imported_problem(meant: str | None = None, files: bool = True) -> str | None:
    """Return why the MuJoCo of this process is not the release meant, whole; None if it is.

    A release installed over another, or found beside another on the path, imports without a
    word and mixes the two. Checked are: what the package, the C library and the installer's
    records call it; that nothing else was found on the path; that every module loaded comes
    from its folder; that every file of the release is there, at its size.

    Args:
      meant: the version; by default the one the installer recorded.
      files: whether to look at every file of the release, which takes longest.
    """
    import mujoco

    recorded = installed()
    if recorded is None:
        return "MuJoCo can be imported, but no installer recorded it"
    meant = meant or recorded
    named = {"package": mujoco.__version__, "C library": mujoco.mj_versionString()}
    distributions = list(_distributions())
    named |= {f"distribution {d.metadata['Name']}": d.version for d in distributions}
    wrong = [f"the {what} is {version}" for what, version in named.items() if version != meant]
    if wrong:
        return f"MuJoCo {meant} is meant, but {', '.join(wrong)}"
    folder = Path(mujoco.__file__).resolve().parent
    homes = {Path(p).resolve() for p in mujoco.__path__}
    homes |= {Path(str(d.locate_file("mujoco"))).resolve() for d in distributions}
    if homes != {folder}:
        return f"MuJoCo {meant} is mixed from {', '.join(sorted(map(str, homes)))}"
    return _stray_module(folder) or (_broken_file(distributions) if files else None)


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
        # not by `distribution.files`, which newer versions of importlib rid of missing ones
        record = distribution.read_text("RECORD") or ""
        for name, _, recorded in csv.reader(record.splitlines()):
            if not name.startswith("mujoco/") or not recorded:
                continue
            try:
                size = Path(str(distribution.locate_file(name))).stat().st_size
            except OSError:
                return f"{name} of MuJoCo {distribution.version} is missing"
            if size != int(recorded):
                return f"{name} of MuJoCo {distribution.version} has been changed"
    return None
