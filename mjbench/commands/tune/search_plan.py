"""What a search for settings may cost, and what may come out of it."""

from collections.abc import Callable
from dataclasses import dataclass, field

from mjbench.commands.tune.reference import HOLD, REFERENCE_S, TrialPlan
from mjbench.commands.tune.result import Effect
from mjbench.simulation.starts import StartPlan

# A setting that saves less than this, by its first launches, is not looked at again.
LEAST_GAIN = 0.01
# Share of the budget that computing the reference may take.
REFERENCE_SHARE = 0.1
# Called with how many parts of the search are done, what goes on, and a share of 0.
Advance = Callable[[int, str, float], None]
# Parts of a search: present settings, each alone, together, second look.
PARTS = 4


@dataclass(frozen=True)
class SearchPlan:
    """What a search may cost, and what may come out of it.

    Attributes:
      seed: of starts and controls; the second look has the next one.
      budget_s: seconds of the whole search, about; with less than a minute, some settings may have
        no error, and nothing may be confirmed by a second look.
      max_error: the largest error allowed, as a share of the motion; None for the present one.
    """

    seed: int = 0
    starts: StartPlan = field(default_factory=StartPlan)
    budget_s: float = 300.0
    max_error: float | None = None
    only: Effect = Effect.APPROXIMATE
    hold: int = HOLD
    skip: tuple[str, ...] = ()

    def trials(self, look: int, ncontrol: int | None = None) -> TrialPlan:
        """Return the starts and controls of a look: 0 for the search, 1 for the second look."""
        reference_s = min(REFERENCE_S, REFERENCE_SHARE * self.budget_s)
        return TrialPlan(self.seed + look, self.starts, self.hold, ncontrol, reference_s)
