"""What the tests of moved libraries share: those of the MuJoCo installed here."""

import platform
import sys

import pytest

from mjbench.releases import movable
from mjbench.releases.moved_install import MovableInstall


@pytest.fixture(scope="session")
def movable_install() -> MovableInstall:
    """Return what moves in the MuJoCo of this environment, read once and kept in the cache."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        pytest.skip("only libraries for Linux on x86-64 are moved")
    return movable.read(movable.site_folder(None))
