"""What `benchmarks.studies.ray_crossover` measures: calls of `ray` and other paths, by work."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.studies import tally_file
from mjbench.paths import BASE


@dataclass(frozen=True)
class Case:
    """A model to measure, and how many steps its simulations take in a call."""

    model: str
    nstep: int


@dataclass(frozen=True)
class PathTime:
    """How long a call of a path takes.

    Attributes:
      ms: milliseconds of its fastest variant with that many, the median.
    """

    path: str
    nthread: int
    ms: float

    @property
    def column(self) -> str:
        """What the columns of tables are called."""
        return f"`{self.path}`" if self.path == BASE else f"`{self.path}` × {self.nthread}"


@dataclass(frozen=True)
class RaySize:
    """Calls of one size."""

    nbatch: int
    nstep: int
    times: Sequence[PathTime]

    @property
    def steps(self) -> int:
        """Steps of all simulations together."""
        return self.nbatch * self.nstep

    @property
    def loop_ms(self) -> float:
        """Milliseconds of the plain loop."""
        return next(time.ms for time in self.times if time.path == BASE)


@dataclass(frozen=True)
class CallWork:
    """Steps of a call, all simulations together, and the plain loop's milliseconds for them."""

    steps: int
    loop_ms: float


@dataclass(frozen=True)
class Overtaking:
    """Where `ray` overtakes another path; see `mjbench.report.crossovers`.

    Attributes:
      least: work from which on `ray` is faster; None where it never is.
      largest: most work that was tried.
      share: of the other path's speed at that work.
    """

    path: str
    nthread: int
    least: CallWork | None
    largest: CallWork
    share: float


@dataclass(frozen=True)
class RayModel:
    """One model.

    Attributes:
      step_us: microseconds of a step in the plain loop, at the largest size.
      sizes: from the least work on.
      crossovers: where `ray` overtakes each other path.
    """

    model: str
    step_us: float
    nstep: int
    sizes: Sequence[RaySize]
    crossovers: Sequence[Overtaking]


@dataclass(frozen=True)
class RayCost:
    """What Ray takes on one machine.

    Attributes:
      start_s: seconds to start it.
      actors_s: seconds to start two actors, up to the end of their first call.
      idle_share: of one core, that its services take while nobody uses it.
      services_bytes: memory of its services that they share with nobody.
      actor_bytes: the same of one actor.
    """

    start_s: float
    actors_s: float
    idle_share: float
    services_bytes: int
    actor_bytes: int


@dataclass(frozen=True)
class RayTally:
    """All models, on one machine.

    Attributes:
      usable_cores: also the most threads, processes and actors.
      models: in the order in which they were measured first.
    """

    date: str
    processor: str
    usable_cores: int
    mujoco: str
    ray: str
    cost: RayCost
    models: Sequence[RayModel]


def load(file: Path) -> RayTally:
    """Return the tally of a JSON file."""
    return tally_file.load(file, RayTally, "calls of Ray")
