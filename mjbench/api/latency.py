"""`mjbench.latency`: how long single steps take, and which are late."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjbench.api import argument_values, model_sources, start_states
from mjbench.api.measured import Measured
from mjbench.api.session import Measurement, of_each_model
from mjbench.commands.latency import measure as loop_latency
from mjbench.commands.latency.measure import BUDGET_S, LatencyRequest, LatencyRow, Pace
from mjbench.limits import HERTZ, SECONDS, SEED, TIME_LIMIT_S
from mjbench.simulation.models import ModelSource
from mjbench.simulation.starts import StartPlan

if TYPE_CHECKING:
    from mjbench.api.model_sources import Model
    from mjbench.api.start_states import Actions, States


@dataclass(frozen=True, repr=False, eq=False)
class Latency(Measured):
    """How long single steps of a model take, free-running and paced."""

    @property
    def paces(self) -> tuple[LatencyRow, ...]:
        """A row for each pace."""
        return tuple(self.run.of_type(LatencyRow))

    @property
    def free_running(self) -> LatencyRow:
        """Steps that begin when the one before has ended."""
        return next(row for row in self.paces if row.pace == Pace.FREE)

    @property
    def paced(self) -> LatencyRow:
        """Steps that are due at a fixed rate."""
        return next(row for row in self.paces if row.pace == Pace.PACED)


def latency(
    model: "Model",
    *,
    deadline_s: float | None = None,
    rate_hz: float | None = None,
    nstep: int | None = None,
    budget_s: float = BUDGET_S,
    hold: int = 1,
    seed: int = 0,
    settle_s: float | None = None,
    states: "States | None" = None,
    actions: "Actions | None" = None,
    time_limit_s: float = TIME_LIMIT_S,
    wait: bool = False,
) -> Latency:
    """Return how long single steps take, which miss their deadline, and what slow ones share.

    The same as `mjbench latency`. Steps run in a child process.

    Args:
      model: a name as on the command line, a path, an MjModel or an MjSpec.
      deadline_s: by which a step should end; None for the time between two paced steps, and for
        free-running ones the model's timestep.
      rate_hz: paced steps per second; None for real time.
      nstep: steps at each pace; None for 10,000, or what the budget allows.
      budget_s: time for the steps of each pace, if there are more than 1,000.
      hold: steps for which each control is held.
      seed: of start states and controls.
      settle_s: simulated seconds for which the model moves before the first start state; 0 starts
        at keyframe 0, None stands for 0.1 with a keyframe, and for 5 without.
      states: a file of start states, or arrays by MjData field, as `mjbench.record` returns and
        `mjbench.capture` stores them.
      actions: a file of controls, or an array (ncontrol, nu) or (nsequence, ncontrol, nu), in place
        of random ones.
      time_limit_s: a child process that reports nothing for this long is killed.
      wait: whether to wait until no other mjbench measures on this machine.

    Raises:
      InputError: there is no such model, it cannot be loaded, or an argument is out of its range.
      MachineError: a package is missing, or the process that steps crashed or hung.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """
    deadline_s = argument_values.optional(argument_values.number, "deadline_s", deadline_s, SECONDS)
    rate_hz = argument_values.optional(argument_values.number, "rate_hz", rate_hz, HERTZ)
    nstep = argument_values.optional(argument_values.whole, "nstep", nstep)
    budget_s = argument_values.number("budget_s", budget_s, SECONDS)
    hold, seed = argument_values.whole("hold", hold), argument_values.whole("seed", seed, SEED)
    limit_s = argument_values.number("time_limit_s", time_limit_s, SECONDS)
    with (
        model_sources.sources([model]) as sources,
        start_states.plan(settle_s, states, actions) as starts,
    ):
        work = measurement(
            sources, starts, deadline_s, rate_hz, nstep, budget_s, hold, seed, limit_s
        )
        return Latency.of(work, wait)


def measurement(
    sources: Sequence[ModelSource],
    starts: StartPlan,
    deadline_s: float | None,
    rate_hz: float | None,
    nstep: int | None,
    budget_s: float,
    hold: int,
    seed: int,
    limit_s: float,
) -> Measurement:
    """Return the measurement of single steps of each model, free-running and paced."""

    def measure_model(source: ModelSource) -> list[LatencyRow]:
        request = LatencyRequest(source, nstep, rate_hz, hold, seed, starts, budget_s)
        samples = loop_latency.measure(request, limit_s)
        return [loop_latency.row(source.name, of_pace, deadline_s) for of_pace in samples]

    arguments = {
        "nstep": nstep,
        "budget_s": budget_s,
        "rate_hz": rate_hz,
        "deadline_s": deadline_s,
        "hold": hold,
        "seed": seed,
    }
    return of_each_model("latency", sources, starts, LatencyRow, measure_model, arguments)
