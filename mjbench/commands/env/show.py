"""What `mjbench env` comes to: where a step goes, and what its physics costs alone."""

from collections.abc import Iterator, Sequence
from typing import TypeVar

from mjbench import formats, paths
from mjbench.commands.env.layer_shares import LayerShare
from mjbench.commands.env.layers import Layer
from mjbench.commands.env.recording import Moment
from mjbench.commands.env.result import (
    EnvironmentFacts,
    EnvironmentRecord,
    PhysicsPath,
    VectorForm,
    VectorSamples,
)
from mjbench.formats import Form, count_of, duration, listed, plain
from mjbench.host import conditions
from mjbench.interval import Interval
from mjbench.paths import BASE
from mjbench.paths.base import nthread
from mjbench.results import charts, content
from mjbench.results.content import Column, Conclusion, DataTable, Figure, Section, Tone
from mjbench.status import Status
from mjbench.verification.plan import Variant, describe_options

# The least share of a layer that the first sentence names beside physics; and the most layers, or
# fields that do not repeat, that a sentence names.
_NAMED_SHARE, _NAMED = 0.01, 4
# The layers must add up to steps that were timed as a whole, within this share.
SUM_TOLERANCE = 0.03
# The first sentence names the costliest wrapper where wrappers take this share of a step.
_MUCH_SHARE = 0.1
# Smaller shares are shown as less than this.
_LEAST_SHARE = 0.001
_Timed = TypeVar("_Timed", PhysicsPath, VectorSamples)


def sections(records: Sequence[EnvironmentRecord]) -> Iterator[Section]:
    for record in records:
        if record.facts is None or record.step is None:
            yield content.failure(record.environment, record.status, record.detail)
        else:
            yield _section(record, record.facts)


def _section(record: EnvironmentRecord, facts: EnvironmentFacts) -> Section:
    name = record.environment
    sentences = [Conclusion(text, Tone.CAUTION, name) for text in cautions(record)]
    sentences += [
        Conclusion(text, subject="" if text.startswith(name) else name)
        for text in conclusions(record)
    ]
    if record.check is not None and record.check.status == Status.DISAGREES:
        text = f"{record.environment}: {next(physics_lines(record))}"
        sentences.insert(0, Conclusion(text, Tone.BAD))
    return Section(
        heading=f"{record.environment}: where a step's time goes",
        conclusions=sentences,
        facts=[_recorded(facts), _step_line(record), reset_line(record)],
        figures=[_figure(record)],
        tables=[_layers_table(record), _paths_table(record), _vectors_table(record)],
        notes=[*notes(record)],
    )


def conclusions(record: EnvironmentRecord) -> list[str]:
    """Return what follows from an environment's measurement, a sentence each; none without one."""
    if record.step is None or not record.layer_shares:
        return []
    sentences = [_shares(record), *unrepeated_lines(record)]
    if physics := _physics_conclusion(record):
        sentences.append(physics)
    return [*sentences, *_vector_conclusions(record)]


def _shares(record: EnvironmentRecord) -> str:
    others = [
        f"{layer.layer} {formats.whole_percent(layer.share.estimate)}{_costliest_wrapper(layer)}"
        for layer in record.layer_shares
        if layer.layer != Layer.PHYSICS and layer.share.estimate >= _NAMED_SHARE
    ][:_NAMED]
    physics = f"{formats.whole_percent(record.share(Layer.PHYSICS))} of env.step is physics"
    return f"{record.environment}: {'; '.join(filter(None, [physics, ', '.join(others)]))}"


def _costliest_wrapper(layer: LayerShare) -> str:
    """Return the wrapper that takes most, in parentheses, where wrappers take much of a step."""
    if layer.layer != Layer.WRAPPERS or layer.share.estimate < _MUCH_SHARE:
        return ""
    wrapper = layer.functions[0]
    return f" ({wrapper.name} {formats.whole_percent(wrapper.share)})"


