"""Instructions per step, by function, counted by Callgrind: exact on the noisiest machine.

One process under Callgrind (counted_program.py) steps all models of a release. Callgrind writes its
counts at each call of a marker; what lies between two markers of a model is one pass over its work by a
Python loop: the engine (what `mj_step` called, inclusive) and, outside it, the bindings and Python.
Counts repeat to about 1e-4; a second pass tells for each model. They say what code did, not how
long it took: memory, caches, branches and system calls cost time that no instruction tells.
"""

import contextlib
import json
import re
import shutil
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from mjbench.counts import callgrind, counted_program
from mjbench.errors import MachineError
from mjbench.instrument import child
from mjbench.paired import release_python
from mjbench.paired.preparation import Sizes
from mjbench.releases import installs
from mjbench.simulation.models import ModelSource

MARKER = "mj_version"
ENGINE = "mj_step"
# Simulations and steps of each model. Callgrind runs about fifty times slower than the processor.
NBATCH, NSTEP = 2, 50
HASH_SEED = "0"
# Without these, glibc copies and clears large blocks by one instruction that Callgrind counts once
# for every byte: false steps of 50 %.
_LARGE = 1_000_000_000
TUNABLES = f"glibc.cpu.x86_rep_stosb_threshold={_LARGE}:glibc.cpu.x86_rep_movsb_threshold={_LARGE}"
# Functions of the pipeline that only call others: what they call is told apart by stage.
TRUNK = (
    "mj_step",
    "mj_forward",
    "mj_forwardSkip",
    "mj_fwdKinematics",
    "mj_fwdPosition",
    "mj_fwdVelocity",
    "mj_RungeKutta",
)
STAGES: Mapping[str, str] = {
    "kinematics": r"mj_(kinematics\w*|comPos|camlight|flex|tendon|transmission|updateSleep\w*)$",
    "inertia": r"mj_(crb|makeM|factorM|factorI|tendonArmature)$",
    "collision": r"mj_(collision|broadphase)$",
    "constraint making": r"mj_(makeConstraint|projectConstraint|referenceConstraint|island|"
    r"instantiate\w*|makeImpulse|constructIsland\w*)$",
    "velocity and forces": r"mj_(comVel|passive|rne\w*|fwdActuation|fwdAcceleration|subtreeVel|"
    r"tendonBias|tendonDot|xfrcAccumulate|actuator\w*|fwdVelocity)$",
    "solver": r"mj_(fwdConstraint|solPGS|solCG|solNewton|solNoSlip)$",
    "sensors": r"mj_(sensor\w+|energy\w+)$",
    "integration": r"mj_(Euler\w*|implicit\w*|advance|discrete\w*)$",
    "checks": r"mj_(check\w+)$",
}


@dataclass(frozen=True)
class Function:
    """Instructions of one function, per step."""

    name: str
    self: float
    inclusive: float


@dataclass(frozen=True)
class Count:
    """What one model's steps cost in one release.

    Attributes:
      model: its name.
      release: of MuJoCo.
      status: `ok`, `input`, `crashed` or `timeout`.
      detail: one line; empty when ok.
      instructions_per_step: of the engine, all below `mj_step`.
      outside_per_step: of the bindings, Python, and all else that is not the engine.
      functions: of the engine, the most expensive first.
      stages: instructions per step by stage of the pipeline.
      steps: that were counted.
      work: contacts, constraints, solver iterations per step.
      repeats: by how much a second pass over the same work differed, as a share.
      diverged: simulations that did.
      after: qpos, qvel and act, each (nbatch, size), one step after each start.
      seconds: that counting it and the models beside it took, over their number.
    """

    model: str
    release: str
    status: str = "ok"
    detail: str = ""
    instructions_per_step: float | None = None
    outside_per_step: float | None = None
    functions: Sequence[Function] = ()
    stages: Mapping[str, float] | None = None
    steps: int = 0
    work: Mapping[str, float] | None = None
    repeats: float | None = None
    diverged: int = 0
    after: Mapping[str, Sequence[Sequence[float]]] | None = None
    seconds: float = 0.0


def unavailable() -> str | None:
    """Return why instructions cannot be counted here, in one line, or None if they can."""
    if shutil.which("valgrind"):
        return None
    return "counting instructions needs valgrind: install it, such as by `apt install valgrind`"


