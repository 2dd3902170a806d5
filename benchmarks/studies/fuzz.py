"""Try bad input on every command.

    python -m benchmarks.studies.fuzz [--inputs 2000] [--seed 0]

draws command lines at random: every command, its options and arguments, with names, files and
numbers of which most are bad. Each runs in a process of its own. It must end within two minutes,
with one of the exit codes that the README names, and without a traceback or an unforeseen error; it
must write no control character and leave every file that it was given as it was, and nothing in the
folder for temporary files.

The exit code is 1 if any does not; those are printed, each as a line for the shell.
"""

import collections
import concurrent.futures
import hashlib
import itertools
import os
import random
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.studies import tally_command
from mjbench.host import neighbours
from mjbench.simulation import models

if TYPE_CHECKING:
    import click

_TIMEOUT_S = 120.0
_EXIT_CODES = (0, 1, 2, 3)
_GOOD_XML = (
    "<mujoco><worldbody><body><joint type='hinge'/><geom size='.1'/></body></worldbody></mujoco>"
)
# The files that a command line may name, by name; None is a folder.
_FILES: dict[str, bytes | None] = {
    "good.xml": _GOOD_XML.encode(),
    "bad.xml": b"<mujoco><worldbody>",
    "empty.xml": b"",
    "timeless.xml": _GOOD_XML.replace("<mujoco>", "<mujoco><option timestep='0'/>").encode(),
    "binary.mjb": bytes(range(256)),
    "robot.urdf": b"<robot name='r'><link name='a'/></robot>",
    "a\x1b[2Jb.xml": _GOOD_XML.encode(),
    "loop.py": b"while True:\n    mujoco.mj_step(m, d)\n    log.append(d.qpos)\n",
    "bom.py": b"\xef\xbb\xbfx = 1\n",
    "deep.py": b"x = " + b"-" * 50_000 + b"1\n",
    "broken.py": b"def\n",
    "run.jsonl": b'{"type": "run", "schema": 1}\n',
    "torn.jsonl": b'{"type": "ru',
    "mujoco-9.9.9-py3-none-any.whl": b"not a zip",
    "folder": None,
}
_NAMES = (
    *_FILES, "cartpole", "cartpoel", "installed", "main", "0.0.1", "nowhere.xml", "", " ", ".",
    "~nobody-here/a.xml", "numpy:/etc/passwd", "no_such_package:ant", r"C:\robots\a.xml",
    "https://example.org/a.xml", "x" * 5_000, "dangling.xml", "/dev/zero", "-", "--", "\u202e",
    os.fsdecode(b"\xff.xml"), "run.jsonl/x", "*",
)  # fmt: skip
_VALUES = (
    "0", "1", "2", "-1", "nan", "inf", "1e300", "1e-300", "9" * 40, "", " ", "abc", "1,2", ",",
    "1,,2", "1%", "0.5", "200%", "1s", "2min", "soon", "python_loop", "rollout", "rolout", "c",
    "mjx9", "slower", "tea", "pool=new", "pool=", "=", "solver=99", "timestep=0",
    "path=rollout,threads=0", "path=rollout", "bad.xml,solver=cg", "rev=HEAD", "loop.py::f",
    "loop:Path", "broken:Path", "time", "instructions", "\x1b[1m", "missed", "solver",
)  # fmt: skip
_OUTPUTS = ("-", "out.json", "good.xml", "run.jsonl", "loop.py", "folder", "no/such/file", "", "/")
# What keeps a command line that is good by chance short, by option.
SHORT = {
    "--budget": "1s", "--time-limit": "1s", "--nbatch": "2", "--nstep": "4", "--hold": "2",
    "--tick": "2", "--seconds": "1",
}  # fmt: skip
# Options that name a file to write.
OUTPUT_FLAGS = (
    *("--json", "--html", "--markdown", "--csv", "--junit", "--comment", "--github-benchmark"),
    *("--github", "--sarif"),
)
# Options that would wait for another command, take long, or contradict --budget.
NEVER = ("--wait", "--quick")
# Commands and subcommands that reach the network, write into the project or take long.
_LEFT_OUT = {"update", "verify", "install", "remove"}


@dataclass(frozen=True)
class Problem:
    """A command that did not end well: what was wrong, and its arguments."""

    defect: str
    arguments: tuple[str, ...]


def command_lines(seed: int) -> Iterator[tuple[str, ...]]:
    """Yield command lines without end; the same ones for the same seed."""
    from mjbench.cli import cli  # asv imports this module where the command line is missing

    choices = random.Random(seed)
    commands = dict(leaves(cli, ()))
    while True:
        path, command = choices.choice([*commands.items()])
        modes = {words[-1] for words in commands if words[:-1] == path}  # drawn as commands
        options = _options(choices, command, {*NEVER, *modes})
        yield (*path, *options, *_arguments(choices, command))


def leaves(
    group: "click.Group", path: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], "click.Command"]]:
    import click

    for name, command in sorted(group.commands.items()):
        if name in _LEFT_OUT:
            continue
        if isinstance(command, click.Group):
            yield from leaves(command, (*path, name))
        else:
            yield (*path, *name.split()), command


