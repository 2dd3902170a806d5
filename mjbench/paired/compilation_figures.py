"""What compiling takes beside steady steps, on one side of a comparison."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mjbench.bounds import NonNegativeInt
from mjbench.measuring import stats
from mjbench.measuring.calls import Compilation
from mjbench.measuring.stats import Estimate


@dataclass(frozen=True)
class CompilationFigures:
    """What the processes of one side took, as medians over them.

    A median has no interval where there are fewer than six processes. Where launches read the
    compiler's cache, `compile_s` is of the process before them.

    Attributes:
      trace_s: from Python to the compiler's input; None without such a stage.
      compile_s: of the compiler without a cache; None where no process did without.
      first_run_s: of the first run after that.
      steady_run_s: of a run that is timed; None where compiling is what is compared.
      programs: how many the compiler was asked for, single operations included; None where it does
        not tell.
      processes: that traced, and made a first run.
      compiling_processes: that compiled without a cache.
    """

    trace_s: Estimate | None
    compile_s: Estimate | None
    first_run_s: Estimate
    steady_run_s: Estimate | None
    programs: NonNegativeInt | None
    processes: NonNegativeInt
    compiling_processes: NonNegativeInt

    @classmethod
    def of(
        cls, compilations: Sequence[Compilation], steady_run_s: Sequence[float]
    ) -> "CompilationFigures":
        """Return the figures of one side.

        Args:
          compilations: of each of its processes, one or more.
          steady_run_s: of each launch; none where compiling is what is compared.
        """
        fresh = [c for c in compilations if not c.is_cached]
        return cls(
            _median(c.trace_s for c in compilations if c.trace_s is not None),
            _median(c.compile_s for c in fresh),
            stats.median_of([c.first_run_s for c in compilations]),
            _median(steady_run_s),
            max((c.programs for c in compilations if c.programs is not None), default=None),
            len(compilations),
            len(fresh),
        )


def _median(samples: Iterable[float]) -> Estimate | None:
    values = [*samples]
    return stats.median_of(values) if values else None
