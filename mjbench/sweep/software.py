"""The software that all nodes must have alike, so that their results are of the same thing."""

import functools
import hashlib
import platform
from dataclasses import dataclass, fields
from pathlib import Path

import mjbench
from mjbench.host import machine
from mjbench.simulation import models

# Packages, beside mjbench, whose versions decide what is measured.
_PACKAGES = ("mujoco", "numpy")
_DIGEST_LENGTH = 12


@dataclass(frozen=True)
class Software:
    """Versions of what measures; empty where it is missing.

    Attributes:
      code: digest of the code and data of mjbench, and of the shipped models.
    """

    python: str
    mjbench: str
    code: str
    mujoco: str
    numpy: str


@functools.cache
def installed() -> Software:
    versions = machine.package_versions(_PACKAGES)
    mujoco, numpy = (versions.get(name, "") for name in _PACKAGES)
    return Software(platform.python_version(), mjbench.__version__, _code_digest(), mujoco, numpy)


def difference(here: Software, there: Software) -> str:
    """Return how a node's software differs, in one line; empty if it does not."""
    names = {"python": "Python", "mujoco": "MuJoCo", "numpy": "NumPy"}
    parts = [
        f"{names.get(field.name, field.name)} {getattr(there, field.name) or 'missing'}"
        f" instead of {getattr(here, field.name)}"
        for field in fields(Software)
        if field.name != "code" and getattr(there, field.name) != getattr(here, field.name)
    ]
    if not parts and there.code != here.code:
        parts = [f"other code of mjbench {there.mjbench}: install the same on all nodes"]
    return ", ".join(parts)


def _code_digest() -> str:
    package = Path(mjbench.__file__).parent
    files = [file for suffix in ("py", "json") for file in package.rglob(f"*.{suffix}")]
    contents = {file.relative_to(package).as_posix(): file for file in files}
    contents |= {f"models/{file.name}": file for file in models.shipped_folder().glob("*.xml")}
    digest = hashlib.sha256()
    for name, file in sorted(contents.items()):
        digest.update(f"{name}\0".encode())
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:_DIGEST_LENGTH]