def _options(
    choices: random.Random, command: "click.Command", left_out: Collection[str]
) -> list[str]:
    import click

    arguments: list[str] = []
    for option in command.params:
        if not isinstance(option, click.Option):
            continue
        flag = option.opts[0]
        if flag in left_out:
            continue
        if choices.random() < 0.25:
            if option.is_flag:
                arguments.append(flag)
            else:
                arguments += [flag, _value(choices, flag)]
        elif flag in SHORT:
            arguments += [flag, SHORT[flag]]
    return arguments


def _value(choices: random.Random, flag: str) -> str:
    if flag in OUTPUT_FLAGS:
        return choices.choice(_OUTPUTS)
    return choices.choice(_NAMES if choices.random() < 0.2 else _VALUES)


def _arguments(choices: random.Random, command: "click.Command") -> list[str]:
    import click

    arguments = [p for p in command.params if isinstance(p, click.Argument)]
    count = sum(1 if p.nargs == 1 else choices.randint(1, 3) for p in arguments)
    named = _NAMES if choices.random() < 0.8 else _VALUES
    return [choices.choice(named) for _ in range(count)]


def prepare(folder: Path) -> None:
    """Write the files that command lines name."""
    for name, content in _FILES.items():
        if content is None:
            (folder / name).mkdir()
        else:
            (folder / name).write_bytes(content)
    (folder / "dangling.xml").symlink_to("nowhere")


def digests(folder: Path) -> dict[str, str]:
    """Return a digest of each file that command lines name, by name; of a missing one, nothing."""
    return {
        name: hashlib.sha256((folder / name).read_bytes()).hexdigest()
        if (folder / name).is_file()
        else ""
        for name, content in _FILES.items()
        if content is not None
    }


def judge(code: int, out: str, err: str) -> str:
    """Return what is wrong with how a command ended; empty if nothing is."""
    if code not in _EXIT_CODES:
        return f"exit code {code}"
    if "Traceback" in out + err:
        return "a traceback"
    if "mjbench: unexpected" in err:
        return "an unforeseen error"
    if any(not (c.isprintable() or c == "\n") for c in out + err):
        return "a control character"
    return "" if out + err or code in (0, 1) else f"exit code {code} without a word"


def run(arguments: tuple[str, ...]) -> tuple[int, Problem | None]:
    """Run a command line in a folder of its own; return its exit code, and what was wrong."""
    with tempfile.TemporaryDirectory() as name:
        folder, temporary = Path(name) / "work", Path(name) / "tmp"
        folder.mkdir()
        temporary.mkdir()
        prepare(folder)
        before = digests(folder)
        environment = {
            **os.environ,
            "TMPDIR": str(temporary),
            "HOME": name,
            neighbours.IGNORE_VARIABLE: "1",
            "PYTHONPATH": str(models.shipped_folder().parent),
        }
        try:
            done = subprocess.run(
                [sys.executable, "-m", "mjbench", *arguments],
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=_TIMEOUT_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return -1, Problem(f"no end within {_TIMEOUT_S:g} s", arguments)
        out, err = done.stdout.decode(errors="replace"), done.stderr.decode(errors="replace")
        defect = judge(done.returncode, out, err)
        changed = {name for name, digest in digests(folder).items() if digest != before[name]}
        if not defect and changed - _outputs(arguments):
            defect = f"{', '.join(changed)} has changed"
        leftovers = [path.name for path in temporary.iterdir() if "error" not in path.name]
        if not defect and leftovers:
            defect = f"it left {', '.join(leftovers)}"
        return done.returncode, Problem(defect, arguments) if defect else None


def _outputs(arguments: tuple[str, ...]) -> set[str]:
    """Return the files that a command line may replace: its outputs, unless it reads them."""
    targets = [word for flag, word in itertools.pairwise(arguments) if flag in OUTPUT_FLAGS]
    return {target for target in targets if arguments.count(target) == 1}


def main() -> int:
    """Run the command lines; return the exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("--inputs", type=int, default=2000, help="command lines to try")
    parser.add_argument("--seed", type=int, default=0, help="of the choice of command lines")
    options = parser.parse_args()
    lines = list(itertools.islice(command_lines(options.seed), options.inputs))
    codes: collections.Counter[int] = collections.Counter()
    problems: list[Problem] = []
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for number, (code, problem) in enumerate(pool.map(run, lines), start=1):
            codes[code] += 1
            if problem is not None:
                problems.append(problem)
                print(
                    f"{problem.defect}: mjbench {shlex.join(problem.arguments)[:300]!r}", flush=True
                )
            if number % 100 == 0:
                print(f"{number:6,} inputs, {len(problems)} problems", flush=True)
    counts = ", ".join(f"{codes[code]:,} with exit code {code}" for code in sorted(codes))
    print(f"{len(lines):,} inputs: {counts}; {len(problems)} problems")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
