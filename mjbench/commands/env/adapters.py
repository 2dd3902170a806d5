"""How environments of each framework are reset with a seed, given actions, and read.

An environment's attributes show its framework, not its class, so an environment of the user's own
needs no package: Gymnasium's has `action_space`, dm_control's a method `action_spec`,
robosuite's a pair `action_spec`. How it does
physics is read from its calls of the engine (see `env.recording`).
"""

import random
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from mjbench.commands.env import callees
from mjbench.commands.env.callees import Callee
from mjbench.commands.env.layers import Layer
from mjbench.errors import InputError, one_line
from mjbench.host import machine

# Attributes in which a wrapper holds the environment inside it.
_INNER = ("env", "_env", "environment", "_environment")
_MAX_WRAPPERS = 100
# Seeds of NumPy's older generators have 32 bits.
_SEEDS = 2**32


class EnvironmentAdapter(ABC):
    """An environment, and how mjbench talks to it."""

    framework: ClassVar[str]

    def __init__(self, environment: Any):
        self.environment = environment
        chain = chain_of(environment)
        self.wrappers: Sequence[Any] = chain[:-1]
        self.core = chain[-1]

    @property
    def wrapper_names(self) -> list[str]:
        return [type(wrapper).__name__ for wrapper in self.wrappers]

    def versions(self) -> dict[str, str]:
        classes = [kind for each in (*self.wrappers, self.core) for kind in type(each).__mro__]
        return machine.package_versions(sorted({c.__module__.partition(".")[0] for c in classes}))

    def inner_steps(self) -> list[Callee]:
        chain = [*self.wrappers, self.core]
        return [Callee(each, "step", *self._layer(each)) for each in chain[1:]]

    def outermost_layer(self) -> tuple[Layer, str]:
        return self._layer(self.environment)

    def _layer(self, environment: Any) -> tuple[Layer, str]:
        """Return the layer of the lines of a step, and how they are called.

        Wrappers of one class are numbered, the outermost first.
        """
        name = type(environment).__name__
        if environment is not self.core:
            alike = [each for each in self.wrappers if type(each).__name__ == name]
            number = next(i for i, each in enumerate(alike, 1) if each is environment)
            return Layer.WRAPPERS, f"{name} {number}" if len(alike) > 1 else name
        info = ", with info" if callees.builds_info(environment) else ""
        return Layer.REST, f"lines of {name}.step{info}"

    def resetting(self, seed: int) -> Callable[[], Any]:
        """Return a function that resets the environment to the start that a seed stands for.

        Generators of random numbers, global ones and those that the environment and its task hold,
        are seeded now.
        """
        random.seed(seed)
        np.random.seed(seed % _SEEDS)
        holders = [*self.wrappers, self.core, getattr(self.core, "task", None)]
        for holder in holders:
            for value in list(getattr(holder, "__dict__", {}).values()):
                _seed_generator(value, seed)
        return self._reset_function(seed)

    def _reset_function(self, seed: int) -> Callable[[], Any]:
        reset = self.environment.reset
        return lambda: reset()

    @abstractmethod
    def is_over(self, outcome: Any) -> bool:
        """Return whether an episode ended with an outcome; InputError where no step returns it."""

    @abstractmethod
    def fields(self, outcome: Any) -> Mapping[str, Any]:
        """Return what a step returned by name, without info."""

    @abstractmethod
    def draw_actions(self, count: int, seed: int) -> list[Any]:
        """Return random actions; InputError where it is unknown what an action is."""


class _TupleAdapter(EnvironmentAdapter):
    """Steps that return a tuple: between reward and info are one flag or two."""

    lengths: ClassVar[tuple[int, ...]]

    def is_over(self, outcome: Any) -> bool:
        if not isinstance(outcome, tuple) or len(outcome) not in self.lengths:
            expected = " or ".join(map(str, self.lengths))
            raise InputError(f"its step returned {_described(outcome)}, not {expected} values")
        return any(bool(flag) for flag in outcome[2:-1])

    def fields(self, outcome: Any) -> Mapping[str, Any]:
        flags = ("terminated", "truncated") if len(outcome) == 5 else ("done",)
        return dict(zip(("observation", "reward", *flags), outcome[:-1], strict=True))


class GymnasiumAdapter(_TupleAdapter):
    """Gymnasium, Gym, and what has their interface: `action_space`, and steps of four or five."""

    framework = "Gymnasium"
    lengths = (4, 5)

    def _reset_function(self, seed: int) -> Callable[[], Any]:
        reset = self.environment.reset
        if _accepts(reset, "seed"):
            return lambda: reset(seed=seed)
        set_seed = getattr(self.environment, "seed", None)
        if callable(set_seed):
            set_seed(seed)
        return lambda: reset()

    def draw_actions(self, count: int, seed: int) -> list[Any]:
        space = self.environment.action_space
        if callable(getattr(space, "sample", None)):
            if callable(getattr(space, "seed", None)):
                space.seed(seed)
            return [space.sample() for _ in range(count)]
        low, high = getattr(space, "low", None), getattr(space, "high", None)
        if low is None or high is None:
            raise InputError("its action_space has neither sample() nor low and high")
        return draw_uniform(low, high, count, seed, getattr(space, "dtype", None))


