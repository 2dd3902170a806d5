"""The pytest fixture `mjbench`: a test fails when a function is certainly slower than another.

pytest loads this package as a plugin; it imports nothing else until a test asks for the fixture.
"""

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from mjbench.testing.fixture import SpeedFixture


@pytest.fixture
def mjbench(request: pytest.FixtureRequest) -> "SpeedFixture":
    """Compare the speed of functions: `mjbench.not_slower(candidate, baseline)`."""
    from mjbench.testing.fixture import SpeedFixture

    return SpeedFixture(request)
