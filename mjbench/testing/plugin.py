"""The plugin of pytest: it has one fixture, and imports nothing else until a test asks for that."""

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from mjbench.testing.fixture import SpeedFixture


@pytest.fixture
def mjbench(request: pytest.FixtureRequest) -> "SpeedFixture":
    """Compare the speed of functions: `mjbench.not_slower(candidate, baseline)`."""
    from mjbench.testing.fixture import SpeedFixture

    return SpeedFixture(request)