def unrepeated_lines(record: EnvironmentRecord) -> list[str]:
    """Return a sentence with what was not the same in another pass; none if all was."""
    if record.facts is None or record.facts.repeats:
        return []
    fields = [str(each) for each in record.facts.unrepeated]
    if not fields:
        return ["With the same seed and actions, it does not do the same again."]
    if len(fields) > _NAMED:
        fields = [*fields[:_NAMED], f"{len(fields) - _NAMED} more"]
    differ = "differs" if len(fields) == 1 else "differ"
    physics = "; its physics is the same."
    if _has_other_physics(record.facts):
        physics = ", so its physics is not compared."
    lines = [f"With the same seed and actions, {listed(fields)} {differ} in another pass{physics}"]
    if left := record.facts.left_by_reset:
        lines.append(
            f"Its reset leaves {listed(left)} as {'it was' if len(left) == 1 else 'they were'}:"
            " mujoco.mj_resetData(model, data) at its beginning restores all fields."
        )
    return lines


def _has_other_physics(facts: EnvironmentFacts) -> bool:
    return any(each.is_physics for each in facts.unrepeated)


def _physics_conclusion(record: EnvironmentRecord) -> str:
    """Return how fast the same physics is without the environment; empty if not measured."""
    loop = next((path for path in record.physics_paths if path.path == BASE and path.speedup), None)
    if loop is None or loop.speedup is None:
        return ""
    start = "The same physics in a plain loop is not certainly faster than env.step"
    if is_faster(loop.speedup):
        start = f"The same physics runs {_times(loop.speedup)} as fast in a plain loop"
    better = [_rival(record, closed_loop) for closed_loop in (True, False)]
    return "; ".join([start, *filter(None, better)]) + "."


def is_faster(speedup: Interval | None) -> bool:
    """Return whether something is certainly faster."""
    return speedup is not None and speedup.low is not None and speedup.low > 1


def fastest(rows: Sequence[_Timed]) -> _Timed | None:
    return max(rows, key=lambda row: row.speedup.estimate if row.speedup else 0.0, default=None)


def place(path: PhysicsPath) -> str:
    """Return a path with its number of threads, as a sentence names it."""
    threads = nthread(path.options)
    return paths.title(path.path) + (f" on {threads} threads" if threads > 1 else "")


def _rival(record: EnvironmentRecord, closed_loop: bool) -> str:
    """Return the fastest path that is certainly faster than the plain loop; empty without one."""
    rivals = [path for path in record.physics_paths if path.closed_loop == closed_loop]
    rival = fastest([path for path in rivals if is_faster(path.over_loop)])
    if rival is None or rival.speedup is None:
        return ""
    loop = "a policy can choose each control" if closed_loop else "open loop"
    return f"{_times(rival.speedup)} with {place(rival)} ({loop})"


def _times(speedup: Interval) -> str:
    return f"{formats.factor(speedup.estimate)} times ({_interval(speedup)})"


def _vector_conclusions(record: EnvironmentRecord) -> list[str]:
    """Return which vectorised form is fastest, and what slows processes; none without any form."""
    timed = [vector for vector in record.vectors if vector.speedup is not None]
    best = fastest(timed)
    if best is None or best.speedup is None:
        return []
    first = "No vectorised form is certainly faster than one environment here."
    if is_faster(best.speedup):
        first = (
            f"{_named(best)} takes {_times(best.speedup)} as many steps per second as one"
            " environment."
        )
    processes = [vector for vector in timed if vector.form == VectorForm.ASYNC]
    return [first, *(_overhead(vector) for vector in processes[-1:] if _is_slowed(vector))]


def _is_slowed(vector: VectorSamples) -> bool:
    return vector.overhead_ns is not None and vector.overhead_ns > 0


def _overhead(vector: VectorSamples) -> str:
    assert vector.step_ns is not None and vector.overhead_ns is not None, "its cores are known"
    assert vector.ncore is not None, "its cores are known"
    cores = f"{vector.ncore} cores" if vector.ncore > 1 else "one core"
    total_ns = vector.step_ns + vector.overhead_ns
    return (
        f"A step in {_named(vector)} takes {duration(total_ns)}: {duration(vector.step_ns)} for"
        f" env.step on {cores}, and {duration(vector.overhead_ns)} to pass actions and results"
        " between processes and to wait."
    )


