"""Draw the workload of a measurement: starts in the model's typical regime, few that diverge."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mjbench.errors import InputError
from mjbench.simulation import given_controls, reference_run, starts, state_file, workload
from mjbench.simulation.given_controls import GivenControls
from mjbench.simulation.reference_run import Observation
from mjbench.simulation.starts import Later, SettleLimit, StartPlan, Starts, Window
from mjbench.simulation.state_file import RecordedStates
from mjbench.simulation.workload import Workload

# Spreads of starts and controls, tried in turn until few simulations diverge.
SPREADS = (1.0, 0.1, 0.01, 0.0)
# The share of simulations that must not diverge.
_LEAST_HEALTHY = 0.25
# Steps that let what sleeps fall asleep again, where they are not to count. MuJoCo puts a tree to
# sleep after mjMINAWAKE (10) steps below the tolerance.
LEAD_IN = 20

# How far a model's run is followed beyond its starts, to see whether it goes on to do other work:
# to this time in simulated seconds, and for this share of the steps of a settling run at most.
LATER_S, LATER_SHARE = 10.0, 1 / 8


@dataclass(frozen=True)
class SampleRequest:
    """The workload that is asked for.

    Attributes:
      nstep: steps of each simulation that count.
      may_shorten: whether simulations may be shorter, where a file has too few controls.
      lead_in: steps before those that count (see `Workload`), a multiple of hold.
      perturbs: whether velocities along a settling run are perturbed, so that simulations differ
        where the model rests. Comparing final states needs that; times are compared without,
        because the noise wakes what sleeps and makes the solver work.
    """

    nbatch: int
    nstep: int
    hold: int = 1
    seed: int = 0
    starts: StartPlan = starts.DEFAULT_STARTS
    max_settling_nstep: int | None = None
    may_shorten: bool = False
    lead_in: int = 0
    perturbs: bool = True

    @property
    def total_nstep(self) -> int:
        return self.lead_in + self.nstep


@dataclass(frozen=True, eq=False)
class _Given:
    states: RecordedStates | None
    controls: GivenControls | None

    @classmethod
    def read(cls, model: mujoco.MjModel, plan: StartPlan) -> "_Given":
        controls_file = plan.controls_file
        return cls(
            None if plan.file is None else state_file.read(plan.file, model),
            None if controls_file is None else given_controls.read(controls_file, model),
        )

    def most_nstep(self, nbatch: int, hold: int) -> int | None:
        """Return how many steps there are controls for; None for any number."""
        if self.controls is not None:
            return self.controls.most_nstep(hold)
        return None if self.states is None else self.states.most_nstep(nbatch, hold)


@dataclass(frozen=True, eq=False)
class Sample:
    """A workload without the simulations that diverge, and its reference run.

    Attributes:
      spread: factor on the noise of starts and controls; below 1 where more would diverge.
    """

    workload: Workload
    observation: Observation
    spread: float
    starts: Starts
    asleep_in_run: float | None = None


def draw(model: mujoco.MjModel, request: SampleRequest) -> Sample:
    """Return the workload with the widest spread of starts at which few simulations diverge."""
    workload.check_sizes(request.nbatch, request.nstep, request.hold)
    given = _Given.read(model, request.starts)
    most_nstep = given.most_nstep(request.nbatch, request.hold) if request.may_shorten else None
    if most_nstep is not None:
        most_nstep = max(request.hold, most_nstep - request.lead_in)
        request = replace(request, nstep=min(request.nstep, most_nstep))
    for best in _candidates(model, request, given):  # one at least
        if best.workload.nbatch >= _LEAST_HEALTHY * request.nbatch:
            break
    if best.workload.nbatch == 0:
        raise InputError(
            f"every simulation diverges ({best.observation.diagnosis()});"
            " there is nothing to compare"
        )
    return replace(best, starts=replace(best.starts, window=_window(best, request)))


def _window(sample: Sample, request: SampleRequest) -> Window:
    observation, model = sample.observation, sample.workload.model
    return Window(
        nstart=sample.workload.nbatch,
        nstep=request.nstep,
        contacts=observation.work.contacts,
        solver_limited=observation.solver_limited,
        asleep=observation.asleep,
        asleep_in_run=sample.asleep_in_run,
        flat_hfields=reference_run.flat_hfields(model),
        later=_later(sample, request) if sample.starts.settle_s else None,
        warnings=observation.other_warnings(),
    )


def _later(sample: Sample, request: SampleRequest) -> Later | None:
    """Return what the model does later in its run; None where that would take too long."""
    model, drawn = sample.workload.model, sample.workload
    timestep, begin_s = float(model.opt.timestep), 2 * sample.starts.settle_s
    nstep = int((LATER_S - begin_s) / timestep)
    if request.max_settling_nstep is not None:
        nstep = min(nstep, int(LATER_SHARE * request.max_settling_nstep))
    if nstep * timestep < begin_s:  # not much later
        return None
    rng, hold = np.random.default_rng([request.seed, 4]), request.hold
    nstep = workload.whole_holds(nstep, hold)
    control = workload.random_controls(model, 1, nstep // hold, hold, rng, sample.spread)
    run = Workload(model, drawn.initial_state[-1:], control, hold, request.seed)
    observation = reference_run.observe(
        replace(run, lead_in=workload.whole_holds(nstep // 2, hold))
    )
    if not observation.healthy.all():
        return None
    return Later(begin_s + nstep * timestep, observation.work.contacts)


def most_nstep(model: mujoco.MjModel, plan: StartPlan, nbatch: int, hold: int) -> int | None:
    """Return a multiple of hold: steps that the files of a plan have controls for; None for any."""
    return _Given.read(model, plan).most_nstep(nbatch, hold)


def settled_step_s(model: mujoco.MjModel) -> float:
    settle_s = starts.settle_s(model, StartPlan())
    nstep = starts.settle_nstep(
        model, settle_s, starts.max_settling_nstep(reference_run.step_s(model))
    )
    settled = starts.settled(model, 1, nstep)
    states = None if settled is None else settled[0]
    return reference_run.step_s(model, None if states is None else states[0])


def _candidates(model: mujoco.MjModel, request: SampleRequest, given: _Given) -> Iterator[Sample]:
    """Yield workloads, the one first that is most like what was asked for."""
    controls = given.controls
    if controls is not None:
        controls.check(request.total_nstep, request.hold)
    if given.states is not None:
        yield from _from_file(model, request, given.states, controls)
        return
    asked_s = starts.settle_s(model, request.starts)
    if asked_s > 0:
        yield from _settled(model, request, asked_s, controls)
    limit = SettleLimit.DIVERGED if asked_s > 0 else None
    origin = Starts(0.0, asked_s, limit, controls_file=_name(controls))
    nbatch, nstep, hold, seed = request.nbatch, request.total_nstep, request.hold, request.seed
    for spread in SPREADS:
        drawn = workload.make(model, nbatch, nstep, hold, seed, spread)
        yield _sample(_controlled(drawn, controls), request.lead_in, spread, origin)


def _settled(
    model: mujoco.MjModel, request: SampleRequest, asked_s: float, controls: GivenControls | None
) -> Iterator[Sample]:
    """Yield workloads that start along a settling run; none where it diverges."""
    nstep = starts.settle_nstep(model, asked_s, request.max_settling_nstep)
    limit = SettleLimit.COST if nstep < starts.settle_nstep(model, asked_s) else None
    settled_s = nstep * float(model.opt.timestep)
    origin = Starts(settled_s, asked_s, limit, controls_file=_name(controls))
    nbatch, hold, seed = request.nbatch, request.hold, request.seed
    for spread in SPREADS:
        settled = starts.settled(model, nbatch, nstep, hold, seed, spread, request.perturbs)
        if settled is not None:
            states, asleep = settled
            drawn = workload.starting(model, states, request.total_nstep, hold, seed, spread)
            yield _sample(_controlled(drawn, controls), request.lead_in, spread, origin, asleep)


def _controlled(drawn: Workload, controls: GivenControls | None) -> Workload:
    if controls is None:
        return drawn
    return replace(drawn, control=controls.of_simulations(drawn.nbatch, drawn.ncontrol))


def _from_file(
    model: mujoco.MjModel,
    request: SampleRequest,
    recorded: RecordedStates,
    controls: GivenControls | None,
) -> Iterator[Sample]:
    header = recorded.header
    # a warm-start is not held: each step leaves one, and mj_forward changes it in some releases
    held = [each for each in header.changed_inputs if each != "qacc_warmstart"] if header else []
    origin = Starts(
        0.0,
        0.0,
        file=recorded.name,
        controls_file=_name(controls) or (recorded.name if recorded.replays else None),
        is_other_model=header is not None and not header.is_of(model),
        held_inputs=tuple(held),
    )
    nbatch, nstep, hold, seed = request.nbatch, request.total_nstep, request.hold, request.seed
    # controls of a file are not scaled
    for spread in SPREADS if origin.controls_file is None else SPREADS[:1]:
        drawn = state_file.draw(model, recorded, nbatch, nstep, hold, seed, spread, controls)
        yield _sample(drawn, request.lead_in, spread, origin)


def _name(controls: GivenControls | None) -> str | None:
    return None if controls is None else controls.name


def _sample(
    drawn: Workload, lead_in: int, spread: float, origin: Starts, asleep: float | None = None
) -> Sample:
    healthy, observation = reference_run.observe_healthy(replace(drawn, lead_in=lead_in))
    return Sample(healthy, observation, spread, origin, asleep)
