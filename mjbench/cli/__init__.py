"""The commands, one file each: parse the command line, call one function, print what it returns.

Exit codes: 0 nothing found; 1 a finding (paths disagree); 2 bad usage or input; 3 the environment
failed (a crash, a time limit, a full disk); 130 interrupted (see `mjbench.status`).
"""

from mjbench.cli.group import cli

__all__ = ["cli"]
