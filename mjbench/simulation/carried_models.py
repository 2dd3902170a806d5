"""Models that came from another machine, to be measured here under the name that they have there.

The environment variable MJBENCH_CARRIED_MODELS names a file that lists them. It is set where
`mjbench sweep` has nodes of a cluster measure models that lie on the machine of its user.
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path

VARIABLE = "MJBENCH_CARRIED_MODELS"


def write(file: Path, paths: Mapping[str, Path]) -> None:
    """Write the list of models: where each one's file is, by its name."""
    text = json.dumps({name: str(path.absolute()) for name, path in paths.items()})
    file.write_text(text, encoding="utf-8")


def find(name: str) -> Path | None:
    """Return the file of a model that was carried here; None if there is none of this name."""
    listed = os.environ.get(VARIABLE)
    if not listed:
        return None
    try:
        path = json.loads(Path(listed).read_text(encoding="utf-8")).get(name)
    except (OSError, ValueError, AttributeError):
        return None
    return Path(path) if isinstance(path, str) else None
