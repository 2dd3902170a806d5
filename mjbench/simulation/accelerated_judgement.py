"""Does an engine that compiles the step, MJX or Warp, compute what C does? Judged part by part.

Each part has a right answer of its own: smooth dynamics and the solution of a constraint problem
are the same for every engine; contacts of some pairs of geoms are not, and are named.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from mjbench.bounds import AnyFloat, NonNegativeFloat, NonNegativeInt
from mjbench.formats import count_of, plain

# Tangents that are turned by less, in degrees, are not worth a word.
_TURNED_DEGREES = 1.0


class Precision(StrEnum):
    """The type of floating-point numbers that an engine computes in."""

    FLOAT32 = "float32"
    FLOAT64 = "float64"


class EngineAnswer(StrEnum):
    """Whether an engine, or a part of what it does, computes what C does."""

    YES = "yes"
    CLOSE = "close"
    """Smooth dynamics and solver agree; contacts differ, as named."""
    NO = "NO"
    NOT_JUDGED = "not judged"
    """It could not run, for a reason that is said."""


class PartName(StrEnum):
    """What is judged."""

    INPUTS = "inputs"
    SMOOTH = "smooth dynamics"
    CONTACTS = "contacts"
    CONSTRAINTS = "constraint problem"
    WARM_START = "warm start"
    RUN = "run"
    BUFFERS = "buffers"


@dataclass(frozen=True)
class Measure:
    """One number that a part depends on.

    Attributes:
      value: None where it is not finite.
      limit: the largest value that agrees; None for what is only shown.
      in_c: the same number of C, where C has one.
    """

    name: str
    value: AnyFloat | None
    limit: AnyFloat | None = None
    in_c: AnyFloat | None = None

    @property
    def is_within(self) -> bool:
        return self.limit is None or (self.value is not None and self.value <= self.limit)

    def __str__(self) -> str:
        value = "not finite" if self.value is None else f"{self.value:.2g}"
        beside = [] if self.limit is None else [f"limit {self.limit:.1g}"]
        beside += [] if self.in_c is None else [f"C {self.in_c:.1g}"]
        return f"{self.name} {value}" + (f" ({', '.join(beside)})" if beside else "")


@dataclass(frozen=True)
class JudgedPart:
    """What became of one part.

    Attributes:
      reason: why the answer is not `yes`, in a clause.
    """

    name: PartName
    answer: EngineAnswer
    measures: tuple[Measure, ...] = ()
    reason: str = ""

    @classmethod
    def of(cls, name: PartName, *measures: Measure) -> "JudgedPart":
        """Return `yes`, or `NO` with those measures that are beyond their limits."""
        beyond = [str(each) for each in measures if not each.is_within]
        return cls(
            name, EngineAnswer.NO if beyond else EngineAnswer.YES, measures, "; ".join(beyond)
        )


@dataclass(frozen=True, kw_only=True)
class PairContacts:
    """Contacts between geoms of two types, of an engine beside those of C.

    Attributes:
      types: of the geoms, such as `plane` and `box`.
      states: states in which C or the engine has such contacts.
      other_counts: those of them in which the engine has another number.
      count: mean number of contacts in these states.
      distance_m: largest difference of the distances between the geoms.
      position_m: farthest that a contact is from C's nearest one.
      normal_degrees: largest angle between normals.
      tangent_degrees: largest angle by which tangents are turned; None in older results.
      effect: by how much accelerations change in C where it has the engine's contacts instead of
        its own: relative to what constraints add to them; nine in ten states have less. None where
        that is known of no state.
      largest_effect: the same of the state where it is largest.
      beside_flex: states of which it is unknown because a flex touches, whose contacts C cannot be
        given.
      unmet: states of which it is unknown because geoms touch that touch in no judged state of C.
      answer: `close` where they differ.
    """

    types: tuple[str, str]
    states: NonNegativeInt
    other_counts: NonNegativeInt
    count: NonNegativeFloat
    count_in_c: NonNegativeFloat
    distance_m: AnyFloat | None
    position_m: AnyFloat | None
    normal_degrees: AnyFloat | None
    effect: AnyFloat | None
    largest_effect: AnyFloat | None
    answer: EngineAnswer
    beside_flex: NonNegativeInt = 0
    unmet: NonNegativeInt = 0
    tangent_degrees: AnyFloat | None = None

    def __str__(self) -> str:
        text = "–".join(self.types)
        if self.other_counts:
            text += (
                f": {plain(self.count, 2)} contacts instead of {plain(self.count_in_c, 2)}"
                f" (other numbers in {self.other_counts} of {self.states} states)"
            )
        elif self.position_m is not None:
            text += f": as many contacts, up to {1000 * self.position_m:.2g} mm elsewhere"
            if self.tangent_degrees is not None and self.tangent_degrees > _TURNED_DEGREES:
                text += f", tangents turned by up to {self.tangent_degrees:.0f}°"
        if self.effect is not None:
            text += f", which changes accelerations by {_percent(self.effect)}"
            if self.largest_effect is None:
                text += ", in one state not finite"
            elif _percent(self.largest_effect) != _percent(self.effect):
                text += f", in one state by {_percent(self.largest_effect)}"
        if self.beside_flex:
            text += (
                f", in {count_of(self.beside_flex, 'state')} beside a flex, which C cannot be given"
            )
        if self.unmet:
            text += f", in {count_of(self.unmet, 'state')} of geoms that never touch in C"
        return text


@dataclass(frozen=True, kw_only=True)
class EngineJudgement:
    """Whether an engine computes what C does, in the user's own states.

    Attributes:
      answer: that of the worst part.
      reason: why it is not `yes`: the parts that decide, each with its reason.
      pairs: contacts, by types of geoms.
      states: number of states in which single steps were judged.
      contact_states: those of them in which C has contacts.
    """

    precision: Precision
    answer: EngineAnswer
    reason: str
    parts: tuple[JudgedPart, ...] = ()
    pairs: tuple[PairContacts, ...] = ()
    states: NonNegativeInt = 0
    contact_states: NonNegativeInt = 0

    @classmethod
    def of(
        cls,
        precision: Precision,
        parts: Sequence[JudgedPart],
        pairs: Sequence[PairContacts] = (),
        states: int = 0,
        contact_states: int = 0,
    ) -> "EngineJudgement":
        answer = worst(part.answer for part in parts)
        deciding = [part for part in parts if part.answer == answer != EngineAnswer.YES]
        return cls(
            precision=precision,
            answer=answer,
            reason="; ".join(f"{part.name}: {part.reason}" for part in deciding),
            parts=tuple(parts),
            pairs=tuple(pairs),
            states=states,
            contact_states=contact_states,
        )

    @property
    def agrees(self) -> bool | None:
        """Whether it may be timed and advised; None where that is not known."""
        return None if self.answer == EngineAnswer.NOT_JUDGED else self.answer != EngineAnswer.NO

    @property
    def summary(self) -> str:
        states = f"{self.states} states, {self.contact_states} in contact"
        return f"{self.reason or 'all parts agree'} ({states})"

    def with_failed_run(self, reason: str) -> "EngineJudgement":
        """Return the judgement of an engine whose timed blocks end elsewhere than its run."""
        failed = JudgedPart(PartName.RUN, EngineAnswer.NO, reason=reason)
        parts = [part for part in self.parts if part.name != PartName.RUN]
        return EngineJudgement.of(
            self.precision, [*parts, failed], self.pairs, self.states, self.contact_states
        )


# The worst answer last.
_SEVERITY = (EngineAnswer.YES, EngineAnswer.CLOSE, EngineAnswer.NOT_JUDGED, EngineAnswer.NO)
# Larger numbers stand for NaN or infinity (see `agreement.max_relative_error`).
_LARGEST_FINITE = 1e300


def worst(answers: Iterable[EngineAnswer]) -> EngineAnswer:
    return max(answers, key=_SEVERITY.index, default=EngineAnswer.YES)


def finite_or_none(value: float) -> float | None:
    """Return a number as a `Measure` holds it."""
    return float(value) if abs(value) <= _LARGEST_FINITE else None


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share >= 1e-4 else "less than 0.01 %"
