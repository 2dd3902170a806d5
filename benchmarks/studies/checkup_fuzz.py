"""Try generated programs on the check-up.

    python -m benchmarks.studies.checkup_fuzz [--programs 200] [--seed 0]

draws programs at random: what they import, how often they step, on threads or in processes, where
they raise, and how they end. Each runs by itself and in a quick check-up, which must end with the
program's exit code, or 2 where its source is no Python, without an error of mjbench's own.

The exit code is 1 if any does not; those are printed.
"""

import collections
import itertools
import json
import os
import random
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.studies import tally_command

_TIMEOUT_S = 300.0
_BEGIN = """\
import mujoco, os, signal, sys, threading
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
)
data = mujoco.MjData(model)
def steps(count, data=data):
    for i in range(count):
        mujoco.mj_step(model, data)
        if i == {raised}:
            raise ValueError("at step", i)
"""
_BEGINS = (_BEGIN, _BEGIN, _BEGIN, "import os, signal, sys\ndef steps(count):\n    pass\n", "")
_RUNS = (
    "",
    "steps({count})\n",
    "steps({count})\nfor _ in range(3):\n    data = None\n",
    "thread = threading.Thread(target=steps, args=({count},))\nthread.start()\nthread.join()\n",
    "threads = [threading.Thread(target=steps, args=({count}, mujoco.MjData(model)))"
    " for _ in range(3)]\n[each.start() for each in threads]\n[each.join() for each in threads]\n",
    "pid = os.fork()\nsteps({count})\nif not pid:\n    os._exit(4)\nos.waitpid(pid, 0)\n",
    "def again(n):\n    again(n + 1)\nagain(0)\n",
    "try:\n    steps({count})\nexcept ValueError as error:\n    raise KeyError('k') from error\n",
    "import subprocess\nsubprocess.run([sys.executable, '-c', 'import mujoco'])\nsteps({count})\n",
)
_ENDS = (
    "", "", "raise ValueError('no\\x1b[2J\\n robot')\n", "sys.exit()\n", "sys.exit(0)\n",
    "sys.exit(3)\n", "sys.exit(130)\n", "sys.exit('text')\n", "sys.exit(-1)\n", "os._exit(5)\n",
    "os.abort()\n", "os.kill(os.getpid(), signal.SIGKILL)\n", "raise KeyboardInterrupt\n",
    "os.kill(os.getpid(), signal.SIGTERM)\n", "1 / 0\n", "mujoco.mj_step(None, None)\n",
    "class E(Exception):\n    def __str__(self):\n        raise ValueError\nraise E\n",
    "sys.excepthook = None\nraise ValueError\n", "def (:\n", "x = 'open\n", "\x00",
    "import no_such_module\n", "sys.stderr.close()\nraise ValueError\n",
    "def f():\n    raise ValueError\nthreading.Thread(target=f).start()\n",
)  # fmt: skip


def programs(seed: int) -> Iterator[str]:
    """Yield programs without end; the same ones for the same seed."""
    choices = random.Random(seed)
    while True:
        count = choices.choice((0, 1, 2, 500, 20_000, 200_000))
        raised = choices.choice((-1, -1, 0, count // 2))
        parts = (choices.choice(each) for each in (_BEGINS, _RUNS, _ENDS))
        text = "".join(parts)
        yield text.replace("{count}", str(count)).replace("{raised}", str(raised))


def judge(expected: int, code: int, err: str) -> str:
    """Return what is wrong with how a check-up ended; empty if nothing is."""
    if "mjbench: unexpected" in err or "please report it" in err:
        return "an error of mjbench's own"
    if "/mjbench/" in err:
        return "a traceback of mjbench"
    return "" if code == expected else f"exit code {code} in place of {expected}"


def run(text: str) -> tuple[int | None, str]:
    """Return the exit code of a program's check-up, and what is wrong with it.

    The code is None where the check-up ended the program, whose seconds were over.
    """
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "program.py").write_text(text)
        by_itself, _ = _ended(folder, "program.py")
        code, err = _ended(folder, "-m", "mjbench", "program.py", "--quick")
        files = [*Path(folder).glob("results/runs/*.jsonl")]
        records = [json.loads(line) for file in files for line in file.open()]
    if any(record.get("was_ended") for record in records):
        return None, ""
    return code, judge(by_itself if _is_python(text) else 2, code, err)


def _is_python(text: str) -> bool:
    try:
        compile(text, "program.py", "exec")
    except (SyntaxError, ValueError):  # a character that no source has
        return False
    return True


def _ended(folder: str, *arguments: str) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=_TIMEOUT_S,
        check=False,
    )
    code = done.returncode if done.returncode >= 0 else 128 - done.returncode
    return code, done.stderr.decode(errors="replace")


def main() -> int:
    """Check the programs; return the exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("--programs", type=int, default=200, help="programs to try")
    parser.add_argument("--seed", type=int, default=0, help="of the choice of programs")
    options = parser.parse_args()
    codes: collections.Counter[int] = collections.Counter()
    problems = ended = 0
    for text in itertools.islice(programs(options.seed), options.programs):
        code, problem = run(text)
        if code is None:
            ended += 1
        else:
            codes[code] += 1
        if problem:
            problems += 1
            print(f"{problem}:\n{text}", flush=True)
    counts = ", ".join(f"{codes[code]} with exit code {code}" for code in sorted(codes))
    print(f"{options.programs} programs: {counts}, {ended} ended early; {problems} problems")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
