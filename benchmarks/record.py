"""What `mjbench.record` costs, compared with a loop written by hand that does the same."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from benchmarks import stored
from benchmarks.settings import Tracked, for_asv
from mjbench.commands.record.recording import Ragged, record
from mjbench.measuring import timing
from mjbench.simulation import workload

MODEL, NSTEP = "humanoid", 200
FIELDS = ["qpos", "qvel", "sensordata"]
# Rounds; a ratio of medians over them is known to about a percent.
ROUNDS = 60


class Record(Tracked):
    """Time of `mjbench.record` divided by that of a loop written by hand; no unit.

    Both record the same three fields of a humanoid over 200 steps; the loop by hand writes them
    into arrays allocated before it.
    """

    @for_asv(unit="record/by hand", pretty_name="mjbench.record over a loop written by hand")
    def track_ratio_to_handwritten(self) -> float:
        """Return the median ratio over rounds in which both take turns; 1 is no overhead."""
        return _ratio(_handwritten, _recorded)


class RecordOneMoment(Tracked):
    """Time of `mjbench.record` with `same_moment`, divided by that without; no unit."""

    params = (["xpos", "sensordata", "qacc"],)
    param_names = ("field",)

    @for_asv(
        unit="one moment/two moments",
        pretty_name="mjbench.record, rows of one moment over those of two",
    )
    def track_ratio_to_two_moments(self, field: str) -> float:
        """Return the median ratio over rounds in which both take turns."""
        mixed, alike = (
            functools.partial(_recorded, fields=["qpos", field], same_moment=each)
            for each in (False, True)
        )
        return _ratio(mixed, alike)


_Recording = Callable[[mujoco.MjModel, mujoco.MjData], Any]


def _ratio(baseline: _Recording, candidate: _Recording) -> float:
    """Return the median ratio of the times of two ways of recording, over rounds."""
    model = stored.load(MODEL)
    data = workload.start_data(model)
    runs = [functools.partial(run, model, data) for run in (baseline, candidate)]
    contenders = [timing.Contender(run) for run in runs]
    # one round more than is used: the first touches all memory
    rounds = list(timing.rounds(contenders, 0.0, 1 + ROUNDS, 1 + ROUNDS))[1:]
    return float(np.median([second / first for first, second in rounds]))


def _handwritten(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, np.ndarray]:
    workload.reset_to_start(model, data)
    qpos, qvel, sensordata = data.qpos, data.qvel, data.sensordata
    log = {
        "qpos": np.empty((NSTEP, model.nq)),
        "qvel": np.empty((NSTEP, model.nv)),
        "sensordata": np.empty((NSTEP, model.nsensordata)),
    }
    rows_qpos, rows_qvel, rows_sensordata = log.values()
    mj_step = mujoco.mj_step
    for i in range(NSTEP):
        mj_step(model, data)
        rows_qpos[i] = qpos
        rows_qvel[i] = qvel
        rows_sensordata[i] = sensordata
    return log


def _recorded(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    fields: Sequence[str] = FIELDS,
    same_moment: bool = False,
) -> dict[str, np.ndarray | Ragged]:
    workload.reset_to_start(model, data)
    return record(model, data, NSTEP, fields, same_moment=same_moment)
