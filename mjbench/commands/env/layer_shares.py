"""Which share of a step of an environment each layer takes, without what timing them cost.

The timer of the layers costs time. What one of its calls costs beside this environment is the
median difference between the same step with and without it, divided by the calls; it is not taken
to be less than what a loop of such calls shows. Every layer is then without what its calls cost.
What the layers add up to, compared with steps that were timed as a whole, shows how well that
worked.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mjbench.commands.env.layers import Layer
from mjbench.commands.env.timer import LayerSamples, TimerCost
from mjbench.interval import Interval
from mjbench.measuring import stats

# Smallest divisor; no clock shows a shorter time.
_LEAST_NS = 1e-3


@dataclass(frozen=True)
class FunctionShare:
    """A function inside a step.

    Attributes:
      name: of it, or of the wrapper's or environment's class.
      calls: per step of the environment.
      share: of the step, without other functions that are listed.
    """

    name: str
    calls: float
    share: float


@dataclass(frozen=True)
class LayerShare:
    """A layer of a step.

    Attributes:
      share: of the step; the shares of all layers add up to 1.
      functions: that belong to it, the one with the largest share first.
    """

    layer: Layer
    share: Interval
    ns: float
    functions: Sequence[FunctionShare]


@dataclass(frozen=True)
class TimerEffect:
    """What timing the layers cost.

    Attributes:
      calls: timed, per step of the environment.
      call_ns: what each costs.
      share: what all of them add to a step, of the step.
      sum: of the layers without that, over steps that were timed as a whole.
    """

    calls: float
    call_ns: float
    share: float
    sum: Interval


class LayerTimes:
    """The layers of a step, without what timing them cost; `added_ns` is the median over rounds."""

    def __init__(
        self,
        samples: Sequence[LayerSamples],
        plain_ns: Sequence[float],
        added_ns: float,
        cost: TimerCost,
    ):
        self._samples, self._plain_ns = samples, np.maximum(plain_ns, _LEAST_NS)
        self._calls = sum(sample.timed_calls for sample in samples)
        self._call_ns = max(cost.total_ns, added_ns / self._calls if self._calls else 0.0)
        inside = cost.inside_ns / cost.total_ns if cost.total_ns else 0.5
        self._inside_ns, self._outside_ns = inside * self._call_ns, (1 - inside) * self._call_ns

    def _ns(self, sample: LayerSamples) -> np.ndarray:
        cost_ns = sample.timed_calls * self._inside_ns + sample.inner_calls * self._outside_ns
        return np.array(sample.ns) - cost_ns

    def shares(self) -> list[LayerShare]:
        """Return the layers, largest share first; shares are of medians, so that they add up."""
        step_ns = float(np.median(self._plain_ns))
        total_ns, each_total = self._median_total(), self._total()
        by_layer: dict[Layer, list[LayerSamples]] = {}
        for sample in self._samples:
            by_layer.setdefault(sample.layer, []).append(sample)
        shares = []
        for layer, samples in by_layer.items():
            functions = [
                FunctionShare(s.name, s.calls, float(np.median(self._ns(s))) / total_ns)
                for s in samples
            ]
            functions.sort(key=lambda function: -function.share)
            in_rounds = sum(self._ns(sample) for sample in samples) / each_total
            share = _around(sum(function.share for function in functions), in_rounds)
            shares.append(LayerShare(layer, share, share.estimate * step_ns, functions))
        return sorted(shares, key=lambda layer: -layer.share.estimate)

    def _total(self) -> np.ndarray:
        """Return (rounds,) ns of all layers together; never 0, as it divides."""
        total = np.sum([self._ns(sample) for sample in self._samples], axis=0)
        return np.asarray(np.maximum(total, _LEAST_NS))

    def _median_total(self) -> float:
        """Return the sum of every function's median, in ns; never 0."""
        medians = [float(np.median(self._ns(sample))) for sample in self._samples]
        return max(_LEAST_NS, sum(medians))

    def timer(self) -> TimerEffect:
        plain_ns = float(np.median(self._plain_ns))
        total = _around(self._median_total() / plain_ns, self._total() / self._plain_ns)
        return TimerEffect(
            self._calls, self._call_ns, self._calls * self._call_ns / plain_ns, total
        )


def _around(value: float, samples: np.ndarray) -> Interval:
    """Return a value with the 95 % interval of the median of samples, widened to hold it."""
    own = stats.median_of(samples)
    if own.low is None or own.high is None:
        return Interval(value, None, None)
    return Interval(value, min(own.low, value), max(own.high, value))
