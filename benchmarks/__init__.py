"""The benchmarks of mjbench: classes that declare what is timed or counted, and nothing else.

asv runs them in environments that hold one MuJoCo release each; pytest runs them with the installed
one. Whatever imports this package first checks that the process has the expected release, complete
and unmixed: otherwise its results would be stored under the wrong name.
"""

import re
import sys
from pathlib import Path

# Always the mjbench of this checkout, also where another one is installed.
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from mjbench.releases import install_check


def _expected_release() -> str | None:
    """Return the release that asv checked out for this environment; None outside asv."""
    requirements = Path(sys.prefix) / "project" / "requirements.txt"
    if not requirements.is_file():
        return None
    match = re.search(r"^mujoco==(\S+)", requirements.read_text(), flags=re.MULTILINE)
    return match.group(1) if match else None


_problem = install_check.imported_problem(_expected_release())
if _problem:
    raise RuntimeError(f"not measured: {_problem}")
