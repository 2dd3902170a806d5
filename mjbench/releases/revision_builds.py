"""Revisions of the user's code that have to be built: a wheel each, in the cache folder.

A wheel is never editable, and it is built once for a tree, a Python and a machine. It is installed
beside the MuJoCo of this environment, as a release is. Both are removed as installs of releases
are (see `installs.remove`).
"""

import contextlib
import os
import platform
import shutil
import sys
from pathlib import Path

from mjbench.errors import MachineError
from mjbench.releases import installs, pip, release_names
from mjbench.releases.pip import BuildError
from mjbench.releases.release_names import ReleaseSpec
from mjbench.releases.revisions import Revision


def built(revision: Revision, source: Path, tree: str) -> ReleaseSpec:
    """Return the MuJoCo of this environment with a revision beside it; nothing is installed yet."""
    version = release_names.parse_release(release_names.INSTALLED).version
    wheel = _wheel(revision, source, tree)
    # not the name alone: a branch may be called `installed`
    return ReleaseSpec(f"rev={revision.name}", version, own_wheels=(wheel,))


def _wheel(revision: Revision, source: Path, tree: str) -> Path:
    name = f"wheel-{tree}-{sys.implementation.cache_tag}-{platform.machine()}"
    folder = installs.cache_folder() / name
    with installs.locked(name):
        partial = folder.with_name(f".{name}.partial")
        try:
            if not folder.exists():
                shutil.rmtree(partial, ignore_errors=True)
                partial.mkdir(parents=True)
                pip.build(str(revision), source, partial)
                (partial / installs.MARKER).write_text(f"{revision}\n")
                partial.rename(folder)
            with contextlib.suppress(OSError):  # a cache that may only be read
                os.utime(folder / installs.MARKER)  # when it was used last
            (wheel,) = folder.glob("*.whl")
        except BuildError as error:
            raise BuildError(f"cannot build {revision}: {error}") from error
        except OSError as error:
            raise MachineError(f"cannot write {folder}: {error.strerror}") from error
        except ValueError as error:
            raise BuildError(f"{revision} does not build to one wheel") from error
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    return wheel
