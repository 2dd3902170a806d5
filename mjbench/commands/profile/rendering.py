"""How long the rendering of a frame takes, by each backend, in a child process of its own."""

import statistics
import sys
from dataclasses import dataclass

from mjbench.bounds import NonNegativeFloat, PositiveInt
from mjbench.errors import MachineError, one_line
from mjbench.host import isolate
from mjbench.host.isolate import Channel
from mjbench.measuring import timing
from mjbench.simulation.models import ModelSource

# Frames that are timed after one that sets everything up, at least and at most, and seconds for
# them; the size of a frame, in pixels.
LEAST_FRAMES, MOST_FRAMES, BUDGET_S, WIDTH, HEIGHT = 3, 20, 0.5, 640, 480
BACKENDS = ("cgl",) if sys.platform == "darwin" else ("egl", "osmesa")
# The system package that holds each backend's library; that of cgl belongs to macOS.
_PACKAGES = {"egl": "libegl1", "osmesa": "libosmesa6"}


@dataclass(frozen=True)
class FrameTime:
    """The rendering of one frame.

    Attributes:
      backend: `egl` or `osmesa`; on macOS `cgl`.
      seconds: median of scene update and rendering; None where the backend does not work.
      detail: why it does not; empty where it does.
      width: of the frame, in pixels.
      height: of the frame, in pixels.
    """

    backend: str
    seconds: NonNegativeFloat | None
    detail: str = ""
    width: PositiveInt = WIDTH
    height: PositiveInt = HEIGHT


def measure(
    model: ModelSource, backend: str, limit_s: float, budget_s: float = BUDGET_S
) -> FrameTime:
    """Return how long a frame takes; a backend that does not work, crashes or hangs says why."""
    return isolate.call(
        render,
        model,
        backend,
        budget_s,
        limit_s=limit_s,
        # MuJoCo sets the second to the backend that it loads; this process may have loaded another
        environment={"MUJOCO_GL": backend, "PYOPENGL_PLATFORM": None},
        otherwise=lambda ended: FrameTime(backend, None, ended.detail),
    )


def render(source: ModelSource, backend: str, budget_s: float, channel: Channel) -> FrameTime:
    """Time the rendering of a frame; runs in a child whose MUJOCO_GL names the backend."""
    try:  # late: these imports fail where the backend's library is missing
        import mujoco
        from mujoco import gl_context  # noqa: F401
    except Exception as error:
        raise _not_available(backend, error) from error
    from mjbench.simulation import models, workload

    model = models.load(source)
    model.vis.global_.offwidth = max(WIDTH, model.vis.global_.offwidth)
    model.vis.global_.offheight = max(HEIGHT, model.vis.global_.offheight)
    data = workload.start_data(model)
    mujoco.mj_forward(model, data)
    try:
        renderer = mujoco.Renderer(model, HEIGHT, WIDTH)
    except Exception as error:
        raise _not_available(backend, error) from error

    def frame() -> None:
        renderer.update_scene(data)
        renderer.render()

    frame()
    contenders = [timing.Contender(frame)]
    rounds = timing.rounds(contenders, budget_s, LEAST_FRAMES, MOST_FRAMES)
    return FrameTime(backend, statistics.median(seconds for (seconds,) in rounds))


def _not_available(backend: str, error: Exception) -> MachineError:
    package = _PACKAGES.get(backend)
    advice = f"; it needs the system's {package}" if package else ""
    return MachineError(f"{type(error).__name__}: {one_line(error)}{advice}")
