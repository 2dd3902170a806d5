"""Does `mjbench run` say what to change first, and how much faster is the program then?

    python -m benchmarks.studies.own_programs [PROGRAM …] [--count N] [--rounds N] [--write]

runs each program of programs/own under `mjbench run`, and compares what it says first with what is
known to be right. Where that saves time, the same program with the change runs beside it, in turns,
without mjbench; the last column is the time of its loop over that of the original's, as the median
of the rounds. With more than five points between the two, or than the interval shown of the first,
or another first advice than expected, the command fails. With `--write`, each program is stored as
soon as it is measured, and the same command continues with those that are not stored.
"""

import math
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.studies import tally_command, tally_file
from benchmarks.studies.page_part import PagePart
from mjbench.host import machine
from mjbench.results import runs
from mjbench.status import ExitCode

FOLDER = Path(__file__).parent / "programs" / "own"
TALLY = Path(__file__).parents[2] / "results/own-programs.json"
PART = PagePart("method/run.md", "own-programs", "benchmarks.studies.own_programs")
# Points by which a predicted time may differ from the one measured.
_MOST_DIFFERENCE = 0.05

Command = Callable[..., object]


@dataclass(frozen=True)
class OwnProgram:
    """A program, and what to change in it first.

    Attributes:
      name: of its file, without the suffix.
      line: what stands on the line that is to be changed.
      says: what the advice says.
      has_change: whether the change is timed; not where the results are wrong, a loop keeps a rate,
        or the change is of the model.
      environment: variables that it needs.
      is_bound: whether what replaces the line takes a time that mjbench cannot know, so that the
        predicted time is the least possible.
    """

    name: str
    line: str
    says: str
    has_change: bool = True
    environment: tuple[tuple[str, str], ...] = ()
    is_bound: bool = False

    @property
    def file(self) -> Path:
        """The program."""
        return FOLDER / f"{self.name}.py"

    @property
    def changed_file(self) -> Path:
        """The program with the change."""
        return FOLDER / f"{self.name}_changed.py"


PROGRAMS = (
    OwnProgram("forward_after_step", "mujoco.mj_forward(model, data)", "mj_kinematics"),
    OwnProgram("planner_copies", "candidate = copy.deepcopy(data)", "one MjData|create one"),
    OwnProgram("model_per_episode", "model = mujoco.MjModel.from_xml_string(REACHER)", "once"),
    OwnProgram("spec_per_episode", "model = scene(i % 5)", "once before the loop", is_bound=True),
    OwnProgram("data_per_episode", "data = mujoco.MjData(model)", "mj_resetData"),
    OwnProgram(
        "renderer_in_loop",
        "renderer = mujoco.Renderer(model, 48, 64)",
        "before the loop",
        environment=(("MUJOCO_GL", "egl"),),
    ),
    OwnProgram("rollout_each_step", "ends, _ = rollout.rollout(", "Rollout"),
    OwnProgram("simulations_in_turn", "mujoco.mj_step(model, data)", "Batch"),
    OwnProgram("small_messages", "qpos = here.recv()", "more work for a message", is_bound=True),
    OwnProgram("contacts_one_by_one", "for contact in data.contact", "arrays of all contacts"),
    OwnProgram("rays_one_by_one", "scan.append(mujoco.mj_ray(", "mj_multiRay"),
    OwnProgram("names_in_step", "data.ctrl[0] = -sum(data.joint", "hoist"),
    OwnProgram("inverse_beside_step", "mujoco.mj_inverse(model, data)", "mj_inverseSkip"),
    OwnProgram("inverse_kinematics", "mujoco.mj_forward(model, data)", "mj_kinematics"),
    OwnProgram("rollout_of_one", "states, _ = rollout.rollout(", "mj_step"),
    OwnProgram("growing_log", "log = np.vstack(", "grow", is_bound=True),
    OwnProgram("rows_in_a_list", "mean = np.array(rows)", "list that grows", is_bound=True),
    OwnProgram("settles_each_episode", "for _ in range(100):", "settle once", is_bound=True),
    OwnProgram("plans_one_by_one", "costs = [score(", "rollout"),
    OwnProgram("perturbed_steps", "for i in range(model.nv)", "mjd_transitionFD"),
    OwnProgram(
        "put_each_episode", "device_model = mjx.put_model(", "put it there once", is_bound=True
    ),
    OwnProgram("many_objects", "", "gc.disable()"),
    OwnProgram("blas_in_workers", "outputs = np.tanh(", "OPENBLAS_NUM_THREADS=1"),
    OwnProgram("long_rollout", "", "A list of"),
    OwnProgram("paced_with_collections", "", "gc.freeze()", has_change=False),
    OwnProgram("small_rk4_steps", "", "RK4", has_change=False),
    OwnProgram("jit_in_loop", "push = jax.jit(", "before the loop"),
    OwnProgram("bare_loop", "", "mj_resetCallbacks"),
    OwnProgram(
        "stored_views", "return {", "every entry will show the last state", has_change=False
    ),
    OwnProgram("halves_of_rk4", "mujoco.mj_step2(model, data)", "Euler", has_change=False),
    OwnProgram("diverged", "mujoco.mj_step(model, data)", "diverged", has_change=False),
    OwnProgram(
        "unfilled_forces", "total += data.cfrc_ext[1, 5]", "mj_rnePostConstraint", has_change=False
    ),
)


