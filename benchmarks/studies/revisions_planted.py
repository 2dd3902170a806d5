"""Does `mjbench ab main HEAD …` find what makes a function slower, and nothing where nothing does?

    python -m benchmarks.studies.revisions_planted [--pairs 20] [--json FILE]

plants changes in a scratch repository: 1 % and 5 % more work, a copy in a loop, an import that
moved into a function. Each must be called slower. Then it compares revisions in which comments,
docstrings and empty lines changed; none may be called different. A comparison takes ten seconds,
on an idle machine.

The exit code is 1 if one is missed or falsely called different, and 0 otherwise.
"""

import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.studies import tally_command, tally_file
from mjbench.commands.versions import function_sides, function_verdict
from mjbench.commands.versions.function_sides import RevisionComparison
from mjbench.paired.outcomes import Verdict
from mjbench.paired.records import VerdictRecord, VerdictRow
from mjbench.paired.verdict import VerdictPlan
from mjbench.paired.worker_pool import WorkerPool
from mjbench.releases.revisions import Repository
from mjbench.status import ExitCode

BASE = """
import mujoco


def work(n):
    total = 0
    for i in range(n):
        total += i * i % 7
    return total


def advance(model, data):
    for _ in range(20):
        mujoco.mj_step(model, data)
    work(2000)
    return data.qpos.copy()


def parse(text):
    return sum(int(word) for word in text.split(","))
"""
BENCH = """
import mujoco
import physics

BODIES = "".join(f"<body pos='0 0 {z}'><freejoint/><geom size='.1'/></body>" for z in range(4))
MODEL = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{BODIES}</worldbody></mujoco>")
DATA = mujoco.MjData(MODEL)
TEXT = ",".join(map(str, range(60)))


def setup():
    mujoco.mj_resetData(MODEL, DATA)


def step():
    return physics.advance(MODEL, DATA)


def work():
    return physics.work(5000)


def parse():
    return physics.parse(TEXT)
"""
FUNCTIONS = ("step", "work", "parse")
_MORE_WORK = "    for i in range(n // {}):\n        i * i % 7 + i\n    return total"


@dataclass(frozen=True)
class Case:
    """A revision, and whether its function is slower than in the base.

    Attributes:
      text: of the module; its other functions are as in the base.
    """

    name: str
    function: str
    text: str
    is_slower: bool


@dataclass(frozen=True)
class Result:
    """What a comparison came to, as the JSON file has it."""

    case: str
    is_slower: bool
    verdict: VerdictRow


def planted() -> Iterator[Case]:
    """Yield the revisions that are slower."""
    for name, divisor in (("1 % more work", 100), ("5 % more work", 20)):
        text = BASE.replace("    return total", _MORE_WORK.format(divisor))
        yield Case(name, "work", text, is_slower=True)
    step = "        mujoco.mj_step(model, data)\n"
    text = BASE.replace(step, f"{step}        data.qpos.copy()\n")
    yield Case("a copy in a loop", "step", text, is_slower=True)
    text = BASE.replace("def parse(text):\n", "def parse(text):\n    import json\n")
    yield Case("an import moved into a function", "parse", text, is_slower=True)


def unchanged(count: int) -> Iterator[Case]:
    """Yield revisions with the same code in other files."""
    for number in range(count):
        lines = "\n" * number
        comment = f"    # comment {number}{' and more' * number}\n"
        text = f'"""A docstring."""\n{lines}' + BASE.replace(
            "    total = 0\n", f"{comment}    total = 0\n"
        )
        function = FUNCTIONS[number % len(FUNCTIONS)]
        yield Case(f"another comment, {number + 1}", function, text, is_slower=False)


def decide(pool: WorkerPool, top: Path, number: int, case: Case) -> VerdictRecord:
    """Commit a case after the base; return the verdict on it."""
    _git(top, "checkout", "-q", "-b", f"case{number}", "base")
    (top / "physics.py").write_text(case.text)
    _git(top, "commit", "-q", "-a", "-m", case.name)
    repository = Repository(top)
    baseline, candidate = map(repository.parse, ("base", f"case{number}"))
    function = function_sides.parse_function(f"bench.py::{case.function}", top, top)
    comparison = RevisionComparison(repository, baseline, candidate, [function], top)
    (targets,) = function_sides.check_out(pool, comparison)
    return function_verdict.decide_function(pool, targets, VerdictPlan())


def is_wrong(case: Case, record: VerdictRecord) -> bool:
    """Return whether a planted change was missed, or none was planted and one was named."""
    if case.is_slower:
        return record.verdict != Verdict.SLOWER
    return record.verdict not in (Verdict.SAME, Verdict.INCONCLUSIVE)


def _git(top: Path, *arguments: str) -> None:
    command = ["git", "-c", "user.name=n", "-c", "user.email=e", *arguments]
    subprocess.run(command, cwd=top, check=True, capture_output=True)


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("--pairs", type=int, default=20, help="unchanged revisions")
    parser.add_argument("--json", type=Path, help="file for what was measured")
    options = parser.parse_args(arguments)
    # late: asv imports this module where few packages are
    from mjbench.commands.versions.show import describe_verdict

    results, wrong = list[Result](), 0
    with tempfile.TemporaryDirectory() as folder:
        top = Path(folder).resolve()
        _git(top, "init", "-q", "-b", "base")
        (top / "physics.py").write_text(BASE)
        (top / "bench.py").write_text(BENCH)
        _git(top, "add", "-A")
        _git(top, "commit", "-q", "-m", "base")
        for number, case in enumerate([*planted(), *unchanged(options.pairs)]):
            with WorkerPool() as pool:
                record = decide(pool, top, number, case)
            mark = "WRONG: " if is_wrong(case, record) else ""
            line = describe_verdict(record.row())
            print(f"{mark}{case.name}: {line}; {record.seconds:.0f} s", flush=True)
            wrong += bool(mark)
            results.append(Result(case.name, case.is_slower, record.row()))
    if options.json:
        tally_file.write(options.json, results)
    return ExitCode.FINDING if wrong else ExitCode.OK


if __name__ == "__main__":
    sys.exit(main())
