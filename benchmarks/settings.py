"""Base classes of the benchmarks: how often asv measures each one.

asv's significance test needs 20 samples on each side; with its default of 10 it misses a time that
doubled. They come from two rounds, which `asv run --interleave-rounds` puts minutes apart: a
disturbance of some seconds affects at most one of them. Because the classes have a `setup`, asv
times one call per sample, so each method does its work many times in one call.

asv forks every parameter of every round from one process (`launch_method` in asv.conf.json). What
is measured for all parameters together is measured in `setup_cache`, once for each release.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypedDict, TypeVar, Unpack

from mjbench.status import Status

Value = TypeVar("Value")
_Method = TypeVar("_Method", bound=Callable[..., Any])


class MethodAttributes(TypedDict, total=False):
    """What asv reads from a method.

    Attributes:
      timeout: seconds of `setup_cache`; those of a benchmark are an attribute of its class.
    """

    pretty_name: str
    unit: str
    timeout: float
    skip_benchmark: bool


def for_asv(**attributes: Unpack[MethodAttributes]) -> Callable[[_Method], _Method]:
    """Give a method attributes that asv reads; the method itself stays as it is."""

    def with_attributes(method: _Method) -> _Method:
        vars(method).update(attributes)
        return method

    return with_attributes


class Timed:
    """Base of benchmarks that asv times, in seconds per call.

    A method `time_N_things` does N things in one call.
    """

    number = 1
    repeat = 10
    rounds = 2
    warmup_time = 0.02
    timeout = 60
    version = "1"


class Tracked:
    """Base of benchmarks that return a number, or whose memory asv reads; they run once.

    Counts are exact, and ratios are medians over many rounds of their own.
    """

    timeout = 60
    version = "1"


@dataclass(frozen=True)
class Cached(Generic[Value]):
    """What `setup_cache` measured for one of its parameters; asv pickles it.

    Attributes:
      status: `ok`, `unavailable` where this release or machine lacks what it needs, or how it
        failed.
      detail: one line; empty when ok.
      value: None unless ok.
    """

    status: Status
    detail: str = ""
    value: Value | None = None

    def get(self) -> Value:
        """Return the value.

        Raises:
          NotImplementedError: this release or machine lacks what it needs.
          RuntimeError: it failed.
        """
        if self.status == Status.UNAVAILABLE:
            raise NotImplementedError(self.detail)
        if self.value is None:
            raise RuntimeError(self.detail)
        return self.value
