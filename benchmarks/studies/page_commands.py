"""Does every command of README and guides run as typed, in a fresh clone?

    python -m benchmarks.studies.page_commands [--limit SECONDS] [PAGE …]

clones this repository, makes a folder with what a reader has (`robot.xml`, `train.py`, a git
repository …), and runs the commands and the Python of each page there, in their order. A command
that runs for longer than the limit is interrupted as by Ctrl-C; it has to end then, without a
traceback. Exit code 1 if a command fails.
"""

import contextlib
import enum
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.studies import tally_command
from mjbench.status import ExitCode

ROOT = Path(__file__).parents[2]
PAGES = ("README.md", *sorted(str(p.relative_to(ROOT)) for p in ROOT.glob("docs/guides/*.md")))
# Commands that cannot run here, by a pattern that they contain, and why.
ELSEWHERE = {
    "^pip (install|wheel)": "changes the environment of whoever runs this",
    "ray start": "starts a cluster that stays",
    "--address auto": "needs a cluster",
    "path/to/your/app": "needs an app",
    r"^make ": "sets up a virtual environment, as the tests of every change do",
    r"^\.venv/": "needs the virtual environment of make",
}
# Exit codes beside 0 that are answers, by what stands in a command.
ANSWERS = {
    "--fail-on": {ExitCode.FINDING, ExitCode.ENVIRONMENT},
    "mjbench lint": {ExitCode.FINDING},
    "mjbench doctor": {ExitCode.FINDING},
}
# A command in the text; words in capitals stand for something else.
_IN_TEXT = re.compile(r"mjbench [a-z]+ (?!.*(\b(?!HEAD\b)[A-Z]{3,}\b|…)).*[.:=\d]")
# Seconds in which a command has to end after Ctrl-C.
_END_S = 60.0


class Kind(enum.StrEnum):
    """What a reader does with an example."""

    COMMAND = "command"
    PROGRAM = "program"
    FILE = "file"


@dataclass(frozen=True)
class Example:
    """A line to type, Python to run, or a file to write.

    Attributes:
      name: of the file, otherwise empty.
    """

    kind: Kind
    text: str
    name: str = ""


class Outcome(enum.StrEnum):
    """How an example ended."""

    RAN = "ran"
    INTERRUPTED = "interrupted at the limit"
    LACKS = "lacks a package"
    ELSEWHERE = "not here"
    FAILED = "failed"


def examples_of(page: str) -> Iterator[Example]:
    """Yield the examples of a page's text in their order.

    Those are blocks of commands, Python and TOML, and commands in the text that name a file or an
    environment: `mjbench releases install` alone is a name.
    """
    parts = re.split(r"^((?:<!-- of [^\n]*\n+)?```\w*\n.*?^```$)", page, flags=re.M | re.S)
    for part in parts:
        if part.startswith("<!-- of "):  # what a command printed
            continue
        if block := re.fullmatch(r"```(\w*)\n(.*?)```", part, flags=re.S):
            yield from _of_block(*block.groups())
        else:
            spans = (span for text in part.split("\n\n") for span in re.findall(r"`([^`]+)`", text))
            commands = (" ".join(span.split()) for span in spans)
            yield from (Example(Kind.COMMAND, each) for each in commands if _IN_TEXT.match(each))


def _of_block(language: str, text: str) -> Iterator[Example]:
    first = text.partition("\n")[0]
    name = first.removeprefix("# ") if re.fullmatch(r"# [\w./]+\.\w+", first) else ""
    if name and language in ("python", "toml"):
        yield Example(Kind.FILE, text, name)
    elif language == "python":
        yield Example(Kind.PROGRAM, text)
    elif not language and not text.startswith("<!--"):
        yield from (Example(Kind.COMMAND, line) for line in text.splitlines())


# -- what a reader has -----------------------------------------------------------------------------

_TRAIN = """import mujoco

model = mujoco.MjModel.from_xml_path("robot.xml")
data = mujoco.MjData(model)
log = []
for _ in range(20_000):
    mujoco.mj_step(model, data)
    log.append(data.qpos)
"""
_ENVIRONMENT = """def make():
    import gymnasium

    return gymnasium.make("HalfCheetah-v5")
"""
_ADVANCE = """import mujoco


def advance(model, data):
    sum(range({count}))
    mujoco.mj_step(model, data, 5)
"""
_SPEED = """import mujoco
from my_package import advance

model = mujoco.MjModel.from_xml_path("robot.xml")
data = mujoco.MjData(model)


def step():
    advance(model, data)
"""


