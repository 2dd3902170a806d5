"""What `mjbench compare` comes to: what follows for each model, its table, and notes."""

import shlex
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

from mjbench import formats
from mjbench.commands.compare import figures as comparison_figures
from mjbench.commands.compare.advice import Advice, clock_conclusion, conclusion, thread_conclusion
from mjbench.commands.compare.crossovers import crossovers, describe_crossover
from mjbench.commands.compare.judgement_notes import (
    judgement_conclusion,
    judgement_tables,
    version_lines,
)
from mjbench.commands.compare.results import ModelResults, PathResult, derive_all
from mjbench.errors import file_argument
from mjbench.formats import count_of, plain
from mjbench.paired.race_record import MAX_LAUNCHES, MIN_LAUNCHES
from mjbench.paths.accelerated import keyword_arguments
from mjbench.results.content import Column, Conclusion, DataTable, Section, Snippet, Tone
from mjbench.results.json_form import json_form
from mjbench.results.runs import Run
from mjbench.results.starts import starts_lines
from mjbench.simulation import engine_clock
from mjbench.simulation.engine_warnings import warning_lines
from mjbench.simulation.workload import Product
from mjbench.status import Status
from mjbench.verification.records import ModelRecord


def sections(models: Sequence[ModelResults]) -> Iterator[Section]:
    """Yield a section for each model, and what several models, or sizes, come to together."""
    for name in dict.fromkeys(each.model.model for each in models):
        yield model_section([each for each in models if each.model.model == name])
    yield from sections_together(models)


def model_sections(run: Run) -> Iterator[Section]:
    """Yield the section of the one model that a run is of, as soon as it is measured."""
    yield model_section(derive_all(run.records))


def summary(run: Run) -> Iterator[Section]:
    """Return what follows the models' sections at the end of a run."""
    return sections_together(derive_all(run.records))


def sections_together(models: Sequence[ModelResults]) -> Iterator[Section]:
    """Yield what several models, or one at several sizes, come to together."""
    results = [result for model in models for result in model.results]
    if rows := crossovers(results):
        crossing = dict.fromkeys(row.model for row in rows)
        yield Section(
            "From how many simulations on is an accelerated path faster?",
            [Conclusion(describe_crossover(row)) for row in rows],
            figures=[comparison_figures.crossover_figure(name, models) for name in crossing],
        )
    names = [*dict.fromkeys(each.model.model for each in models)]
    if len(names) > 1:
        against = " ".join(shlex.quote(file_argument(name)) for name in names[:2])
        advice = advice_table(models)
        if advice.rows:
            yield Section(
                "Advice: speed-ups over the plain loop; ? is not certain",
                [_advice_conclusion(models)],
                figures=[comparison_figures.advice_figure(models)],
                tables=[advice],
                notes=[
                    "Ways of stepping of each model; for one against the other: mjbench ab"
                    f" {against}"
                ],
                is_summary=True,
            )


def model_section(sizes: Sequence[ModelResults]) -> Section:
    """Return what follows for one model at each of its sizes, and one table of all sizes."""
    timed = [
        each
        for each in sizes
        if each.model.status == Status.OK
        or any(r.is_timed or r.agrees is False for r in each.results)
    ]
    conclusions = [each for size in sizes for each in _conclusions(size, len(sizes) > 1)]
    about = [line for each in timed for line in notes(each)]
    about += [line for each in sizes for line in detail_lines(each.model)]
    about += [line for each in timed for line in _what_would_decide(each)]
    compiled = [r for each in timed for r in each.results if r.compile_s is not None]
    if compiled:
        about.append("tracing and compiling are of one process of each path")
    headings = [heading(each.model) for each in sizes]
    return Section(
        heading=headings[0] if len(sizes) == 1 else sizes[0].model.model,
        conclusions=sorted(conclusions, key=lambda each: each.tone != Tone.CAUTION),
        facts=headings if len(sizes) > 1 else (),
        figures=[figure for each in timed for figure in comparison_figures.speedup_figures(each)],
        tables=[
            *([path_table(timed)] if timed else []),
            *([_compile_table(compiled)] if compiled else []),
            *judgement_tables([result for each in timed for result in each.results]),
        ],
        notes=list(dict.fromkeys(about)),
        snippets=[*_snippets([advice for each in timed for advice in each.advice])],
    )