def _recorded(facts: EnvironmentFacts) -> str:
    episodes = f"{facts.nepisode} episodes" if facts.nepisode > 1 else "one episode"
    length = (
        f"of {plain(facts.episode_nstep, 3)} steps on average"
        if facts.episode_nstep
        else "which did not end"
    )
    wrappers = f" in {', '.join(facts.wrappers)}" if facts.wrappers else " without wrappers"
    steps = "a varying number of steps of the engine"
    if facts.frame_skip:
        steps = f"{count_of(facts.frame_skip, 'step')} of the engine"
    return (
        f"{facts.framework}: {facts.core}{wrappers}; each step takes {steps}:"
        f" {', '.join(facts.calls)}. {facts.nstep:,} steps with random actions (seed"
        f" {facts.seed}), {episodes}, {length}."
    )


def _step_line(record: EnvironmentRecord) -> str:
    assert record.step is not None, "it was timed"
    engine = f", {record.steps_per_s:,.0f} of the engine" if record.steps_per_s else ""
    return (
        f"env.step takes {duration(record.step.estimate)} ({_interval(record.step, duration)},"
        f" 95 %, {record.rounds} rounds): {record.env_steps_per_s:,.0f} steps per second{engine}."
    )


def _layers_table(record: EnvironmentRecord) -> DataTable:
    columns = (
        Column("layer"),
        Column("of env.step", _share_text),
        Column("95 %", formats.ends_in(_percent)),
        Column("time", duration),
        Column("calls", formats.digits(3), leaves=1),
    )
    assert record.step is not None, "it was timed"
    rows: list[Sequence[content.Cell]] = []
    for layer in record.layer_shares:
        is_shown = layer.share.estimate >= _LEAST_SHARE
        shares = (layer.share.estimate, layer.share)
        rows.append((layer.layer.value, *shares, layer.ns if is_shown else None, None))
        for function in layer.functions:
            is_shown = function.share >= _LEAST_SHARE
            ns = function.share * record.step.estimate if is_shown else None
            rows.append((f"  – {function.name}", function.share, None, ns, function.calls))
    return DataTable("Layers and functions of a step", columns, rows)


def _share_text(share: float) -> str:
    return formats.percent(share) if share >= _LEAST_SHARE else f"< {formats.percent(_LEAST_SHARE)}"


def reset_line(record: EnvironmentRecord) -> str:
    assert record.facts is not None and record.reset is not None and record.step is not None
    reset, length = record.reset, record.facts.episode_nstep
    share = _share_text(reset.episode_share)
    episode = (
        f"{share} of an episode of {plain(length, 3)} steps"
        if length
        else f"less than {share.removeprefix('< ')} of an episode, as none ended within"
        f" {record.facts.nstep:,} steps"
    )
    steps = plain(reset.ns.estimate / record.step.estimate, 2)
    return (
        f"env.reset takes {duration(reset.ns.estimate)} ({_interval(reset.ns, duration)}),"
        f" as long as {steps} steps: {episode}."
    )


def cautions(record: EnvironmentRecord) -> Iterator[str]:
    if record.timer is not None and abs(record.timer.sum.estimate - 1) > SUM_TOLERANCE:
        yield (
            f"The layers add up to {formats.percent(record.timer.sum.estimate)} of a step, which is"
            " too far from 100 %: the machine is too busy to trust these shares."
        )
    threads = max((nthread(path.options) for path in record.physics_paths), default=1)
    cores = record.median_cores
    if cores is not None and threads > 1 and cores < conditions.ENOUGH_CORES * threads:
        yield f"Threads got {plain(cores, 2)} of {threads} cores: other programs were running."


