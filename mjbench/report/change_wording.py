"""What the ratio of two targets comes to, in the words of its metric."""

from mjbench.measuring.ratio import Ratio
from mjbench.paired.metrics import GROWTH_UNIT_BYTES, METRICS, Measured, Metric
from mjbench.paired.outcomes import Verdict
from mjbench.report import formats
from mjbench.units import plain

# From this factor on, a change is a factor and not a percentage.
_LARGE = 2.0


def describe_ratio(metric: Metric, verdict: Verdict, ratio: Ratio, things: str = "steps") -> str:
    """Return a verdict with its ratio, such as `slower by 1.4 % (interval +1.1 to +1.7 %)`.

    Args:
      things: what memory grows with: steps, or calls of a function.
    """
    spec = METRICS[metric]
    if verdict == Verdict.SAME:
        ends = [end for end in (ratio.low, ratio.high) if end is not None]
        return f"same within {formats.short_percent(max(abs(end - 1) for end in ends))}"
    if verdict == Verdict.INCONCLUSIVE:
        interval = formats.ends(ratio, formats.change, " to ") or "unknown"
        return f"inconclusive, {formats.change(ratio.estimate)} (interval {interval})"
    if metric == Metric.GROWTH:
        return _growth(ratio, things)
    if spec.measured != Measured.MEMORY and ratio.low is not None and ratio.high is not None:
        if verdict == Verdict.FASTER and ratio.estimate <= 1 / _LARGE:
            interval = formats.ends(ratio.inverse, _times, " to ")
            return f"faster, {_times(1 / ratio.estimate)} times as fast (interval {interval})"
        if verdict == Verdict.SLOWER and ratio.estimate >= _LARGE:
            interval = formats.ends(ratio, _times, " to ")
            return f"slower, takes {_times(ratio.estimate)} times as long (interval {interval})"
    size = formats.short_percent(abs(ratio.estimate - 1))
    interval = formats.ends(ratio, formats.change, " to ") or "unknown"
    is_point = ratio.low is not None and ratio.low == ratio.high  # without any noise
    return f"{spec.outcome(verdict)} by {size}" + ("" if is_point else f" (interval {interval})")


def _growth(ratio: Ratio, things: str) -> str:
    """Return by how much more one side grows.

    A ratio is of what 1,000 of them add, with a unit on both sides. The difference is that of a
    side that does not grow; otherwise it is larger.
    """
    is_more = ratio.estimate > 1
    more = ratio if is_more else ratio.inverse
    outcome = METRICS[Metric.GROWTH].outcome(Verdict.SLOWER if is_more else Verdict.FASTER)
    least = "unknown" if more.low is None else _megabytes(more.low)
    side = "candidate" if is_more else "baseline"
    added = f"1,000 {things} add {_megabytes(more.estimate)} more in the {side}"
    return f"{outcome}: {added} (at least {least})"


def _megabytes(ratio: float) -> str:
    return f"{plain(1e-6 * GROWTH_UNIT_BYTES * (ratio - 1), 2)} MB"


def _times(factor: float) -> str:
    return plain(factor, 3)
