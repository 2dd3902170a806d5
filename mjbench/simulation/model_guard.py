"""Has anything changed a model that must stay as it is? A path that does spoils all others."""

import mujoco
import numpy as np


class ModelGuard:
    """Remembers a model, and says what has changed in it since."""

    def __init__(self, model: mujoco.MjModel):
        """Remember `model`."""
        self._model = model
        self._buffer = np.empty(mujoco.mj_sizeModel(model), dtype=np.uint8)
        self._original = self._content().copy()

    def change(self) -> str | None:
        """Return which field has changed, such as `opt.timestep`, or None if none has."""
        if np.array_equal(self._content(), self._original):
            return None
        files = {"model.mjb": self._original.tobytes()}
        original = mujoco.MjModel.from_binary_path("model.mjb", files)
        return _differing_field(self._model, original) or "a field without a name"

    def _content(self) -> np.ndarray:
        """Return the bytes that mj_saveModel writes."""
        mujoco.mj_saveModel(self._model, None, self._buffer)
        return self._buffer


def _differing_field(changed: object, original: object) -> str | None:
    """Return the first attribute that differs; of options and statistics, with its group."""
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