def section_so_far(sizes: Sequence[ModelResults]) -> Section | None:
    """Return what is shown of a model while it is measured; None before there is a speed.

    Nothing is advised before a race has a few launches.
    """
    timed = [each for each in sizes if any(result.is_timed for result in each.results)]
    if not timed:
        return None
    race = timed[-1].race
    is_advised = race is None or len(race.launches) >= MIN_LAUNCHES
    conclusions = [*_conclusions(timed[-1], len(timed) > 1)]
    return Section(
        heading=heading(timed[-1].model),
        conclusions=[each for each in conclusions if is_advised or each.tone == Tone.CAUTION],
        tables=[path_table(timed) if is_advised else path_table(timed).without([""])],
    )


def _conclusions(model_results: ModelResults, names_size: bool) -> Iterator[Conclusion]:
    """Yield what the comparison on a model comes to.

    What to know before the numbers comes first, then what went wrong, then advice.

    Args:
      names_size: whether sentences say how many simulations there were, as others stand beside.
    """
    record = model_results.model
    subject, size = record.model, ""
    if record.nbatch:
        size = count_of(record.nbatch, "simulation")
        subject += "" if names_size else f", {size}"
    sized = f"{size}: " if names_size and size else ""
    for text in model_results.cautions:
        yield Conclusion(f"{sized}{text}", Tone.CAUTION, subject)
    if record.status == Status.INTERRUPTED and not any(r.is_timed for r in model_results.results):
        yield Conclusion("interrupted before a path was timed", Tone.UNSURE, record.model)
    if record.status not in (Status.OK, Status.INTERRUPTED):
        detail = record.detail.removeprefix(f"{record.model}: ")
        status = "" if record.status == Status.INPUT else f"{record.status}: "
        yield Conclusion(f"{status}{detail}", Tone.BAD, record.model)
    for result in model_results.results:
        if result.status == Status.DISAGREES:
            text = f"{result.variant} does other work than the plain loop: {result.agreement}"
            yield Conclusion(f"{sized}{text}", Tone.BAD, subject)
    for advice in reversed(model_results.advice):
        tone = Tone.GOOD if advice.speedup is not None else Tone.NEUTRAL
        tone = tone if advice.is_certain else Tone.UNSURE
        yield Conclusion(conclusion(advice, names_size), tone, subject)
    for result in model_results.results:
        if sentence := judgement_conclusion(result):
            yield Conclusion(f"{sized}{sentence}", Tone.NEUTRAL, subject)
    for row in model_results.thread_advice:
        tone = Tone.GOOD if row.is_certain else Tone.UNSURE
        yield Conclusion(thread_conclusion(row, names_size), tone, subject)
    if (clock := model_results.clock_advice) is not None:
        yield Conclusion(clock_conclusion(clock, names_size), Tone.GOOD, subject)


def _advice_conclusion(models: Sequence[ModelResults]) -> Conclusion:
    advice = [row for model_results in models for row in model_results.advice]
    speedups = [row.speedup.estimate if row.speedup else 1.0 for row in advice]
    ncertain = sum(row.is_certain for row in advice)
    ends = dict.fromkeys(formats.factor(end) for end in (min(speedups), max(speedups)))
    return Conclusion(
        f"{' to '.join(ends)} times as fast as the plain loop; {ncertain} of {len(advice)} are"
        " certain",
        Tone.GOOD if ncertain == len(advice) else Tone.UNSURE,
        f"Advice for {count_of(len(models), 'model')}",
    )


def advice_table(models: Sequence[ModelResults]) -> DataTable:
    advice = [row for model_results in models for row in reversed(model_results.advice)]
    sizes = {(row.result.model, row.result.nbatch) for row in advice}
    has_sizes = len({name for name, _ in sizes}) < len(sizes)
    names = formats.short_names([row.result.model for row in advice])
    return DataTable.of(
        "Advice",
        advice,
        (Column("model"), lambda row: names[row.result.model]),
        (
            Column("simulations", formats.count),
            lambda row: row.result.nbatch if has_sizes else None,
        ),
        (Column("loop", leaves=2), lambda row: row.loop.value),
        (Column("advised"), lambda row: f"{mark(row.is_certain)} {row.variant}"),
        (
            Column("speed-up", formats.factor),
            lambda row: row.speedup.estimate if row.speedup else 1.0,
        ),
        (Column("95 %", formats.ends), lambda row: row.speedup),
        (Column("× real time", times_real_time, leaves=1), lambda row: row.result.realtime_factor),
    )


