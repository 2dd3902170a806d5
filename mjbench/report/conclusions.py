"""What follows from `mjbench compare`, in sentences: which path to use, and what to know first."""

from collections.abc import Sequence

from mjbench import paths
from mjbench.comparison.plan import Variant, describe_options
from mjbench.measuring.ratio import Ratio
from mjbench.paired.race_record import Loop
from mjbench.report import formats
from mjbench.report.advice import Advice, ClockAdvice, Reason, ThreadAdvice
from mjbench.report.results import ModelResults
from mjbench.simulation import package_timer
from mjbench.units import count_of

# A model on whose free bodies gravity acts falls where it has fewer contacts than this in a step.
_FALLING_CONTACTS = 0.05
_PLAIN_LOOP = "the plain loop"
# Paths that a sentence names as perhaps faster, at most.
_MOST_RIVALS = 2
FORMER = (
    "Timed by an earlier version of mjbench, in one process: speed-ups have no interval, and no"
    " path is advised."
)
_FALLING = (
    "Warning: a free body falls, and touches nothing: these are the speeds of free fall. Let it"
    " settle (--settle 3s), or give states of your own (--states)."
)
_LOOPS = {
    Loop.OPEN: "For controls known beforehand (open loop)",
    Loop.CLOSED: "For RL (closed loop)",
}


def conclusion(advice: Advice, names_size: bool = False) -> str:
    """Return which path to use, and why.

    Args:
      names_size: whether to say how many simulations there were.
    """
    gain = f", {_times(advice.speedup, _PLAIN_LOOP)}" if advice.speedup is not None else ""
    begin = f"{_LOOPS[advice.loop]}{_size(advice.nbatch, names_size)}"
    path = described(Variant(advice.path, advice.options))
    return "; ".join([f"{begin}: {path}{gain}", *_reasons(advice)])


def _size(nbatch: int | None, names_size: bool) -> str:
    """Return how many simulations a sentence is about, to follow its first words."""
    return f", {count_of(nbatch, 'simulation')}" if names_size and nbatch else ""


def described(variant: Variant) -> str:
    """Return a path with its options for a sentence, such as `Batch.step on 2 threads`.

    Options that have the path's own value are left out.
    """
    path, options = paths.find(variant.path), dict(variant.options)
    text = path.title or path.name
    for option in path.options:
        if option.name not in options:
            continue
        if option.name == "threads":
            text += f" on {count_of(options.pop(option.name), 'thread')}"
        elif option.is_parallel:
            text = f"{options.pop(option.name)} {text}"
        elif option.values and options[option.name] == option.values[0]:
            del options[option.name]
    rest = describe_options(options)
    return f"{text} ({rest})" if rest else text


def _reasons(advice: Advice) -> list[str]:
    """Return why a path is advised, in clauses."""
    reasons = []
    match advice.reason:
        case Reason.SIMPLER | Reason.NO_GAIN if advice.is_certain:
            reasons.append("no other path is faster by 2 %")
        case Reason.ALONE:
            reasons.append("no other path was timed for it")
    if not advice.is_certain and advice.reason != Reason.PAYS:
        reasons.append(f"not certain{_doubt(advice)}")
    return [*reasons, *advice.unable, *filter(None, [advice.break_even])]


def _doubt(advice: Advice) -> str:
    """Return which paths may be faster than the one that is advised, and by how much."""
    if not advice.rivals:
        return ""
    rivals = f"{len(advice.rivals)} other paths"
    if len(advice.rivals) <= _MOST_RIVALS:
        rivals = " or ".join(map(described, advice.rivals))
    most = f" by up to {max(1, round(100 * advice.most_gain))} %" if advice.most_gain else ""
    return f": {rivals} may be faster{most}"


def _times(speedup: Ratio, baseline: str) -> str:
    return f"{formats.factor(speedup.estimate)} times {baseline}{formats.in_brackets(speedup)}"


def thread_conclusion(row: ThreadAdvice, names_size: bool = False) -> str:
    """Return how many threads a path should have."""
    threads = "one thread" if row.nthread == 1 else f"{row.nthread} threads"
    name = paths.find(row.path).title or row.path
    begin = f"{name}{_size(row.nbatch, names_size)}: {threads}"
    doubt = "" if row.is_certain else "; not certain"
    if row.over_one is None:
        return f"{begin}; no number up to {row.most_tried} is certainly faster{doubt}"
    most = ""
    if row.nthread < row.most_tried:
        most = f"; {row.most_tried} threads gain less than 5 % more"
    chunk = f" (chunk={row.chunk})" if row.chunk else ""
    return f"{begin}{chunk}, {_times(row.over_one, 'one thread')}{most}{doubt}"


def clock_conclusion(clock: ClockAdvice, names_size: bool = False) -> str:
    """Return what turning MuJoCo's timer off gains."""
    begin = f"Any path{_size(clock.nbatch, names_size)}: turn off {package_timer.NAME}"
    return f"{begin} ({package_timer.OFF_CODE}), {_times(clock.speedup, _PLAIN_LOOP)}"


def cautions(model_results: ModelResults) -> list[str]:
    """Return what a reader must know before the numbers of a model, a sentence each."""
    sentences = []
    if model_results.disturbances:
        sentences.append(disturbed(model_results.disturbances))
    if model_results.is_former:
        sentences.append(FORMER)
    model = model_results.model
    if model.facts is None or model.work is None or not model.facts.can_fall:
        return sentences
    if not model.start_contacts and model.work.contacts < _FALLING_CONTACTS:
        sentences.append(_FALLING)
    return sentences


def disturbed(disturbances: Sequence[str]) -> str:
    """Return what disturbed a measurement, as a sentence, and what to do."""
    return f"Disturbed: {'; '.join(disturbances)}. Measure again."
