"""The commands. No logic lives here: words are parsed, rooms are called, lines are printed.

Exit codes: 0 fine; 1 a finding (paths disagree); 2 bad usage or input; 3 the environment failed
(a crash, a time limit, a full disk); 130 interrupted.
"""

from mjbench.cli import ab, comparing, counting, history, loops, selfcheck, versions
from mjbench.cli.group import cli

__all__ = ["ab", "cli", "comparing", "counting", "history", "loops", "selfcheck", "versions"]
