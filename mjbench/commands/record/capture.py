"""Take states from a running program: `with mjbench.capture("states.npz"):` around what it does.

While the block runs, calls of `mujoco.mj_step` and `mujoco.mj_step2` pass through here, also those
of Gymnasium and dm_control. The program itself does not change: it takes the same steps, to the
last bit, raises the same exceptions and draws the same random numbers. At most `max_states` states
are stored, in windows of `nstep` consecutive steps that are spread evenly over the run (see
`WindowSample`), each with the controls that led to it. docs/formats.md describes the file.
"""

import contextlib
import copy
import dataclasses
import os
import shutil
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

import mujoco
import numpy as np

from mjbench.commands.record.captured_steps import ModelRecorder, RecordedWindow, StepRecorder
from mjbench.errors import InputError, MachineError, MjbenchError, shown, writing, wrong_argument
from mjbench.host import files
from mjbench.simulation import capture_header, engine_functions, state_file
from mjbench.simulation.capture_header import CaptureHeader

# States that are stored, and steps of a window, unless the user says otherwise.
MAX_STATES, WINDOW_NSTEP = 10_000, 100


@dataclass(frozen=True)
class OtherModel:
    """A model that the program stepped, too, and whose states are not in the file."""

    name: str
    steps: int


@dataclass(frozen=True)
class Captured:
    """What `capture` took from a program.

    Attributes:
      file: with the states; None where no step was seen, and so none was written.
      model: name of the model; empty where it has none.
      model_digest: names what decides the cost of the model's steps.
      variants: number of different models, by that digest: above 1 where the program changes it.
      states: in the file.
      windows: pieces of the program's run that they are from.
      steps: that the program took on the model.
      simulated_s: their simulated seconds.
      changed_inputs: MjData fields, other than the controls, that the program sets between steps;
        simulations that start from these states hold them.
      others: models whose states are not in the file.
      model_file: with the compiled model; None unless it was asked for.
      unseen: modules that hold a stepping function of their own, whose calls are not seen.
    """

    file: Path | None
    model: str = ""
    model_digest: str = ""
    variants: int = 0
    states: int = 0
    windows: int = 0
    steps: int = 0
    simulated_s: float = 0.0
    changed_inputs: tuple[str, ...] = ()
    others: tuple[OtherModel, ...] = ()
    model_file: Path | None = None
    unseen: tuple[str, ...] = ()

    def __str__(self) -> str:
        if self.file is None:
            return _why_nothing(self)
        parts = [
            f"{self.states:,} states from {self.windows:,} window{'s' * (self.windows != 1)} of"
            f" {self.steps:,} steps ({self.simulated_s:.6g} s) of {_called(self.model)}"
        ]
        if self.variants > 1:
            parts.append(f"the program changes its model: {self.variants} variants of it")
        if self.changed_inputs:
            parts.append(f"it sets {', '.join(self.changed_inputs)} between steps")
        if self.others:
            others = ", ".join(f"{_called(o.name)} ({o.steps:,} steps)" for o in self.others)
            parts.append(f"left out: {others}")
        return "; ".join(parts)


def _called(model: str) -> str:
    return model or "a model without a name"


def _why_nothing(captured: Captured) -> str:
    if captured.others:
        others = ", ".join(_called(other.name) for other in captured.others)
        return f"no step seen of what was to be captured, but of {others}"
    if captured.unseen:
        return (
            f"no step seen: {', '.join(captured.unseen)} bound a stepping function by `from mujoco"
            " import`, which cannot be captured; call mujoco.mj_step instead"
        )
    return (
        "no step seen: calls of mujoco.mj_step and mj_step2 in this process are seen, but no calls"
        " by a name that was bound before the block, no steps inside rollout, Batch or MJX, and no"
        " steps of other processes"
    )