def flat_rows(models: Sequence[ModelResults]) -> Iterator[Mapping[str, object]]:
    """Yield the results of paths as `mjbench.load` has them.

    `advised` is `certain` or `not certain` for a path that is advised, for open or closed loop.
    """
    for model_results in models:
        certain = {str(row.variant): row.is_certain for row in model_results.advice}
        for result in model_results.results:
            is_certain = certain.get(str(result.variant))
            advised = "" if is_certain is None else "certain" if is_certain else "not certain"
            yield {**json_form(result), "advised": advised}


def mark(is_certain: bool) -> str:
    return "✓" if is_certain else "?"


def marks(model_results: ModelResults) -> dict[str, str]:
    """Return the marks of advised paths: ✓ where that is certain, ? where it is not.

    The keys are the paths, each with its options.
    """
    return {
        str(row.variant): mark(row.is_certain)
        for row in sorted(model_results.advice, key=lambda row: not row.is_certain)
    }


def heading(model: ModelRecord) -> str:
    if model.facts is None or model.work is None:
        return model.model
    simulations = count_of(model.nbatch or 0, "simulation")
    sizes = f": {simulations} × {count_of(model.nstep or 0, 'step')}"
    if model.hold and model.hold > 1:
        sizes += f", each control held {model.hold} steps (frame_skip {model.hold})"
    return model.model + sizes


def detail_lines(model: ModelRecord) -> list[str]:
    """Return what a model's steps did, its starts, and what MuJoCo warned of."""
    if model.facts is None or model.work is None:
        return []
    work = model.work
    actuators = "" if model.facts.nu else ", no actuators"
    lines = [
        f"nv {model.facts.nv}, {model.facts.integrator}, {model.facts.solver}{actuators}; per step"
        f" {work.contacts:.1f} contacts ({model.start_contacts or 0} at the start),"
        f" {work.constraints:.1f} constraints, {work.solver_iterations:.1f} solver iterations"
    ]
    if model.returns:
        lines.insert(0, f"Each simulation returns {_RETURNS[model.returns]}")
    if model.reduced:
        lines.insert(0, "Sizes are reduced to keep a block short; --nbatch and --nstep set them")
    if model.spread is not None and model.spread != 1.0:
        lines.append(
            f"The spread of starts and controls is scaled by {model.spread:g}:"
            " with more, most simulations diverge"
        )
    lines += starts_lines(model.starts, with_warnings=False)
    if model.diverged:
        diverged = count_of(model.diverged, "simulation")
        lines.append(f"{diverged} diverged, left out of all figures ({model.divergence})")
    lines += warning_lines(model.warnings)
    if model.warnings:
        lines.append("mujoco.rollout and Batch.rollout stop a simulation at its first warning")
    return lines


_RETURNS = {
    Product.FINAL: "final states",
    Product.TRAJECTORY: "the state after every step",
    Product.SENSORS: "state and sensor data of every step",
}


def path_table(sizes: Sequence[ModelResults]) -> DataTable:
    """Return the table of the paths on one model, at each of its sizes.

    Advised paths have a mark (see `marks`). Whether paths agree is a column where one does not.
    """
    has_sizes, all_agree = len(sizes) > 1, not any(map(_unlike, sizes))
    return DataTable.of(
        "Paths",
        [(marks(each).get(str(r.variant)), r, r.speedup) for each in sizes for r in _shown(each)],
        (Column(""), lambda row: row[0]),
        (Column("path", wraps=True), lambda row: str(row[1].variant)),
        (Column("simulations", formats.count), lambda row: row[1].nbatch if has_sizes else None),
        (Column("ns/step", formats.count), lambda row: row[1].step_ns),
        (Column("speed-up", formats.factor), lambda row: row[2].estimate if row[2] else None),
        (Column("95 %", formats.ends), lambda row: row[1].interval),
        (Column("× real", times_real_time, leaves=1), lambda row: row[1].realtime_factor),
        (Column("loop", leaves=2), lambda row: row[1].loop.value),
        (Column("agrees"), lambda row: None if all_agree else agrees(row[1])),
    )


def _shown(model_results: ModelResults) -> list[PathResult]:
    """Return the results that have a row: what is unavailable here, or not begun, has none."""
    return [
        result
        for result in model_results.results
        if result.status != Status.UNAVAILABLE
        and (result.status, result.agrees) != (Status.INTERRUPTED, None)
    ]


def _unlike(model_results: ModelResults) -> list[PathResult]:
    """Return the results in the table that do not agree, or whose agreement is not known."""
    return [result for result in _shown(model_results) if agrees(result) != _AGREES]


