"""The layers of an environment's step, and which of its functions belongs to which.

A function is known by its name, such as `_get_obs`, or else by what its result is assigned to in
the step, such as `reward = self.score()`.
"""

import re
from collections.abc import Sequence
from enum import StrEnum


class Layer(StrEnum):
    """A part of an environment's step; the time of a layer excludes that of layers inside it."""

    PHYSICS = "physics"
    """`mj_step`, `mj_step1` and `mj_step2`, with their bindings."""
    ENGINE = "other engine calls"
    """Other functions of MuJoCo, such as `mj_forward`."""
    STEPPING = "loop around the engine"
    """Python that calls the engine, `frame_skip` times or once."""
    WRAPPERS = "wrappers"
    """Environments around the environment."""
    ACTION = "action"
    """From the action to controls."""
    OBSERVATION = "observation"
    REWARD = "reward"
    TERMINATION = "termination"
    INFO = "info"
    RENDERING = "rendering"
    REST = "rest of step"
    """The lines of the step itself, and functions that are none of the above."""


# Names of functions, the first that fits; a name that begins with _AFTER is known by its result.
_FUNCTIONS = (
    (Layer.OBSERVATION, re.compile(r"obs|sensor_reading|get_state")),
    (Layer.REWARD, re.compile(r"rew|cost|penalt")),
    (Layer.INFO, re.compile(r"info")),
    (Layer.TERMINATION, re.compile(r"terminat|truncat|done|healthy|success|is_over")),
    (Layer.RENDERING, re.compile(r"render|draw_frame")),
    (Layer.ACTION, re.compile(r"action|ctrl|control|before_step|pre_step")),
    (Layer.STEPPING, re.compile(r"simulat|step|^forward$")),
)
_AFTER = re.compile(r"_*(after|post)_")
# Names of variables.
_RESULTS = (
    (Layer.OBSERVATION, re.compile(r"^_?(ob|obs|observation|observations|state)s?$")),
    (Layer.REWARD, re.compile(r"rew|^r$")),
    (Layer.INFO, re.compile(r"^_?(infos?|extras?)$")),
    (Layer.TERMINATION, re.compile(r"terminat|truncat|done|discount")),
    (Layer.ACTION, re.compile(r"^_?(ctrl|control|action)s?$")),
)


def layer_of(function: str, results: Sequence[str] = ()) -> Layer:
    """Return the layer of a function by its name, or by what its result is assigned to."""
    name = function.lower()
    known = Layer.REST if _AFTER.match(name) else _first(_FUNCTIONS, name)
    if known != Layer.REST:
        return known
    layers = {_first(_RESULTS, result.lower()) for result in results} - {Layer.REST}
    if len(layers) == 1:
        return layers.pop()
    return Layer.INFO if layers else Layer.REST  # several at once: reward, done, info


def _first(table: Sequence[tuple[Layer, re.Pattern[str]]], name: str) -> Layer:
    return next((layer for layer, pattern in table if pattern.search(name)), Layer.REST)