@dataclass(frozen=True)
class Advice:
    """What `mjbench run` says first.

    Attributes:
      line: the text of the line; "" for the whole loop.
      text: what to do.
      predicted: time of the loop with the change, over that of today; None where it is not said.
      error: its standard error.
    """

    line: str
    text: str
    predicted: float | None
    error: float = 0.0

    def is_right(self, program: OwnProgram) -> bool:
        """Return whether it is what an expert would say."""
        says = any(part in self.text for part in program.says.split("|"))
        return says and self.line.startswith(program.line)


def advice(program: OwnProgram, count: int, mjbench: Command | None = None) -> Advice:
    """Run a program under `mjbench run`; return what that says first.

    Args:
      mjbench: runs mjbench with arguments; None for a process of its own.
    """
    from mjbench.commands.run import show
    from mjbench.commands.run.remedies import listing
    from mjbench.commands.run.remedies.remedy import Basis
    from mjbench.commands.run.result import ProgramRow
    from mjbench.commands.show import kinds

    def mjbench_process(*arguments: str) -> object:
        return _run([sys.executable, "-m", "mjbench", *arguments], program)

    with tempfile.TemporaryDirectory() as folder:
        run = mjbench or mjbench_process
        run("run", "--seconds", "none", "--results", folder, str(program.file), str(count))
        (file,) = runs.newest_first(Path(folder))
        (row,) = runs.load(file, kinds.RECORD_TYPES).of_type(ProgramRow)
    text = show.conclusion(row)
    listed = row.wrong or (row.loops and show.first_loop(row).remedies)
    first = listing.first(listed or ())
    is_remedy = program.has_change or row.wrong
    if first is None or not is_remedy or first.text not in text:
        return Advice("", text.replace(f"{FOLDER}/", ""), None)
    line = "" if first.place is None else _line(program.file, first.place.line)
    error = first.gain_error if first.basis in (Basis.PAIRED, Basis.RERUN) else None
    return Advice(line, first.text, None if first.gain is None else 1 - first.gain, error or 0.0)


@dataclass(frozen=True)
class MeasuredShare:
    """The time of the changed program's loop over that of the original's.

    Attributes:
      error: the standard error of the median of the rounds, as of a normal distribution.
    """

    median: float
    error: float


def measured(program: OwnProgram, count: int, rounds: int) -> MeasuredShare | None:
    """Run both programs in turns, in fresh processes; None of one without a change."""
    if not program.has_change:
        return None
    ratios = []
    for number in range(rounds):
        files = [program.file, program.changed_file]
        seconds = {file: _loop_s(file, program, count) for file in files[:: 1 - 2 * (number % 2)]}
        ratios.append(seconds[program.changed_file] / seconds[program.file])
    spread = statistics.stdev(ratios) if len(ratios) > 1 else 0.0
    return MeasuredShare(
        statistics.median(ratios), math.sqrt(math.pi / 2) * spread / math.sqrt(len(ratios))
    )


def _loop_s(file: Path, program: OwnProgram, count: int) -> float:
    return float(_run([sys.executable, str(file), str(count)], program).split()[-1])


def _run(command: Sequence[str], program: OwnProgram) -> str:
    environment = {**os.environ, **dict(program.environment)}
    # in a folder of its own: MuJoCo writes a log of warnings into the current one
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            command, env=environment, cwd=folder, capture_output=True, text=True, check=True
        )
    return done.stdout


def _agree(program: OwnProgram, predicted: float, reach: float, after: float) -> bool:
    """Return whether the measured time is within reach of the predicted one."""
    difference = after - predicted
    return difference >= -reach and (program.is_bound or difference <= reach)


def _line(file: Path, number: int) -> str:
    return file.read_text(encoding="utf-8").splitlines()[number - 1].strip()


@dataclass(frozen=True)
class ProgramResult:
    """What `mjbench run` said of a program first, and what that saves.

    Attributes:
      advice: what to do.
      is_right: whether an expert would say so, of the same line.
      predicted, measured: time of the loop with the change, over that without it; None where it is
        not said, or not measured.
      reach: half the width of the interval of the predicted time, which `mjbench run` shows.
      measured_reach: likewise of the measured time, twice its standard error.
      is_near: whether the two are within 0.05, or within the first reach.
    """

    name: str
    advice: str
    is_right: bool
    predicted: float | None
    is_bound: bool
    measured: float | None
    is_near: bool
    reach: float = 0.0
    measured_reach: float = 0.0

    @classmethod
    def of(cls, program: OwnProgram, count: int, rounds: int) -> "ProgramResult":
        """Run a program, and its change."""
        said = advice(program, count)
        share = measured(program, count, rounds)
        after = None if share is None else share.median
        reaches = 2 * said.error, 0.0 if share is None else 2 * share.error
        reach = max(_MOST_DIFFERENCE, reaches[0])
        is_near = (
            said.predicted is None or after is None or _agree(program, said.predicted, reach, after)
        )
        right, predicted, is_bound = said.is_right(program), said.predicted, program.is_bound
        return cls(program.name, said.text, right, predicted, is_bound, after, is_near, *reaches)

    @property
    def is_wide(self) -> bool:
        """Whether the predicted time has an interval wider than it should be."""
        return self.measured is not None and self.reach > _MOST_DIFFERENCE

    @property
    def shares(self) -> str:
        """The predicted and the measured share, as cells of a table."""
        shares = [
            _with_interval(self.predicted, self.reach),
            _with_interval(self.measured, self.measured_reach),
        ]
        shares[0] = f"≥ {shares[0]}" if self.is_bound else shares[0]
        return " | ".join(shares)


