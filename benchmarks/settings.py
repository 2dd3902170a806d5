"""How every timed benchmark is sampled.

asv's own significance test needs 20 samples a side; its default of 10 misses a doubling. They come
from two rounds, which `asv run --interleave-rounds` puts minutes apart: what slows a machine down
for seconds hits one of them at most. With a `setup`, asv times one call per sample, so the loop is
inside what is timed.
"""


class Timed:
    """Base of timed benchmarks; N in `time_N_things` is how many things one call does."""

    number = 1
    repeat = 10
    rounds = 2
    warmup_time = 0.02
    timeout = 60
    version = "1"


class Tracked:
    """Base of benchmarks that count or compare: exact, so once is enough."""

    timeout = 60
    version = "1"
