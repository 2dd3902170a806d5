"""Draw the workload of a measurement: starts in the model's typical regime, few that diverge."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mjbench.errors import InputError
from mjbench.simulation import starts, state_file, work, workload
from mjbench.simulation.starts import SettleLimit, StartPlan, Starts
from mjbench.simulation.work import Observation
from mjbench.simulation.workload import Workload

# Spreads of starts and controls, tried in turn until few simulations diverge.
SPREADS = (1.0, 0.1, 0.01, 0.0)
# The share of simulations that must not diverge.
_LEAST_HEALTHY = 0.25


@dataclass(frozen=True)
class SampleRequest:
    """The workload that is asked for.

    Attributes:
      nbatch: simulations.
      nstep: steps of each.
      hold: steps per control.
      seed: of starts and controls.
      starts: where start states are to come from.
      max_settling_nstep: steps of the settling run at most; None for no bound.
    """

    nbatch: int
    nstep: int
    hold: int = 1
    seed: int = 0
    starts: StartPlan = starts.KEYFRAME_STARTS
    max_settling_nstep: int | None = None


@dataclass(frozen=True, eq=False)
class Sample:
    """A workload that was drawn.

    Attributes:
      workload: without diverged simulations.
      observation: its reference run; warnings, and which simulations are healthy, are those of all.
      spread: factor on the noise of starts and controls; below 1 where more would diverge.
      starts: where its start states came from.
    """

    workload: Workload
    observation: Observation
    spread: float
    starts: Starts


def draw(model: mujoco.MjModel, request: SampleRequest) -> Sample:
    """Return the workload with the widest spread of starts at which few simulations diverge.

    A spread is accepted if at least a quarter of the simulations do not diverge. Where none is,
    starts are keyframe 0.

    Raises:
      InputError: every simulation diverges, sizes are impossible, or a file of states is unfit.
    """
    workload.check_sizes(request.nbatch, request.nstep, request.hold)
    best: Sample | None = None
    for candidate in _candidates(model, request):
        best = candidate
        if candidate.workload.nbatch >= _LEAST_HEALTHY * request.nbatch:
            break
    assert best is not None, "starts at keyframe 0 and those of a file are always drawn"
    if best.workload.nbatch == 0:
        raise InputError(
            f"every simulation diverges ({best.observation.diagnosis()});"
            " there is nothing to compare"
        )
    return best


def settled_step_s(model: mujoco.MjModel) -> float:
    """Return about how long one step takes in the model's typical regime, in seconds."""
    settle_s = starts.settle_s(model, StartPlan())
    nstep = starts.settle_nstep(model, settle_s, starts.max_settling_nstep(work.step_s(model)))
    states = starts.settled(model, 1, nstep)
    return work.step_s(model, None if states is None else states[0])


def _candidates(model: mujoco.MjModel, request: SampleRequest) -> Iterator[Sample]:
    """Yield workloads, the one that is most like what was asked for first."""
    if request.starts.file is not None:
        yield from _from_file(model, request)
        return
    asked_s = starts.settle_s(model, request.starts)
    if asked_s > 0:
        yield from _settled(model, request, asked_s)
    limit = SettleLimit.DIVERGED if asked_s > 0 else None
    yield from _over_spreads(
        lambda spread: workload.make(
            model, request.nbatch, request.nstep, request.hold, request.seed, spread
        ),
        Starts(0.0, asked_s, limit),
    )


def _settled(model: mujoco.MjModel, request: SampleRequest, asked_s: float) -> Iterator[Sample]:
    """Yield workloads that start along a settling run; none where it diverges."""
    nstep = starts.settle_nstep(model, asked_s, request.max_settling_nstep)
    limit = SettleLimit.COST if nstep < starts.settle_nstep(model, asked_s) else None
    came_from = Starts(nstep * float(model.opt.timestep), asked_s, limit)

    def make(spread: float) -> Workload | None:
        states = starts.settled(model, request.nbatch, nstep, request.hold, request.seed, spread)
        if states is None:
            return None
        rng = np.random.default_rng([request.seed, 1])
        ncontrol, hold = request.nstep // request.hold, request.hold
        control = workload.random_controls(model, request.nbatch, ncontrol, hold, rng, spread)
        return Workload(model, states, control, hold, request.seed)

    yield from _over_spreads(make, came_from)


def _from_file(model: mujoco.MjModel, request: SampleRequest) -> Iterator[Sample]:
    """Yield workloads that start from the rows of a file."""
    assert request.starts.file is not None
    recorded = state_file.read(request.starts.file, model)
    # controls of the file are replayed as they are
    spreads = SPREADS[:1] if "ctrl" in recorded.fields else SPREADS
    yield from _over_spreads(
        lambda spread: state_file.draw(
            model, recorded, request.nbatch, request.nstep, request.hold, request.seed, spread
        ),
        Starts(0.0, 0.0, file=recorded.name),
        spreads,
    )


def _over_spreads(
    make: Callable[[float], Workload | None],
    came_from: Starts,
    spreads: Sequence[float] = SPREADS,
) -> Iterator[Sample]:
    """Yield what `make` returns for each spread, without the simulations that diverge."""
    for spread in spreads:
        drawn = make(spread)
        if drawn is not None:
            healthy, observation = work.observe_healthy(drawn)
            yield Sample(healthy, observation, spread, came_from)