class Counter:
    """Counts models, each doing the same work in every release.

    That work is what `give` named, or what the first release to count the model drew. Used as a
    context; it keeps the work in a folder of its own.
    """

    def __init__(self, sizes: Sizes | None = None):
        self.sizes = sizes or Sizes()
        self._works: dict[ModelSource, Path] = {}
        self._closing = contextlib.ExitStack()

    def __enter__(self) -> "Counter":
        problem = unavailable()
        if problem:
            raise MachineError(problem)
        self._folder = self._closing.enter_context(child.scratch())
        return self

    def __exit__(self, *exception: object) -> None:
        self._closing.close()

    def give(self, source: ModelSource, work: Path) -> None:
        """Name the work of a model: the pickle of what `workload.portable` returns."""
        self._works[source] = work

    def count(
        self, release: installs.ReleaseSpec, sources: Sequence[ModelSource], limit_s: float = 600.0
    ) -> list[Count]:
        """Count the instructions of models in one release.

        Args:
          release: of MuJoCo.
          sources: the models.
          limit_s: the process is killed when it counted no model for this long.

        Raises:
          MachineError: valgrind fails.
        """
        entries = [self._entry(source) for source in sources]
        found: list[Count] = []
        begin = time.monotonic()
        while len(found) < len(entries):
            # a model that ends the process costs its own row: another counts the others
            with child.scratch() as folder:
                found += _count(release, entries[len(found) :], folder, limit_s)
        seconds = (time.monotonic() - begin) / max(1, len(found))
        return [replace(count, seconds=seconds) for count in found]

    def _entry(self, source: ModelSource) -> dict[str, Any]:
        work = self._works.setdefault(source, self._folder / f"{len(self._works)}.pickle")
        hold = self.sizes.hold
        return {
            "name": source.name,
            "path": str(source.path),
            "work": str(work),
            "nbatch": self.sizes.nbatch or NBATCH,
            "nstep": self.sizes.nstep or hold * max(1, NSTEP // hold),
            "hold": hold,
            "seed": self.sizes.seed,
        }


def _count(
    release: installs.ReleaseSpec, entries: Sequence[dict[str, Any]], folder: Path, limit_s: float
) -> list[Count]:
    """Count models until one ends the process; its row, the last, says how."""
    request = folder / "request.json"
    request.write_text(json.dumps({"version": release.version, "models": entries}))
    ended = _run(release, folder, request, limit_s)
    answers = [
        json.loads(line) for line in child.text(folder / "answers.jsonl").splitlines() if line
    ]
    counts = [
        _counted(release, answer, [folder / f"callgrind.out.{n}" for n in _dumps(i)])
        for i, answer in enumerate(answers)
    ]
    if len(counts) < len(entries):
        if ended is None:
            raise MachineError("valgrind ended before its work was done")
        counts.append(Count(entries[len(counts)]["name"], release.version, *ended))
    return counts


def _run(
    release: installs.ReleaseSpec, folder: Path, request: Path, limit_s: float
) -> tuple[str, str] | None:
    """Run the program under Callgrind; return how it failed, (status, detail), or None."""
    core = folder / "core"
    core.mkdir()
    release_python.link_mjbench(core)
    options = ["--tool=callgrind", f"--dump-before={MARKER}", "--quiet"]
    options += [f"--callgrind-out-file={folder / 'callgrind.out'}"]
    with installs.use(release) as install, (folder / "said.txt").open("wb") as said:
        program = release_python.command(
            f"from mjbench.counts.counted_program import main; main({str(request)!r})",
            core,
            install,
        )
        environment = release_python.environment(install)
        environment |= {"GLIBC_TUNABLES": TUNABLES, "PYTHONHASHSEED": HASH_SEED}
        environment["TMPDIR"] = str(folder)  # Callgrind's own files end with it
        process = subprocess.Popen(
            ["valgrind", *options, *program],
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=said,
            cwd=folder,
            env=environment,
            start_new_session=True,
            preexec_fn=child.die_with_parent,
        )
        try:
            code = _wait(process, folder / "answers.jsonl", limit_s)
        except subprocess.TimeoutExpired:
            return "timeout", f"no answer within {limit_s:g} s, killed"
        finally:
            child.end_group(process)
    if code == 0:
        return None
    last = child.last_words(child.text(folder / "said.txt"))
    return "crashed", child.cause_of_death(code) + last


def _wait(process: "subprocess.Popen[bytes]", answers: Path, limit_s: float) -> int:
    """Return the exit code of a process that answers for one model after the other.

    Raises:
      subprocess.TimeoutExpired: no answer for `limit_s` seconds.
    """
    answered = ""
    while True:
        try:
            return process.wait(timeout=limit_s)
        except subprocess.TimeoutExpired:
            told = child.text(answers)
            if told == answered:
                raise
            answered = told


def _dumps(number: int) -> range:
    """Return the numbers of the dumps that hold a model's passes; one holds what lies before."""
    first = counted_program.MARKERS * number + 2
    return range(first, first + counted_program.MARKERS - 1)


def _counted(
    release: installs.ReleaseSpec, answer: Mapping[str, Any], dumps: Sequence[Path]
) -> Count:
    if answer["status"] != "ok":
        return Count(answer["name"], release.version, answer["status"], answer["detail"])
    profile, again = (callgrind.parse(child.text(dump)) for dump in dumps)
    steps = answer["steps"]
    engine = profile.inclusive(ENGINE)
    if engine == 0:
        raise MachineError(f"Callgrind saw no {ENGINE} in MuJoCo {release.version}")
    return Count(
        answer["name"],
        release.version,
        instructions_per_step=engine / steps,
        outside_per_step=(profile.total - engine) / steps,
        functions=[
            Function(name, self / steps, inclusive / steps)
            for name, self, inclusive in profile.below(ENGINE)
        ],
        stages={stage: cost / steps for stage, cost in stages(profile).items()},
        steps=steps,
        repeats=abs(again.inclusive(ENGINE) / engine - 1),
        work=answer["work"],
        diverged=answer["diverged"],
        after=answer["after"],
    )


def as_result(count: Count) -> dict[str, Any]:
    """Return what `mjbench instructions --json` gives of one model in one release."""
    told = {key: value for key, value in asdict(count).items() if key != "after"}
    return {**told, "functions": [asdict(function) for function in count.functions]}


def stages(profile: callgrind.CallgrindProfile) -> dict[str, int]:
    """Return instructions of the engine by stage of the pipeline; they sum up to all of it."""
    found = dict.fromkeys(STAGES, 0)
    for (caller, callee), cost in profile.arcs.items():
        if caller in TRUNK and callee not in TRUNK:
            for stage, names in STAGES.items():
                if re.match(names, callee):
                    found[stage] += cost
                    break
    found["other"] = profile.inclusive(ENGINE) - sum(found.values())
    return found
