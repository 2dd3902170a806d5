"""Options that several commands have, in groups; `mjbench.options` says what becomes of them."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from mjbench.errors import InputError
from mjbench.limits import TIME_LIMIT_S
from mjbench.measuring.budget import AROUND_S, Budget
from mjbench.options import (
    COUNT,
    FLAG,
    SECONDS,
    SECONDS_OR_ZERO,
    SEED,
    THREADS,
    Kind,
    file,
    names_among,
    option,
    text,
)
from mjbench.paired.metrics import Metric

if TYPE_CHECKING:
    from mjbench.paired.run_sizes import Sizes
    from mjbench.simulation.starts import StartPlan

# Where run files are stored unless --results says otherwise.
RESULTS_FOLDER = Path("results/runs")


# The name of a file that a command writes.
OUTPUT_FILE = text("FILE|-")


def output_option(flag: str, form: str) -> Any:
    """Return the option that names the file for a form of the results."""
    return option(
        None, OUTPUT_FILE, f"Write {form} to FILE, or - for stdout.", flag, of_functions=False
    )


@dataclass(frozen=True, kw_only=True)
class JsonOptions:
    """Where the JSON document goes."""

    json_file: str | None = output_option("--json", "results as JSON")


@dataclass(frozen=True, kw_only=True)
class FormOptions(JsonOptions):
    """Where results go in each form."""

    html_file: str | None = output_option("--html", "results as an HTML page")
    markdown_file: str | None = output_option("--markdown", "results as Markdown")
    csv_file: str | None = output_option("--csv", "results as CSV")


def results_option(default: Path | None = RESULTS_FOLDER, unset: str = "") -> Any:
    """Return the option `--results`."""
    return option(default, file("DIR"), "Folder of run files.", unset=unset, of_functions=False)


@dataclass(frozen=True, kw_only=True)
class RunFileOptions:
    """Where the run file lies.

    Attributes:
      wait: whether to wait for others that measure here; None for a command that measures no time.
    """

    results: Path = results_option()
    resume: Path | None = option(
        None,
        file("RUN"),
        "Continue this run file (-1 is the newest): what is finished in it is not measured again."
        " The rest of the command must be as it was.",
        of_functions=False,
    )
    wait: bool | None = option(
        False, FLAG, "Wait until no other mjbench measures on this machine.", is_stored=False
    )


@dataclass(frozen=True, kw_only=True)
class OutputOptions(RunFileOptions, FormOptions):
    """Where results go."""


def time_limit_option(default_s: float) -> Any:
    """Return the option `--time-limit`."""
    help_text = "Kill a process of a model that reports nothing for this long."
    return option(default_s, SECONDS, help_text, is_stored=False)


@dataclass(frozen=True, kw_only=True)
class TimeLimitOptions:
    """How long a child process may be silent."""

    time_limit_s: float = time_limit_option(TIME_LIMIT_S)


@dataclass(frozen=True, kw_only=True)
class LoopStartOptions:
    """Where start states come from; the header of a run file has `starts` instead."""

    settle_s: float | None = option(
        None,
        SECONDS_OR_ZERO,
        "Simulated time for which the model moves before the first start state; 0 starts at"
        " keyframe 0, or at the default pose without one",
        unset="0.1s with a keyframe, 5s without",
        is_stored=False,
    )
    states: Path | None = option(
        None,
        file("FILE.npz", "States", "A path, or a dictionary of arrays."),
        "Draw start states, and their controls if there are any, from this file. `with"
        ' mjbench.capture("states.npz"):` around the loop of your program writes it. Or it has'
        " arrays by MjData field, such as `qpos` (nstate, nq), which it needs, `qvel` (nstate, nv)"
        " and `ctrl` (nstate, nu): `mjbench.record` returns them.",
        is_stored=False,
    )

    @property
    def starts(self) -> "StartPlan":
        """Return the plan of start states and controls; InputError if a file is not there."""
        return self._start_plan(None)

    def _start_plan(self, actions: Path | None) -> "StartPlan":
        from mjbench.simulation.starts import start_plan

        return start_plan(self.settle_s, self.states, actions)


@dataclass(frozen=True, kw_only=True)
class _ActionOptions:
    actions: Path | None = option(
        None,
        file("FILE", "Actions", "A path, or an array."),
        "Take controls from this .npz or .npy file: an array `ctrl` or `actions` of shape"
        " (ncontrol, nu) or (nsequence, ncontrol, nu). Each row is held for the steps of"
        " a control.",
        is_stored=False,
    )


@dataclass(frozen=True, kw_only=True)
class SeedOptions:
    """What random start states and controls follow from."""

    seed: int = option(0, SEED, "Seed of start states and controls.")


@dataclass(frozen=True, kw_only=True)
class StartOptions(SeedOptions, LoopStartOptions, _ActionOptions):
    """Where start states and controls come from."""

    @property
    def starts(self) -> "StartPlan":
        return self._start_plan(self.actions)


def hold_option(default: int | None, unset: str = "") -> Any:
    """Return the option `--hold`."""
    help_text = "Steps for which each control is held: an environment's frame_skip."
    return option(default, COUNT, help_text, unset=unset)


def nstep_option(unset: str, kind: Kind = COUNT, of: str = "of each simulation") -> Any:
    """Return the option `--nstep`."""
    return option(None, kind, f"Steps {of}", unset=unset)


def nbatch_option(unset: str, kind: Kind = COUNT, of: str = "") -> Any:
    """Return the option `--nbatch`; of a kind of lists, each number is measured."""
    return option(None, kind, f"Simulations at once{of}", unset=unset)


@dataclass(frozen=True, kw_only=True)
class WorkOptions(StartOptions):
    """What simulations do."""

    hold: int = hold_option(1)


@dataclass(frozen=True, kw_only=True)
class SizeOptions(WorkOptions):
    """How much work a run is."""

    nbatch: int | None = nbatch_option(
        "as many as take 1 ms, or 10 ms for each of several threads; 2 to count instructions"
    )
    nstep: int | None = nstep_option("up to 100 within that time; 50 to count instructions")
    metric: str = Metric.TIME.value  # of the commands that have this option

    @property
    def sizes(self) -> "Sizes":
        """Return the sizes; InputError where steps are no multiple of `hold`."""
        from mjbench.paired.run_sizes import Sizes

        check_holds(self.nstep, self.hold)
        metric = Metric(self.metric)
        return Sizes(self.nbatch, self.nstep, self.hold, self.seed, self.starts, metric=metric)


def check_holds(nstep: int | None, hold: int, flag: str = "--hold") -> None:
    """Refuse a number of steps that is not a multiple of `hold`, the value of an option."""
    if nstep and nstep % hold:
        raise InputError(f"--nstep {nstep} is not a multiple of {flag} {hold}")


def fail_on_option(findings: Sequence[str], help_text: str) -> Any:
    """Return the option `--fail-on`, whose value is a list of findings."""
    kind = names_among(findings, "FINDING,…")
    help_text = f"Exit 1 for one of these: {', '.join(findings)}. {help_text}"
    return option(None, kind, help_text, "--fail-on", of_functions=False)


_WHOLE = "Time of the whole command"


@dataclass(frozen=True, kw_only=True)
class BudgetOptions:
    """How long a command takes.

    Attributes:
      EACH_S: seconds for each THING that it measures, unless the user says; QUICK_S: with --quick.
      BUDGET_NOTE: what help adds to the text of --budget.
    """

    EACH_S: ClassVar[float]
    QUICK_S: ClassVar[float]
    THING: ClassVar[str] = "model"
    BUDGET_NOTE: ClassVar[str] = ""
    budget_s: float | None = option(
        None,
        SECONDS,
        f"{_WHOLE}, divided among its {{0.THING}}s{{0.BUDGET_NOTE}}",
        unset="{0.EACH_S:g}s for each {0.THING}",
    )
    quick: bool = option(
        False, FLAG, "A first impression, often uncertain: {0.QUICK_S:g}s for each {0.THING}."
    )

    begin_s: float = field(default_factory=time.monotonic, init=False, compare=False, repr=False)

    @property
    def budget(self) -> Budget:
        """Return the time of the command; InputError where it is given twice."""
        if self.quick and self.budget_s is not None:
            raise InputError("--quick is a short --budget: give one of the two")
        spent_s = AROUND_S + time.monotonic() - self.begin_s  # imports take most of it
        each_s = self.QUICK_S if self.quick else self.EACH_S
        return Budget(each_s, self.budget_s, self.THING, spent_s)


@dataclass(frozen=True, kw_only=True)
class WholeBudgetOptions(BudgetOptions):
    """How long a command takes that measures one thing."""

    budget_s: float | None = option(
        None, SECONDS, f"{_WHOLE}{{0.BUDGET_NOTE}}", unset="{0.EACH_S:g}s"
    )
    quick: bool = option(False, FLAG, "A first impression, often uncertain: {0.QUICK_S:g}s.")


def top_option() -> Any:
    """Return the option `--top` of commands that list functions."""
    return option(15, COUNT, "List this many functions.", of_functions=False)


def code_option() -> Any:
    """Return the option `--code`."""
    return option(
        False, FLAG, "Print the Python code of what is advised, to paste.", of_functions=False
    )


def threads_option(of: str = "") -> Any:
    """Return the option `--threads`."""
    return option(None, THREADS, f"Thread counts{of}", unset="1 and usable cores")