def physics_lines(record: EnvironmentRecord) -> Iterator[str]:
    facts, check = record.facts, record.check
    if facts is None or check is None:
        return
    match check.status:
        case Status.OK:
            yield (
                f"Same physics: a plain mj_step repeats {check.checked:,} calls of the engine to"
                f" the last bit. {check.covered:,} steps of the environment are compared,"
                f" {check.run} in a run."
            )
        case Status.DISAGREES:
            yield f"NOT the same physics as a plain loop: {check.detail}. Nothing is compared."
        case _ if not _has_other_physics(facts):  # otherwise the conclusions say so
            yield f"No comparison with a plain loop: {check.detail}."
    if check.holds is False:
        yield (
            "It sets another control for each step of the engine; the comparison replays these"
            " controls, without what computes them."
        )
    if facts.entered:
        yield f"Beside controls, it writes {listed(facts.entered)} between its steps."
    for change in record.changes:
        often = f"{change.count} times" if change.count > 1 else "once"
        when = "in a reset" if change.moment == Moment.RESET else "between its steps"
        yield f"It changes the model's {change.field} {when}, {often}."
    if facts.dm_control_release:
        yield f"{facts.dm_control_release}."


def _paths_table(record: EnvironmentRecord) -> DataTable:
    return DataTable.of(
        "The same physics without the environment",
        [(path, path.speedup) for path in record.physics_paths if path.speedup is not None],
        (Column("same physics by"), lambda row: row[0].path),
        (Column("options"), lambda row: describe_options(row[0].options)),
        (Column("env steps/s", formats.count), lambda row: row[0].env_steps_per_s),
        (Column("engine steps/s", formats.count, leaves=1), lambda row: row[0].steps_per_s),
        (Column("× env.step", formats.factor), lambda row: row[1].estimate),
        (Column("95 %", formats.ends), lambda row: row[1]),
        (Column("loop", leaves=2), lambda row: "closed" if row[0].closed_loop else "open"),
    )


def _vectors_table(record: EnvironmentRecord) -> DataTable:
    return DataTable.of(
        "Several environments at once, resets included",
        [(form, form.speedup) for form in record.vectors if form.speedup is not None],
        (Column("environments at once"), lambda row: row[0].form.value),
        (Column("number", formats.count), lambda row: row[0].nenv),
        (Column("env steps/s", formats.count), lambda row: row[0].env_steps_per_s),
        (Column("× one", formats.factor), lambda row: row[1].estimate),
        (Column("95 %", formats.ends), lambda row: row[1]),
        (
            Column("added to a step", duration),
            lambda row: row[0].overhead_ns if _is_slowed(row[0]) else None,
        ),
    )


def _figure(record: EnvironmentRecord) -> Figure:
    data = DataTable.of(
        "Layers of a step",
        [layer for layer in record.layer_shares if layer.share.estimate > 0],
        (Column("layer"), lambda layer: layer.layer.value),
        (Column("of env.step", formats.percent), lambda layer: layer.share.estimate),
        (Column("µs", formats.digits(3)), lambda layer: layer.ns / 1e3),
    )
    title = f"{record.environment}: layers of a step"
    return charts.share_bars(title, data, "layers", "µs", "µs of env.step")


def notes(record: EnvironmentRecord) -> Iterator[str]:
    """Yield what the figures rest on, and what went wrong with a path or a vectorised form."""
    if (timer := record.timer) is not None:
        total = f"{formats.percent(timer.sum.estimate)} ({_interval(timer.sum, _percent)})"
        yield (
            f"Timing {plain(timer.calls, 3)} calls a step adds {formats.percent(timer.share)} to it"
            f" ({duration(timer.call_ns)} a call), which is subtracted. The layers then add up to"
            f" {total} of a step that is timed as a whole."
        )
    yield from physics_lines(record)
    for path in record.physics_paths:
        if path.status not in (Status.OK, Status.UNAVAILABLE):
            yield f"{Variant(path.path, path.options)}: {path.status}: {path.detail}"
    for vector in record.vectors:
        if vector.status != Status.OK:
            yield f"{_named(vector)}: {vector.status}: {vector.detail}"
    if any(vector.speedup for vector in record.vectors):
        yield "Several environments: all steps return what they do in one environment."
    if record.no_vectors:
        yield f"No vectorised forms: {record.no_vectors}."
    if record.status != Status.OK:
        yield f"{record.environment}: {record.status}: {record.detail}"


def _named(vector: VectorSamples) -> str:
    return f"{vector.form} of {vector.nenv}"


def _interval(estimate: Interval, form: Form = formats.factor) -> str:
    return formats.ends(estimate, form) or "too few rounds"


def _percent(share: float) -> str:
    return f"{100 * max(0.0, share):.1f}"
