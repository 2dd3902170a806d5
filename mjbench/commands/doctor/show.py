"""What `mjbench doctor` says: what spoils measurements here, and which changes can be decided."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mjbench.commands.doctor.detectable_change import Noise
from mjbench.host.conditions import Condition, Grade
from mjbench.results.content import Conclusion, Section, Tone
from mjbench.units import plain

# The change of which a gate should be certain.
TRUSTED = 0.01
_LABELS = {Grade.GOOD: "ok", Grade.NOTE: "note", Grade.BAD: "bad"}


@dataclass(frozen=True, kw_only=True)
class NoiseRow:
    """What a comparison of the cart-pole with itself showed.

    Attributes:
      launches: of both sides.
      deviation: standard deviation of their log ratios.
      ratio: of the one side over the other; 1 but for noise.
      decidable: the smallest change that a verdict of a minute decides, as a share.
      trusted: whether that is 1 % or less.
      detail: why it was not measured, in one line; empty where it was.
    """

    launches: int = 0
    deviation: float | None = None
    ratio: float | None = None
    decidable: float | None = None
    trusted: bool = False
    detail: str = ""

    @classmethod
    def of(cls, noise: Noise) -> "NoiseRow":
        decidable = noise.decidable()
        return cls(
            launches=noise.launches,
            deviation=noise.deviation,
            ratio=noise.ratio,
            decidable=decidable,
            trusted=decidable <= TRUSTED,
        )


def condition_lines(conditions: Sequence[Condition]) -> Iterator[str]:
    """Yield what was looked at, a line each, with what to do below it."""
    width = max(len(condition.name) for condition in conditions)
    for condition in conditions:
        label = _LABELS[condition.grade]
        yield f"{label:<5}{condition.name:<{width}}  {condition.detail}"
        if condition.remedy:
            yield f"{'':<{width + 7}}{condition.remedy}"


def noise_section(noise: NoiseRow, conditions: Sequence[Condition] = ()) -> Section:
    """Return which changes can be decided here, and what speaks against measuring."""
    if noise.decidable is None or noise.deviation is None:
        return Section("Noise", [Conclusion(f"Not measured: {noise.detail}", Tone.BAD)])
    size = plain(100 * noise.decidable, 2)
    can = "can" if noise.trusted else "cannot"
    text = (
        f"This machine {can} decide changes of 1 % now: a verdict of a minute decides those of"
        f" {size} % and more of a small model (the cart-pole beside itself: {noise.launches}"
        f" launches, which differ by {plain(100 * noise.deviation, 2)} %)."
    )
    conclusions = [Conclusion(text, Tone.GOOD if noise.trusted else Tone.BAD)]
    if not noise.trusted:
        options = f"a longer --budget or --min-effect {size}%"
        text = f"End other programs, or give `versions` and `ab` {options}."
        conclusions.append(Conclusion(text))
    if bad := [condition.name for condition in conditions if condition.grade == Grade.BAD]:
        text = f"Bad for measuring: {', '.join(bad)}. What to do stands above, below each."
        conclusions.append(Conclusion(text, Tone.BAD))
    return Section("Noise", conclusions)