class DmControlAdapter(EnvironmentAdapter):
    """dm_control, and what has dm_env's interface: `action_spec()`, and steps with `last()`."""

    framework = "dm_control"

    def is_over(self, outcome: Any) -> bool:
        if not callable(getattr(outcome, "last", None)):
            raise InputError(f"its step returned {_described(outcome)}, not a dm_env.TimeStep")
        return bool(outcome.last())

    def fields(self, outcome: Any) -> Mapping[str, Any]:
        names = ("observation", "reward", "discount", "step_type")
        return {name: getattr(outcome, name, None) for name in names}

    def draw_actions(self, count: int, seed: int) -> list[Any]:
        spec = self.environment.action_spec()
        low, high = getattr(spec, "minimum", None), getattr(spec, "maximum", None)
        shape = getattr(spec, "shape", None)
        if low is None or high is None or shape is None:
            raise InputError("its action_spec() has no minimum, maximum and shape")
        low, high = np.broadcast_to(low, shape), np.broadcast_to(high, shape)
        return draw_uniform(low, high, count, seed, getattr(spec, "dtype", None))


class RobosuiteAdapter(_TupleAdapter):
    """robosuite: `action_spec` is a pair of bounds, and a step returns four values."""

    framework = "robosuite"
    lengths = (4,)

    def draw_actions(self, count: int, seed: int) -> list[Any]:
        low, high = self.environment.action_spec
        return draw_uniform(low, high, count, seed)


def adapt(environment: Any) -> EnvironmentAdapter:
    """Return the adapter of an environment; InputError if it is none, or without actions."""
    kind = type(environment).__name__
    for name in ("reset", "step"):
        if not callable(getattr(environment, name, None)):
            raise InputError(f"{kind} is no environment: it has no {name}()")
    if getattr(environment, "num_envs", None) is not None and hasattr(
        environment, "single_action_space"
    ):
        raise InputError(f"{kind} is several environments; give a factory that returns one")
    if getattr(environment, "action_space", None) is not None:
        return GymnasiumAdapter(environment)
    spec = getattr(environment, "action_spec", None)
    if callable(spec):
        return DmControlAdapter(environment)
    if isinstance(spec, tuple) and len(spec) == 2:
        return RobosuiteAdapter(environment)
    raise InputError(
        f"{kind} does not say what its actions are: it has neither action_space nor action_spec"
    )


def chain_of(environment: Any) -> list[Any]:
    chain = [environment]
    while len(chain) < _MAX_WRAPPERS:
        inner = _inner(chain[-1])
        if inner is None or any(inner is each for each in chain):
            break
        chain.append(inner)
    return chain


def _inner(environment: Any) -> Any:
    own = getattr(environment, "__dict__", {})
    for name in _INNER:
        inner = own.get(name)
        if callable(getattr(inner, "step", None)) and callable(getattr(inner, "reset", None)):
            return inner
    return None


def draw_uniform(low: Any, high: Any, count: int, seed: int, dtype: Any = None) -> list[Any]:
    """Return random arrays within bounds; where a bound is infinite, standard normal numbers."""
    try:
        low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
        bounded = np.isfinite(low) & np.isfinite(high)
        least, most = np.where(bounded, low, 0.0), np.where(bounded, high, 0.0)
        rng = np.random.default_rng([seed, 5])
        drawn = [
            np.where(bounded, rng.uniform(least, most), rng.standard_normal(low.shape))
            for _ in range(count)
        ]
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"no action can be drawn from its bounds: {one_line(error)}") from error
    return [action.astype(dtype or float) for action in drawn]


def _seed_generator(value: object, seed: int) -> None:
    """Seed a generator of random numbers, in place, as others may hold it, too."""
    if isinstance(value, np.random.RandomState):
        value.seed(seed % _SEEDS)
    elif isinstance(value, np.random.Generator):
        bits = value.bit_generator
        bits.state = type(bits)(seed).state


def _described(outcome: Any) -> str:
    kind = type(outcome).__name__
    return f"{len(outcome)} values" if isinstance(outcome, tuple) else kind


def _accepts(function: Callable[..., Any], keyword: str) -> bool:
    import inspect

    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return True
    return any(
        parameter.name == keyword or parameter.kind == parameter.VAR_KEYWORD
        for parameter in parameters
    )