class Capture(contextlib.ContextDecorator):
    """Takes states from what runs inside it: a context manager, and a decorator.

    The file is written when the block ends, also by an exception or Ctrl-C. Until then an existing
    file stays unchanged. If no step was seen, it is not replaced, and a RuntimeWarning says so.

    Attributes:
      result: what was captured; None before the block has ended.
    """

    def __init__(
        self,
        file: str | os.PathLike[str],
        *,
        model: mujoco.MjModel | None = None,
        data: mujoco.MjData | None = None,
        max_states: int = MAX_STATES,
        nstep: int = WINDOW_NSTEP,
        save_model: str | os.PathLike[str] | None = None,
    ):
        """Prepare to capture.

        Args:
          file: to write, ending in `.npz`; below the folder of the process when the block begins.
          model: whose states to take, and those of models with the same digest; None for the model
            that is stepped most.
          data: whose states to take; None for any MjData of the model.
          max_states: the most states that are stored.
          nstep: steps of a window, and so the most that can be replayed from a state.
          save_model: file for the compiled model, as it was before its first step, ending in
            `.mjb`; None for none. Only this release of MuJoCo can load it.

        Raises:
          InputError: a number is too small, a file ends in something else, or the type is wrong.
        """
        self._file = _ending(file, ".npz", "a file of states")
        self._model_file = None
        if save_model is not None:
            self._model_file = _ending(save_model, ".mjb", "a compiled model")
        if not (model is None or isinstance(model, mujoco.MjModel)):
            raise wrong_argument("model", model, "an MjModel")
        if not (data is None or isinstance(data, mujoco.MjData)):
            raise wrong_argument("data", data, "an MjData")
        _check_at_least("max_states", max_states, 2)
        _check_at_least("nstep", nstep, 1)
        self._model, self._data, self._max_states, self._nstep = model, data, max_states, nstep
        self._block: _Block | None = None
        self.result: Captured | None = None

    def _recreate_cm(self) -> "Capture":
        """Return a new one, for each call of a decorated function."""
        new = copy.copy(self)
        new._block = None
        return new

    def __enter__(self) -> "Capture":
        """Begin to capture.

        Raises:
          InputError: this one captures already.
          MachineError: a file cannot be written.
        """
        if self._block is not None:
            raise InputError("this capture has begun already; make another one")
        model_file = None if self._model_file is None else _writable(self._model_file)
        file = _writable(self._file)
        with_mjb = model_file is not None
        recorder = StepRecorder(self._max_states, self._nstep, self._model, self._data, with_mjb)
        replaced = contextlib.ExitStack()
        replaced.enter_context(engine_functions.replaced(recorder.wrappers()))
        self._block = _Block(file, model_file, recorder, replaced)
        self.result = None
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Put MuJoCo's functions back, and write what was captured.

        A forked child that leaves the block writes nothing, and has no result.

        Raises:
          MachineError: it cannot be written, and no exception is on its way already; otherwise that
            is a RuntimeWarning.
        """
        block, self._block = self._block, None
        assert block is not None, "it was entered"
        block.replaced.close()
        try:
            if os.getpid() != block.pid:
                return
            self.result = block.write()
            for recorded in block.recorder.models()[:1]:
                if recorded.mjb_failure:
                    raise MachineError(f"cannot save {block.model_file}: {recorded.mjb_failure}")
        except MjbenchError as failure:
            if error is None:
                raise
            warnings.warn(f"mjbench.capture: {failure}", RuntimeWarning, stacklevel=2)
        finally:
            block.recorder.close()
        if self.result is not None and self.result.file is None and error is None:
            warnings.warn(f"mjbench.capture: {self.result}", RuntimeWarning, stacklevel=2)


@dataclass(frozen=True)
class _Block:
    file: Path
    model_file: Path | None
    recorder: StepRecorder
    replaced: contextlib.ExitStack
    pid: int = dataclasses.field(default_factory=os.getpid)

    def write(self) -> Captured:
        models = self.recorder.models()
        counts = [(each.name, each.nstep) for each in models]
        others = tuple(OtherModel(*c) for c in (*counts, *self.recorder.other_nstep.items()))
        # bound by `from mujoco import mj_step`
        held = [b for b in engine_functions.bindings() if b.function in engine_functions.STEPPING]
        unseen = tuple(sorted({binding.module.__name__ for binding in held}))
        windows = models[0].windows() if models else []
        segments = [segment for window in windows for segment in window.segments()]
        if not segments:  # no step was seen, or each diverged or raised
            return Captured(None, others=others, unseen=unseen)
        recorded = models[0]
        header = _header(recorded, windows)
        with _replacing(self.file) as stream:
            state_file.write(stream, header, recorded.reader.columns, segments)
        if self.model_file is not None and recorded.mjb is not None:
            recorded.mjb.seek(0)
            with _replacing(self.model_file) as stream:
                shutil.copyfileobj(recorded.mjb, stream)
        return Captured(
            file=self.file,
            model=header.model,
            model_digest=header.digests[0],
            variants=len(header.digests),
            states=sum(len(segment) for segment in segments),
            windows=len(windows),
            steps=recorded.nstep,
            simulated_s=recorded.nstep * recorded.timestep_s,
            changed_inputs=header.changed_inputs,
            others=others[1:],
            model_file=self.model_file if recorded.mjb is not None else None,
            unseen=unseen,
        )


def _header(recorded: ModelRecorder, windows: Sequence[RecordedWindow]) -> CaptureHeader:
    changed = {field for window in windows for field in window.changed_inputs}
    return CaptureHeader(
        format=capture_header.FORMAT,
        model=recorded.name,
        layout=recorded.layout,
        digests=tuple(dict.fromkeys(window.digest for window in windows)),
        mujoco_version=mujoco.__version__,
        timestep_s=recorded.timestep_s,
        steps=recorded.nstep,
        changed_inputs=tuple(sorted(changed)),
    )


def _ending(file: str | os.PathLike[str], ending: str, what: str) -> Path:
    if not isinstance(file, str | os.PathLike):
        raise wrong_argument("file", file, "a path")
    path = Path(file)
    if path.suffix != ending:
        raise InputError(f"{shown(str(path))}: {what} ends in {ending}")
    return path


def _writable(path: Path) -> Path:
    """Return a file's path, absolute as the program may change its folder; else MachineError."""
    file = Path(os.path.realpath(path))
    with writing(file):
        if file.exists():
            file.open("ab").close()  # a folder, or no permission
        files.create_beside(file).unlink()
    return file


@contextlib.contextmanager
def _replacing(file: Path) -> Iterator[BinaryIO]:
    """Yield a stream to what becomes a file when the block ends well."""
    with writing(file), files.replacing(file) as partial, partial.open("wb") as stream:
        yield stream
        stream.flush()


def _check_at_least(name: str, value: int, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise wrong_argument(name, value, f"a whole number of at least {least}")