@dataclass(frozen=True)
class ProgramTally:
    """All programs, and where they ran."""

    mujoco: str
    cpu: str
    cores: int
    load: float
    rounds: int
    programs: Sequence[ProgramResult]

    def with_result(self, result: ProgramResult) -> "ProgramTally":
        """Return the tally with a program, in place of the earlier result of the same name."""
        results = {each.name: each for each in [*self.programs, result]}
        ordered = [results[each.name] for each in PROGRAMS if each.name in results]
        return replace(self, programs=ordered)

    def lines(self) -> Iterator[str]:
        """Yield what the page of the method has."""
        wrong = [f"`{each.name}`" for each in self.programs if not each.is_right]
        timed = [each for each in self.programs if each.measured is not None]
        predicted = [each for each in timed if not each.is_bound and each.predicted is not None]
        far = [f"`{each.name}`" for each in predicted if not each.is_near]
        bounds = [each.is_near for each in timed if each.is_bound]
        wide = sum(each.is_wide for each in predicted)
        count = len(self.programs)
        yield (
            "The report names the right change and line first for"
            f" {count - len(wrong)} of {count} programs{_named(' (not ', wrong, ')')}. Of"
            f" {len(predicted)} predictions, {len(predicted) - len(far)} are within"
            f" {_MOST_DIFFERENCE} of the measured time or contain it in their interval, which"
            f" {wide} of them have{_named(' (not ', far, ')')}. Of {len(bounds)} bounds,"
            f" {sum(bounds)} hold. (MuJoCo {self.mujoco}, {self.cpu}, {self.cores} cores, with a"
            f" load of up to {self.load:g} at the beginning; {self.rounds} rounds.)"
        )


def _with_interval(share: float | None, reach: float) -> str:
    if share is None:
        return "–"
    if reach <= _MOST_DIFFERENCE:
        return f"{share:.2f}"
    return f"{share:.2f} ({max(0.0, share - reach):.2f}–{share + reach:.2f})"


def _named(before: str, names: Sequence[str], after: str = "") -> str:
    return f"{before}{', '.join(names)}{after}" if names else ""


def measure(programs: Sequence[OwnProgram], count: int, tally: ProgramTally, writes: bool) -> bool:
    """Measure programs, one after the other; return whether all of the tally are as they should be.

    Args:
      writes: whether to store each as soon as it is measured, and the page.
    """
    for program in programs:
        result = ProgramResult.of(program, count, tally.rounds)
        print(f"{result.name} | {result.advice} | {result.shares}", flush=True)
        tally = tally.with_result(result)
        if writes:
            tally_file.write(TALLY, tally)
            PART.write(tally.lines())
    print("\n".join(tally.lines()))
    return all(each.is_right and each.is_near for each in tally.programs)


def main() -> ExitCode:
    """Run the command; return its exit code."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("programs", nargs="*", metavar="PROGRAM")
    parser.add_argument("--count", type=int, default=3000, help="iterations, in their units")
    parser.add_argument("--rounds", type=int, default=9, help="runs with and without the change")
    parser.add_argument("--write", action="store_true", help=f"write {TALLY.name} and the page")
    options = parser.parse_args()
    known = [each.name for each in PROGRAMS]
    if unknown := sorted(set(options.programs) - set(known)):
        parser.error(f"no such program: {', '.join(unknown)}; there are {', '.join(known)}")

    def action() -> ExitCode:
        here = machine.describe()
        tally = ProgramTally(
            here.versions["mujoco"],
            here.cpu,
            here.usable_cores,
            here.load_1min,
            options.rounds,
            [],
        )
        if options.write:
            stored_tally = tally_file.continued(TALLY, tally, "programs")
            tally = replace(stored_tally, load=max(stored_tally.load, tally.load))
        stored = {each.name for each in tally.programs}
        names = options.programs or [name for name in known if name not in stored]
        chosen = [each for each in PROGRAMS if each.name in names]
        are_right = measure(chosen, options.count, tally, options.write)
        return ExitCode.OK if are_right else ExitCode.FINDING

    return tally_command.run("own_programs", action, "the same command with --write continues")


if __name__ == "__main__":
    sys.exit(main())
