"""`mjbench.compare`: the ways of stepping a model: do they agree, and which is fastest?"""

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mjbench.api import model_sources
from mjbench.api.functions import with_options
from mjbench.api.result import Result
from mjbench.commands.compare.advice import Advice, ClockAdvice
from mjbench.commands.compare.crossovers import Crossover
from mjbench.commands.compare.driver import measurement, plans_of
from mjbench.commands.compare.options import CompareOptions
from mjbench.commands.compare.results import ModelResults, PathResult, derive_all
from mjbench.commands.show.documents import CompareDocument
from mjbench.measuring.timing import Progress

if TYPE_CHECKING:
    from mjbench.api.model_sources import Model


@dataclass(frozen=True, repr=False, eq=False)
class Comparison(Result):
    """Ways of stepping models, compared."""

    @functools.cached_property
    def models(self) -> tuple[ModelResults, ...]:
        """The results of each model at each size."""
        return tuple(derive_all(self.run.records))

    @functools.cached_property
    def document(self) -> CompareDocument:
        """All that `mjbench compare --json` has."""
        return CompareDocument.of(self.machine, self.models)

    @property
    def results(self) -> tuple[PathResult, ...]:
        """The results of all variants of paths, on all models."""
        return tuple(result for model in self.models for result in model.results)

    @property
    def advice(self) -> tuple[Advice, ...]:
        """Which path to use, for open and for closed loop."""
        return tuple(self.document.advice)

    @property
    def clock(self) -> tuple[ClockAdvice, ...]:
        """What turning MuJoCo's timer off gains, where that is certain."""
        return tuple(self.document.clock)

    @property
    def crossovers(self) -> tuple[Crossover, ...]:
        """From how many simulations on accelerated paths overtake C."""
        return tuple(self.document.crossovers)


@with_options(CompareOptions)
def compare(
    *models: "Model", options: CompareOptions, on_progress: Progress | None = None
) -> Comparison:
    """Compare ways of stepping models: do they agree, and how fast are they?

    The same as `mjbench compare`. What paths return is compared first, bit by bit; a path that
    disagrees gets no speed. All is measured in child processes. A model that fails loses only its
    own results, unless all fail.

    Args:
      *models: names as on the command line, paths, MjModels or MjSpecs.
      on_progress: called with what is measured now, and the share of all work that is done.

    Raises:
      InputError: there is no such model or path, an argument is out of its range, or no model can
        be compared.
      MachineError: a package is missing, or no model could be compared because processes failed.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """
    plans = plans_of(options)
    with model_sources.sources(models) as sources:
        work = measurement(sources, plans, options.budget)
        return Comparison.of(work, options.wait, on_progress)
