"""`mjbench.latency`: how long single steps take, and which are late."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjbench.api import checks, model_sources, start_states
from mjbench.api.measured import Measured
from mjbench.api.session import Session
from mjbench.limits import MAX_HERTZ, TIME_LIMIT_S
from mjbench.loop import latency as loop_latency
from mjbench.loop.latency import LatencyRequest, LatencyRow, Pace

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
      nstep: steps at each pace; None for 10,000, or what 10 seconds allow.
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
    limit_s = checks.seconds("time_limit_s", time_limit_s)
    deadline_s = checks.optional(checks.seconds, "deadline_s", deadline_s)
    rate_hz = checks.optional(checks.rate_hz, "rate_hz", rate_hz, MAX_HERTZ)
    nstep = checks.optional(checks.count, "nstep", nstep)
    with (
        model_sources.sources([model]) as (source,),
        start_states.plan(settle_s, states, actions) as starts,
        Session("latency", wait) as session,
    ):
        request = LatencyRequest(
            source, nstep, rate_hz, checks.count("hold", hold), checks.seed("seed", seed), starts
        )
        samples = loop_latency.measure(request, limit_s)
        rows = [loop_latency.row(source.name, of_pace, deadline_s) for of_pace in samples]
        files = [source.path, *starts.files]
        return Latency(session.run(rows, {"models": [source.name]}, files), session.notes())
