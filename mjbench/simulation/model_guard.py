"""Has anything changed a model that must stay as it is? A path that does spoils all others."""

from collections.abc import Collection

import mujoco
import numpy as np

from mjbench.errors import MachineError

# Fields that depend on where the files of a model are, the size of all fields together, and the
# mark of the MjSpec that a model was compiled from, which no file holds.
_OF_ORIGIN = (
    *("npaths", "hfield_pathadr", "mesh_pathadr", "skin_pathadr", "tex_pathadr"),
    *("nbuffer", "signature"),
)


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

    def difference_apart_from_paths(self, model: mujoco.MjModel) -> str | None:
        """Return which number of another model differs, wherever the files of both are, or None."""
        return _differing_field(model, self._loaded(), _OF_ORIGIN)

    def _loaded(self) -> mujoco.MjModel:
        files = {"model.mjb": self._original.tobytes()}
        return mujoco.MjModel.from_binary_path("model.mjb", files)


def _differing_field(
    changed: object, original: object, ignored: Collection[str] = ()
) -> str | None:
    for name in dir(original):
        if name.startswith("_") or name in ignored:
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