def make_readers_folder(folder: Path) -> None:
    """Write what the pages take for granted: a git repository with models and programs.

    `robot.xml` is Gymnasium's humanoid, whose states one guide records, with a solver and an
    integrator that MJX and Warp compile.
    """
    import gymnasium
    import mujoco
    import numpy as np

    import mjbench

    humanoid = Path(gymnasium.__file__).parent / "envs/mujoco/assets/humanoid.xml"
    robot = humanoid.read_text(encoding="utf-8")
    robot = robot.replace('integrator="RK4"', 'integrator="Euler"').replace('"PGS"', '"Newton"')
    for name in ("robot.xml", "a.xml", "b.xml"):
        (folder / name).write_text(robot, encoding="utf-8")
    for name in ("robots", "package", "my_package"):
        (folder / name).mkdir()
    (folder / "models").symlink_to(ROOT / "models")
    shutil.copy(ROOT / "models/cartpole.xml", folder / "robots/arm.xml")
    shutil.copytree(ROOT / "results/runs", folder / "results/runs")
    guide = (ROOT / "docs/guides/revisions.md").read_text(encoding="utf-8")
    (bench,) = (each.text for each in examples_of(guide) if each.name == "bench.py")
    texts = {
        "train.py": _TRAIN,
        "package/train.py": _TRAIN,
        "my_env.py": _ENVIRONMENT,
        "bench.py": bench,
        "my_package/speed.py": _SPEED,
        ".gitignore": "models\nresults\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    model = mujoco.MjModel.from_xml_path(str(humanoid))
    data = mujoco.MjData(model)
    recorded = mjbench.record(model, data, 500, ["qpos", "qvel", "ctrl"])
    np.savez(folder / "states.npz", **recorded)  # type: ignore[arg-type]
    _git(folder, "init", "--quiet", "--initial-branch", "main")
    for tag, count in {"v1.0": 100, "v1.2": 100, "v1.3": 2000}.items():
        text = _ADVANCE.format(count=count)
        (folder / "my_package/__init__.py").write_text(text, encoding="utf-8")
        _git(folder, "add", "--all")
        _git(folder, "commit", "--quiet", "--allow-empty", "--message", tag)
        _git(folder, "tag", tag)


def _git(folder: Path, *words: str) -> None:
    identity = ("-c", "user.name=reader", "-c", "user.email=reader@example.org")
    subprocess.run(["git", *identity, *words], cwd=folder, check=True)


# -- running ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Readers:
    """A reader's clone and folder, and the variables with which the clone's `mjbench` is found."""

    clone: Path
    folder: Path
    bin: Path

    @classmethod
    def make(cls, parent: Path) -> "Readers":
        """Clone what is committed, and write the reader's files."""
        readers = cls(parent / "clone", parent / "reader", parent / "bin")
        subprocess.run(["git", "clone", "--quiet", "--shared", ROOT, readers.clone], check=True)
        readers.folder.mkdir()
        make_readers_folder(readers.folder)
        readers.bin.mkdir()
        for name, module in {"mjbench": "-m mjbench", "python": ""}.items():
            script = readers.bin / name
            script.write_text(f'#!/bin/sh\nexec "{sys.executable}" {module} "$@"\n')
            script.chmod(0o755)
        return readers

    def variables(self) -> dict[str, str]:
        """Return the environment of a command."""
        path = f"{self.bin}{os.pathsep}{os.environ['PATH']}"
        return {**os.environ, "PATH": path, "PYTHONPATH": str(self.clone)}


def run(line: str, cwd: Path, variables: dict[str, str], limit_s: float) -> tuple[Outcome, str]:
    """Run a line of a shell; return how it ended, and what it printed last."""
    if reason := next((why for part, why in ELSEWHERE.items() if re.search(part, line)), None):
        return Outcome.ELSEWHERE, reason
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen(
            ["bash", "-c", line],
            cwd=cwd,
            env=variables,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        is_interrupted = False
        try:
            code = process.wait(limit_s)
        except subprocess.TimeoutExpired:
            is_interrupted = True
            os.killpg(process.pid, signal.SIGINT)
            try:
                code = process.wait(_END_S)
            except subprocess.TimeoutExpired:
                return Outcome.FAILED, "it did not end after Ctrl-C"
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        output.seek(0)
        printed = output.read()
    return outcome(line, code, printed, is_interrupted), printed[-2000:]


def outcome(line: str, code: int, printed: str, is_interrupted: bool) -> Outcome:
    """Return how a command ended that exited with a code."""
    if is_interrupted:
        has_failed = "Traceback (most recent call last)" in printed and "mjbench" in line
        return Outcome.FAILED if has_failed else Outcome.INTERRUPTED
    if code in (ExitCode.USAGE, ExitCode.ENVIRONMENT) and "pip install" in printed:
        return Outcome.LACKS
    answers = {code for text, codes in ANSWERS.items() if text in line for code in codes}
    return Outcome.RAN if code in {ExitCode.OK, *answers} else Outcome.FAILED


def check(page: str, readers: Readers, limit_s: float) -> bool:
    """Run the examples of a page, print how each ended, and return whether none failed."""
    cwd, variables, is_good = readers.folder, readers.variables(), True
    for example in examples_of((ROOT / page).read_text(encoding="utf-8")):
        if example.kind == Kind.FILE:
            if not (cwd / example.name).exists():
                (cwd / example.name).write_text(example.text, encoding="utf-8")
            continue
        if example.kind == Kind.COMMAND and example.text.startswith("cd "):
            cwd = readers.clone / example.text.removeprefix("cd ")
            continue
        line = example.text
        if example.kind == Kind.PROGRAM:
            (cwd / "example_of_page.py").write_text(example.text, encoding="utf-8")
            line = "python example_of_page.py"
        start = time.monotonic()
        ended, printed = run(line, cwd, variables, limit_s)
        print(f"{page}: {ended}, {time.monotonic() - start:.0f} s: {line}", flush=True)
        if ended == Outcome.FAILED:
            is_good = False
            print(printed, flush=True)
    return is_good


def main(arguments: Sequence[str] | None = None) -> int:
    """Check pages, and return the exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("pages", nargs="*", metavar="PAGE", help="all, if none is named")
    parser.add_argument("--limit", type=float, default=900.0, help="seconds of a command")
    options = parser.parse_args(arguments)
    # a shell starts background jobs with SIGINT ignored, and their commands would inherit that
    signal.signal(signal.SIGINT, signal.default_int_handler)
    is_good = True
    for page in options.pages or PAGES:
        with tempfile.TemporaryDirectory(prefix="mjbench-pages-") as folder:
            is_good &= check(page, Readers.make(Path(folder)), options.limit)
    return ExitCode.OK if is_good else ExitCode.FINDING


if __name__ == "__main__":
    sys.exit(main())
