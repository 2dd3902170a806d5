"""A release of MuJoCo, the order of versions, and releases whose steps execute the same.

Only the standard library is imported: benchmarks/stored.py uses this module in every process that
asv starts inside the environment of an old release. `release_names.parse_release` parses
what a user may name as a release.
"""

import re
from dataclasses import dataclass
from datetime import datetime

# The oldest release that mjbench measures.
OLDEST = (2, 3, 7)


@dataclass(frozen=True)
class Release:
    """A release of MuJoCo, and when its first file was uploaded, in whole seconds, UTC."""

    version: str
    uploaded: datetime

    @property
    def tag(self) -> str:
        return f"v{self.version}"


def version_key(version: str) -> tuple[int, ...]:
    """Return the numbers by which versions sort: (3, 2, 0) for `3.2.0rc1` and `3.2.0` alike."""
    return tuple(int(number) for number in re.findall(r"\d+", version)[:3])
