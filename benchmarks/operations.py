"""The operations around `mj_step` of the history and of asv, each with its model."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from mjbench.paired.operations import (
    Prepare,
    PreparedOperation,
    call_batch,
    call_rollout,
    cast_rays,
    copy_data,
    create_data,
    edit_spec,
    load,
    reset,
)
from mjbench.simulation import models
from mjbench.simulation.models import ModelSource


@dataclass(frozen=True)
class Operation:
    """Something that programs do with a model; a block does it `repeats` times."""

    name: str
    title: str
    model: str
    repeats: int
    prepare: Prepare

    @property
    def source(self) -> ModelSource:
        """The model; one without a name where it builds its own."""
        return models.resolve(self.model) if self.model else ModelSource("", Path())

    def prepared(self) -> PreparedOperation:
        return self.prepare(self.source, self.repeats)


_ALL = (
    Operation("load cartpole", "MjModel.from_xml_path", "cartpole", 1, load),
    Operation("load pile", "MjModel.from_xml_path", "pile", 1, load),
    Operation("spec", "MjSpec: add 500 geoms and compile", "", 500, edit_spec),
    Operation("data cartpole", "MjData(model)", "cartpole", 2, create_data),
    Operation("data pile", "MjData(model)", "pile", 1, create_data),
    Operation("copy pile", "copy.copy(data)", "pile", 1, copy_data),
    Operation("reset cartpole", "mj_resetData", "cartpole", 100, reset),
    Operation("reset pile", "mj_resetData", "pile", 40, reset),
    Operation("rays humanoid", "mj_ray", "humanoid", 500, cast_rays),
    Operation("rays pile", "mj_ray", "pile", 300, cast_rays),
    Operation("rollout cartpole", "rollout, 64 × 5 steps", "cartpole", 64, call_rollout),
    Operation("rollout humanoid", "rollout, 8 × 5 steps", "humanoid", 8, call_rollout),
    Operation("batch cartpole", "Batch.rollout, 64 × 5 steps", "cartpole", 64, call_batch),
    Operation("batch humanoid", "Batch.rollout, 8 × 5 steps", "humanoid", 8, call_batch),
)


def registry() -> Mapping[str, Operation]:
    """Return all operations by name, in the order they are shown."""
    return {operation.name: operation for operation in _ALL}
