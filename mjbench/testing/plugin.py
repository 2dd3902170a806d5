"""The plugin of pytest: it has one fixture, and imports nothing else until a test asks for that."""

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from mjbench.testing.fixture import SpeedFixture


# Packages of the extra `cli` that are needed.
_PACKAGES = ("numpy", "scipy")


@pytest.fixture
def mjbench(request: pytest.FixtureRequest) -> "SpeedFixture":
    """Compare the speed of functions: `mjbench.not_slower(candidate, baseline)`."""
    from mjbench import extras
    from mjbench.errors import MachineError

    try:
        extras.require("the fixture mjbench", "cli", _PACKAGES)
    except MachineError as error:
        raise pytest.fail.Exception(f"mjbench: {error}", pytrace=False) from None
    from mjbench.testing.fixture import SpeedFixture

    return SpeedFixture(request)
