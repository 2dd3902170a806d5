"""The physics of an environment as a workload: the same start states, controls and steps, alone.

Each simulation is a run of consecutive steps of the environment, begun from the state that the
environment had, with the controls that it set. Where it writes more than controls between two of
its steps (a mocap pose, an applied force), a run ends there, because the next start state holds
what was written.
"""

import collections
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjbench.environment.recording import Recording, StepTrace
from mjbench.simulation.workload import Workload
from mjbench.units import listed

# Steps of the environment in a simulation, at most; and the share of its steps that shorter
# simulations may not exceed in number, before runs are shortened to keep more of them.
MAX_RUN, MIN_SHARE = 20, 0.9
# Simulations that each thread should have.
_PER_THREAD = 4


@dataclass(frozen=True, eq=False)
class PhysicsAlone:
    """The physics of some steps of an environment.

    Attributes:
      workload: its `nbatch` simulations take `run` steps of the environment each.
      final_state: (nbatch, nstate) states that the environment was in at their ends.
      numbers: (nbatch * run,) of the environment's steps that it covers.
      run: steps of the environment in each simulation.
      holds: whether a control is held for all steps of the engine in a step of the environment;
        otherwise the environment computes another for each.
    """

    workload: Workload
    final_state: np.ndarray
    numbers: np.ndarray
    run: int
    holds: bool


def alone(recording: Recording, seed: int, nthread: int) -> PhysicsAlone | str:
    """Return the physics of a recording; or why a plain loop cannot do it, in one line."""
    if recording.obstacle:
        return f"the environment {recording.obstacle}"
    if recording.difference is not None:
        return "a plain mj_step from the same state does not reach the same state"
    stepped = [trace for trace in recording.steps if trace is not None]
    if not stepped:
        return "the environment never steps the engine"
    written = sorted({name for trace in stepped for name in trace.written})
    if written:
        return f"the environment writes {listed(written)} between steps of the engine"
    counts = collections.Counter(trace.nstep for trace in stepped)
    frame_skip, usual = counts.most_common(1)[0]
    if usual < MIN_SHARE * len(recording.steps):
        least, most = min(counts), max(counts)
        if least == most:
            return f"only {usual} of {len(recording.steps)} of its steps step the engine"
        return f"the environment takes {least} to {most} steps of the engine"
    usable = {
        number: trace
        for number, trace in enumerate(recording.steps)
        if trace is not None
        and trace.nstep == frame_skip
        and trace.version == recording.version
        and trace.is_same_model
    }
    if len(usable) < max(2, _PER_THREAD * nthread // 2):
        fields = ", ".join(dict.fromkeys(change.field for change in recording.changes))
        return f"the environment changes its model ({fields}), so few steps have the same one"
    return _assembled(recording, usable, frame_skip, seed, nthread)


def _assembled(
    recording: Recording,
    usable: dict[int, StepTrace],
    frame_skip: int,
    seed: int,
    nthread: int,
) -> PhysicsAlone:
    """Return the physics of the usable steps of a recording, by their number."""
    runs = _runs(usable)
    length = _run_length([len(run) for run in runs], nthread)
    pieces = [
        run[first : first + length]
        for run in runs
        for first in range(0, len(run) - length + 1, length)
    ]
    holds = all((trace.control == trace.control[0]).all() for trace in usable.values())
    control_rows = slice(0, 1) if holds else slice(None)
    control = np.array(
        [np.concatenate([usable[n].control[control_rows] for n in piece]) for piece in pieces]
    )
    assert recording.model is not None, "it was stepped"
    workload = Workload(
        recording.model,
        np.array([usable[piece[0]].start for piece in pieces]),
        control,
        frame_skip if holds else 1,
        seed,
    )
    return PhysicsAlone(
        workload,
        np.array([usable[piece[-1]].end for piece in pieces]),
        np.array([n for piece in pieces for n in piece]),
        length,
        holds,
    )


def _runs(usable: dict[int, StepTrace]) -> list[list[int]]:
    """Return runs of steps each of which begins in the state that the one before ended in."""
    runs: list[list[int]] = []
    for number, trace in usable.items():
        if runs and trace.follows and not trace.entered and runs[-1][-1] == number - 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return runs


def _run_length(lengths: Sequence[int], nthread: int) -> int:
    """Return the longest run that covers most steps and gives every thread enough simulations."""
    total = sum(lengths)
    longest = 1
    for length in range(1, MAX_RUN + 1):
        count = sum(n // length for n in lengths)
        if count * length >= MIN_SHARE * total and count >= _PER_THREAD * nthread:
            longest = length
    return longest
