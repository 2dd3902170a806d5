"""What is measured: benchmark classes. They declare; mjbench measures.

asv runs them in an environment that holds one release of MuJoCo, pytest in the one at hand. Each
process that imports this package first makes sure that the MuJoCo in it is the release meant,
whole, and from where it should be: figures of anything else would be kept under a wrong name.
"""

import re
import sys
from pathlib import Path

# mjbench is always the checkout's, also in an environment where another one is installed
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from mjbench.releases import install_check


def _meant() -> str | None:
    """Return the release that asv checked out for this environment; None outside asv."""
    wanted = Path(sys.prefix) / "project" / "requirements.txt"
    if not wanted.is_file():
        return None
    found = re.search(r"^mujoco==(\S+)", wanted.read_text(), flags=re.MULTILINE)
    return found.group(1) if found else None


_problem = install_check.imported_problem(_meant())
if _problem:
    raise RuntimeError(f"not measured: {_problem}")
