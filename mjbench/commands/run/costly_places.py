"""What costs most in a loop and has no remedy, so that a report can say so."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from mjbench.bounds import Share
from mjbench.commands.run.activities import WAITING, Activity, Place
from mjbench.commands.run.hook import file_owners
from mjbench.commands.run.loop_time import LineTime, LoopTime
from mjbench.commands.run.remedies.remedy import LEAST_GAIN, Remedy
from mjbench.formats import whole_percent

# Physics has the settings of the model and the ways of stepping it; who waits does nothing.
_NOT_MEANT = (Activity.PHYSICS, Activity.REST, Activity.COMPILING, *WAITING)
_PYTHON = (Activity.PYTHON, Activity.BINDINGS, Activity.NUMPY)
_MOST_PLACES = 3
# By which shares of different lines may exceed the whole, as samples and timed calls err.
_SLACK = 0.05


@dataclass(frozen=True)
class CostlyPlaces:
    """Lines that do one thing, and the share of the loop that this takes on all of them."""

    name: str
    places: Sequence[Place]
    share: Share

    def __str__(self) -> str:
        first, others = self.places[0], self.places[1:_MOST_PLACES]
        more = [str(each.line) if each.file == first.file else str(each) for each in others]
        ending = ", …" if len(self.places) > _MOST_PLACES else ""
        return f"{self.name} at {', '.join([str(first), *more])}{ending}"

    @property
    def with_share(self) -> str:
        return f"{self}: {whole_percent(self.share)}"


def costliest(time: LoopTime, remedies: Sequence[Remedy]) -> CostlyPlaces | None:
    """Return what takes most of a loop on lines without a remedy; None where that is little."""
    shares: dict[str, dict[Place, float]] = defaultdict(lambda: defaultdict(float))
    for line in time.lines:
        if not any(remedy.is_at(line.place) for remedy in remedies):
            for activity, share in line.activities.items():
                if activity not in _NOT_MEANT:
                    shares[_name(line, activity)][line.place] += share
    if not shares:
        return None
    name = max(shares, key=lambda each: sum(shares[each].values()))
    total = min(1.0, sum(shares[name].values()))
    # a remedy may be about more than its own lines, such as all that builds a model
    if total < LEAST_GAIN or any(total + (each.gain or 0.0) > 1 + _SLACK for each in remedies):
        return None
    places = sorted(shares[name], key=lambda place: -shares[name][place])
    large = [place for place in places if shares[name][place] >= LEAST_GAIN]
    return CostlyPlaces(name, large or places[:1], total)


def _name(line: LineTime, activity: Activity) -> str:
    if activity not in _PYTHON:
        return activity.value
    is_own = line.package in ("", "numpy", file_owners.STANDARD_LIBRARY)
    return "your own Python and NumPy" if is_own else line.package
