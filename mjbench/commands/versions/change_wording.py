"""What the ratio of two targets comes to, in the words of its metric."""

from mjbench import formats
from mjbench.formats import plain
from mjbench.interval import Interval
from mjbench.paired.metrics import METRICS, Metric
from mjbench.paired.outcomes import Verdict

# From this factor on, a change is a factor and not a percentage.
_LARGE = 2.0


def describe_ratio(metric: Metric, verdict: Verdict, ratio: Interval) -> str:
    """Return a verdict with its ratio, such as `slower by 1.4 % (interval +1.1 to +1.7 %)`."""
    spec = METRICS[metric]
    if verdict == Verdict.SAME:
        ends = [end for end in (ratio.low, ratio.high) if end is not None]
        return f"same within {formats.short_percent(max(abs(end - 1) for end in ends))}"
    if verdict == Verdict.INCONCLUSIVE:
        interval = formats.ends(ratio, formats.change) or "unknown"
        return f"inconclusive, {formats.change(ratio.estimate)} (interval {interval})"
    if not spec.is_of_memory and ratio.low is not None and ratio.high is not None:
        if verdict == Verdict.FASTER and ratio.estimate <= 1 / _LARGE:
            interval = formats.ends(ratio.inverse, _times)
            return f"faster, {_times(1 / ratio.estimate)} times as fast (interval {interval})"
        if verdict == Verdict.SLOWER and ratio.estimate >= _LARGE:
            interval = formats.ends(ratio, _times)
            return f"slower, takes {_times(ratio.estimate)} times as long (interval {interval})"
    size = formats.short_percent(abs(ratio.estimate - 1))
    interval = formats.ends(ratio, formats.change) or "unknown"
    is_point = ratio.low is not None and ratio.low == ratio.high  # without any noise
    return f"{spec.outcome(verdict)} by {size}" + ("" if is_point else f" (interval {interval})")


def _times(factor: float) -> str:
    return plain(factor, 3)
