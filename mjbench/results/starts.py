"""The lines that say from which states a measurement stepped, and what its steps were like."""

from collections.abc import Iterator

from mjbench.formats import count_of, plain, short_percent
from mjbench.simulation.engine_warnings import warning_lines
from mjbench.simulation.starts import SettleLimit, Starts, Window

# A window shows sleeping if its share of sleeping trees is that of the model's run, within this.
_SAME_SLEEP = 0.05
# Later contacts are mentioned if they differ by more than this share of the larger number, and by
# more than this number.
_SAME_CONTACTS, _LEAST_CONTACTS = 0.2, 0.5

# A solver that stops at its limit of iterations in more than this share of the steps is mentioned.
_MENTIONED_LIMITED = 0.5


def starts_lines(starts: Starts | None, with_warnings: bool = True) -> list[str]:
    """Return where starts are from and what the steps from them were like, a line each.

    The first line is such as `64 starts from 1 to 2 s of the model's own run, 100 steps each, 8.1
    contacts a step`; files from before it was stored lack it.
    """
    if starts is None:
        return []
    lines, window = [], starts.window
    if window is not None:
        lines.append(
            f"{count_of(window.nstart, 'start')}{_source(starts)},"
            f" {count_of(window.nstep, 'step')} each, {plain(window.contacts, 3)} contacts a step"
        )
    elif starts.file is not None or starts.controls_file is not None:
        lines.append(f"Starts{_source(starts)}")
    lines += [*capture_lines(starts), *_limit_line(starts)]
    if window is not None:
        lines += _regime_lines(window)
        lines += warning_lines(window.warnings) if with_warnings else []
    return lines


def _source(starts: Starts) -> str:
    if starts.file is None:
        begin, end = plain(starts.settle_s, 3), plain(2 * starts.settle_s, 3)
        run = f" from {begin} to {end} s of a simulation"
        source = run if starts.settle_s else " at keyframe 0"
        return source + (f", controls of {starts.controls_file}" if starts.controls_file else "")
    if starts.controls_file == starts.file:
        return f" and their controls from {starts.file}"
    controls = f"controls of {starts.controls_file}" if starts.controls_file else "random controls"
    return f" from {starts.file}, {controls}"


def capture_lines(starts: Starts) -> list[str]:
    """Return what is not as it was where the states of a file were captured, a line each."""
    lines = []
    if starts.is_other_model:
        lines.append(
            f"{starts.file} was captured from a model that differs from this one, in masses,"
            " geometry or options"
        )
    if starts.held_inputs:
        lines.append(
            f"The captured program also set {', '.join(starts.held_inputs)} between steps; here"
            " these stay as they were at each start"
        )
    return lines


def _limit_line(starts: Starts) -> Iterator[str]:
    """Yield how starts were sampled where that is not what was asked for."""
    asked = f"{plain(starts.asked_s, 3)} s"
    if starts.limit == SettleLimit.COST:
        settled = f"{plain(starts.settle_s, 3)} s"
        yield f"The model settled for {settled} instead of {asked}, because its steps are slow"
    elif starts.limit is not None:
        yield f"Starts are at the keyframe: settled for {asked}, the model diverges"


def _regime_lines(window: Window) -> Iterator[str]:
    """Yield what limits how far the figures hold, a line each."""
    yield from limited_lines(window)
    if window.flat_hfields:
        fields = count_of(window.flat_hfields, "height field")
        yield (
            f"{fields} {'is' if window.flat_hfields == 1 else 'are'} flat (all zero). If your"
            " program fills it, save the filled model with mjbench.capture(…, save_model=…) and"
            " measure that"
        )
    if window.later is not None:
        before, after = window.contacts, window.later.contacts
        if abs(after - before) > max(_LEAST_CONTACTS, _SAME_CONTACTS * max(before, after)):
            time_s = plain(window.later.time_s, 2)
            yield (
                f"At {time_s} s of a simulation the model has {plain(after, 3)} contacts a step, so"
                f" other costs: --settle {time_s}s measures there"
            )
    if window.asleep is not None:
        slept = f"On average {short_percent(window.asleep)} of the model slept in these steps"
        yield f"{slept}{_sleep_in_run(window.asleep, window.asleep_in_run)}"


def _sleep_in_run(asleep: float, in_run: float | None) -> str:
    """Return how much of a model sleeps in a whole simulation, beside these steps."""
    if in_run is None:
        return ": states do not hold what sleeps, so all of it is awake at each start"
    if abs(asleep - in_run) <= _SAME_SLEEP:
        return ", as in a whole simulation"
    return (
        f", and {short_percent(in_run)} in a whole simulation: states do not hold what sleeps, so"
        " these steps do not show what sleeping saves; `mjbench ab` of the plain loop does"
    )


def limited_lines(window: Window) -> list[str]:
    """Return that the solver mostly stops at its limit of iterations, where it does."""
    if window.solver_limited <= _MENTIONED_LIMITED:
        return []
    limited = short_percent(window.solver_limited)
    return [
        f"The solver stopped at its limit of iterations in {limited} of the steps: states and times"
        " depend on that limit"
    ]
