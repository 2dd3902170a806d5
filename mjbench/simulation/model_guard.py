"""Has anything changed a model that must stay as it is? A path that does spoils all others."""

import mujoco
import numpy as np

from mjbench.errors import MachineError


class ModelGuard:
    """Remembers a model, and says what has changed in it since."""

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        self._buffer = np.empty(mujoco.mj_sizeModel(model), dtype=np.uint8)
        mujoco.mj_saveModel(model, None, self._buffer)
        self._original = self._buffer.copy()

    def change(self) -> str | None:
        """Return which field has changed, such as `opt.timestep`, or None if none has."""
        return self.difference(self._model)

    def check(self, culprit: str = "") -> None:
        if field := self.change():
            raise MachineError(f"{culprit}changes the model, which all paths share: {field}")

    def difference(self, model: mujoco.MjModel) -> str | None:
        """Return which field of another model differs from what was remembered, or None."""
        size = mujoco.mj_sizeModel(model)
        if size == len(self._original):
            mujoco.mj_saveModel(model, None, self._buffer)
            if np.array_equal(self._buffer, self._original):
                return None
        return _differing_field(model, self._loaded()) or "a field without a name"

    def _loaded(self) -> mujoco.MjModel:
        files = {"model.mjb": self._original.tobytes()}
        return mujoco.MjModel.from_binary_path("model.mjb", files)


def _differing_field(changed: object, original: object) -> str | None:
    for name in dir(original):
        if name.startswith("_"):
            continue
        value = getattr(original, name)
        if callable(value):
            continue
        other = getattr(changed, name)
        if name in ("opt", "stat"):
            inner = _differing_field(other, value)
            if inner:
                return f"{name}.{inner}"
        elif isinstance(value, np.ndarray | int | float) and not np.array_equal(
            value, other, equal_nan=np.asarray(value).dtype.kind == "f"
        ):
            return name
    return None