def times_real_time(factor: float) -> str:
    return f"{factor:,.0f}" if factor >= 10 else plain(factor, 2)


_AGREES = "yes"


def agrees(result: PathResult) -> str:
    if result.status == Status.OK:
        return _AGREES if result.judgement is None else result.judgement.answer.value
    return "NO" if result.status == Status.DISAGREES else str(result.status)


def _compile_table(results: Sequence[PathResult]) -> DataTable:
    return DataTable.of(
        "Compiling",
        results,
        (Column("compiled"), lambda result: result.path),
        (Column("precision", leaves=4), lambda result: result.precision),
        (Column("device", leaves=3), lambda result: result.device),
        (Column("trace s", formats.tenths, leaves=5), lambda result: result.trace_s),
        (Column("compile s", formats.tenths), lambda result: result.compile_s),
        (Column("cached s", formats.tenths, leaves=1), lambda result: result.cached_compile_s),
        (Column("steady ns/step", formats.count), lambda result: result.step_ns),
        (Column("memory", leaves=2), _memory),
        (Column("break-even"), _break_even),
    )


def _break_even(result: PathResult) -> str:
    if result.step_ns is None or result.speedup is None:
        return ""
    if result.overtakes_after_steps is None:
        return "never: the plain loop is faster"
    return f"after {result.overtakes_after_steps:,.0f} steps"


def _memory(result: PathResult) -> str:
    sizes = {"": result.memory_bytes, "GPU ": result.gpu_memory_bytes}
    return ", ".join(f"{kind}{n / 2**20:,.0f} MiB" for kind, n in sizes.items() if n)


def notes(model_results: ModelResults) -> list[str]:
    """Return what a reader of the table must know: reasons, and how many cores there were."""
    model, race = model_results.model, model_results.race
    results, lines = model_results.results, list[str]()
    if model.status == Status.OK and not _unlike(model_results):
        lines.append("All paths agree with the plain loop.")
    if model_results.clock_advice is not None:
        lines.append(engine_clock.OFF_NOTE)
    if race is not None and race.status not in (Status.OK, Status.INTERRUPTED):
        lines.append(f"The race ended early: {race.status}: {race.detail}")
    lines += [
        f"{r.variant}: {r.status}: {r.detail}"
        for r in results
        if r.detail
        and r.status != Status.UNAVAILABLE
        and (r.status, r.detail) != (model.status, model.detail)
    ]
    lines += _unavailable_lines(results)
    lines += version_lines(results)
    lines += [
        f"{r.path}: timed in one process, so its speed-up has no interval"
        for r in results
        if r.is_accelerated and r.speedup is not None
    ]
    lines += [
        f"{result.path}: {keyword_arguments(result.buffer_sizes).removeprefix(', ')} suffice for"
        f" {result.nbatch} simulations like these: twice what this run needed at most"
        for result in results
        if result.buffer_sizes and result.agrees
    ]
    # where threads had too few cores, the heading says so
    if model_results.cores is not None and not model_results.disturbances:
        lines.append(f"Threads had {model_results.cores} (calibration).")
    return lines


def _what_would_decide(model_results: ModelResults) -> Iterator[str]:
    race = model_results.race
    statuses = {race.status if race else None, model_results.model.status}
    if race is None or not race.is_cut_short or statuses != {Status.OK}:
        return
    count = len(race.launches)
    if count >= MAX_LAUNCHES:
        yield (
            f"The race ended undecided after {count} launches, its most. End other programs before"
            " you repeat it (`mjbench doctor`)."
        )
        return
    launches = count_of(count, "launch") if count == 1 else f"{count} launches"
    yield f"The budget ended the race after {launches}: a longer --budget makes it more certain."


def _unavailable_lines(results: Sequence[PathResult]) -> list[str]:
    paths_by_reason = defaultdict[str, dict[str, None]](dict)
    for result in (each for each in results if each.status == Status.UNAVAILABLE):
        paths_by_reason[result.detail][result.path] = None
    return [
        f"Not compared: {', '.join(names)}: {reason}" for reason, names in paths_by_reason.items()
    ]


def _snippets(all_advice: Sequence[Advice]) -> Iterator[Snippet]:
    for snippet in dict.fromkeys(advice.snippet for advice in all_advice):
        same = [advice for advice in all_advice if advice.snippet == snippet]
        loops = " and ".join(dict.fromkeys(f"{advice.loop} loop" for advice in same))
        yield Snippet(f"{same[0].variant} ({loops})", snippet)
