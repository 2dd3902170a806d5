"""What `mjbench doctor` says: what spoils measurements here, and which changes can be decided."""

from collections.abc import Iterator, Sequence

from mjbench.commands.doctor.detectable_change import Noise
from mjbench.formats import plain
from mjbench.host.conditions import Condition, Grade
from mjbench.results.content import Conclusion, Section, Tone

_LABELS = {Grade.GOOD: "ok", Grade.NOTE: "note", Grade.BAD: "bad"}


def condition_lines(conditions: Sequence[Condition]) -> Iterator[str]:
    """Yield what was looked at, a line each, with what to do below it."""
    width = max(len(condition.name) for condition in conditions)
    for condition in conditions:
        label = _LABELS[condition.grade]
        yield f"{label:<5}{condition.name:<{width}}  {condition.detail}"
        if condition.remedy:
            yield f"{'':<{width + 7}}{condition.remedy}"


def noise_section(noise: Noise, conditions: Sequence[Condition] = ()) -> Section:
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
