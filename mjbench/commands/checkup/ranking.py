"""What a check-up advises, ranked: wrong results first, then what keeps results, by gain.

Their figures are those of the command that looks closer.
"""

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from mjbench import formats
from mjbench.commands.checkup.item import CheckupItem, GainGroup, GainUnit, ResultChange
from mjbench.commands.checkup.result import CheckedPart, Combination
from mjbench.commands.compare import advice
from mjbench.commands.compare.results import ModelResults, derive_all
from mjbench.commands.env import show as environment
from mjbench.commands.env.result import EnvironmentRecord
from mjbench.commands.lint.check import Finding
from mjbench.commands.lint.show import finding_place
from mjbench.commands.profile.measure import ProfileRow
from mjbench.commands.run import show as program
from mjbench.commands.run.remedies.remedy import Basis, Remedy, RemedyKind
from mjbench.commands.run.result import ProgramRow
from mjbench.commands.tune import expected_gains, knobs
from mjbench.commands.tune import notes as tuning_notes
from mjbench.commands.tune import show as tuning
from mjbench.commands.tune.result import Effect, Recommendation, TuneRecord
from mjbench.commands.tune.settings import NO_CHANGE, Setting, label
from mjbench.errors import file_argument
from mjbench.interval import Interval
from mjbench.paired.race_record import Loop
from mjbench.paired.records import VerdictRow
from mjbench.results import starts
from mjbench.results.runs import Run
from mjbench.simulation import engine_clock, engine_warnings
from mjbench.simulation.starts import Starts
from mjbench.verification.plan import WITHOUT_TIMER, Variant

# Lines of a program, and remedies, that are listed at most.
_MOST_OF_PROGRAM = 6
# Settings that err by more, as a share of the motion, are not listed: what they gain is no longer
# of the same motion, and who only wants to save time would not expect it.
_MOST_ERROR = 0.05
_LOOPS = {Loop.CLOSED: " (RL)", Loop.OPEN: " (open loop)", None: " (RL, open loop)"}
_CHANGES = {
    Effect.FREE: ResultChange.NONE,
    Effect.EQUIVALENT: ResultChange.TOLERANCE,
    Effect.APPROXIMATE: ResultChange.ERROR,
}


def items(run: Run) -> list[CheckupItem]:
    """Return what a check-up advises, the most important first; those of a loop in its order.

    Of the ways of stepping, the one for RL comes first.
    """
    unranked = [*_items(run)]
    best = max((each.times for each in unranked if each.group == GainGroup.PATHS), default=1.0)

    def rank(item: CheckupItem) -> tuple[int, float, bool]:
        times = best if item.group == GainGroup.PATHS else item.times
        is_ranked = item.gain is None or item.group == GainGroup.LOOP  # `run` has ranked these
        return importance(item), 0.0 if is_ranked else -times, item.loop == Loop.OPEN

    return sorted(unranked, key=rank)


def importance(item: CheckupItem) -> int:
    """Return 0 for a wrong result, 1 for what keeps results, 2 for the rest, 3 without a gain.

    What halves the work without a larger error is as important as what keeps results.
    """
    if item.change == ResultChange.CORRECTED:
        return 0
    if item.gain is None:
        return 3
    is_important = item.group == GainGroup.LOOP or item.change.keeps or item.is_halving
    return 1 if is_important else 2


def short_name(target: str) -> str:
    """Return a target, or the name of a file, for sentences: without its folder."""
    is_of_package = ":" in target
    return target if is_of_package else target.rpartition("/")[2] or target


def _items(run: Run) -> Iterator[CheckupItem]:
    parts = run.of_type(CheckedPart)
    if not parts:
        return
    target = shlex.quote(file_argument(parts[0].target))
    searches = run.of_type(TuneRecord)
    yield from _wrong_of_model(run, target)
    for model_results in derive_all(run.records):
        yield from _of_paths(model_results, target, searches)
    for record in searches:
        yield from _of_settings(record, target)
    rows = run.of_type(ProgramRow)
    for row in rows:
        yield from _of_program(row, target)
    for part in parts:
        yield from _of_source(part.findings, rows)
    for environment_record in run.of_type(EnvironmentRecord):
        yield from _of_environment(environment_record, target)


# -- a model ---------------------------------------------------------------------------------------


def _wrong_of_model(run: Run, target: str) -> Iterator[CheckupItem]:
    """Yield what makes the results of a model wrong, or depend on a limit."""
    started: list[Starts] = [
        row.steps.starts for row in run.of_type(ProfileRow) if row.steps and row.steps.starts
    ]
    lines: list[str] = []
    for each in derive_all(run.records):
        model = each.model
        if model.starts is not None:
            started = [model.starts]
        if model.diverged:
            lines.append(
                f"{model.diverged} of {model.diverged + (model.nbatch or 0)} simulations diverge"
                f" ({model.divergence}): MuJoCo resets them, and a log goes on from the start; use"
                " a smaller timestep, or smaller controls"
            )
        lines += engine_warnings.warning_lines(model.warnings)
    for window in (each.window for each in started):
        lines += [
            f"{line}; raise iterations in <option> until they do not"
            for line in (starts.limited_lines(window) if window else ())
        ]
    for line in dict.fromkeys(lines):
        yield CheckupItem(
            action=line, change=ResultChange.CORRECTED, command=f"mjbench compare {target}"
        )


def _of_paths(
    model_results: ModelResults, target: str, searches: Sequence[TuneRecord]
) -> Iterator[CheckupItem]:
    """Yield the ways of stepping that `compare` advises, and the timer, unless settings have it."""
    command = f"mjbench compare {target}"
    advised = [each for each in model_results.advice if each.speedup is not None]
    for row in {str(each.variant): each for each in advised}.values():
        loops = {each.loop for each in advised if each.variant == row.variant}
        loop = None if len(loops) > 1 else row.loop
        yield CheckupItem(
            action=f"{advice.described(row.variant)}{_LOOPS[loop]}",
            loop=loop,
            variant=row.variant,
            gain=row.speedup,
            is_certain=row.is_certain,
            unit=GainUnit.PLAIN_LOOP,
            change=ResultChange.NONE,
            group=GainGroup.PATHS,
            command=command,
            snippet=row.snippet,
        )
    settings = [
        setting
        for record in searches
        for each in _offered(record)
        if each.effect != Effect.APPROXIMATE
        for setting in each.settings
    ]
    clock = model_results.clock_advice
    if clock is not None and not any(setting.loop.is_clock_off for setting in settings):
        yield CheckupItem(
            action=f"{engine_clock.OFF_CODE}: timer off",
            variant=WITHOUT_TIMER,
            gain=clock.speedup,
            unit=GainUnit.PLAIN_LOOP,
            change=ResultChange.NONE,
            group=GainGroup.TIMER,
            command=command,
            snippet=clock.snippet,
        )


def far_settings(record: TuneRecord, target: str) -> Iterator[str]:
    """Yield the settings that are the fastest, but err too much to be listed."""
    far = [each for each in record.front if not _is_close(each)]
    fastest = min(far, key=_time, default=None)
    if fastest is None or any(_time(each) <= _time(fastest) for each in _offered(record)):
        return
    error = fastest.error
    size = f"{tuning_notes.percent(error.share)} of the motion" if error else "unknown size"
    yield (
        f"Not listed: {label(fastest.settings)}: {formats.factor(1 / _time(fastest))}"
        f" × as fast, but with an error of {size}: mjbench tune {target}"
    )


def _time(recommendation: Recommendation) -> float:
    return recommendation.ratio.estimate


def _is_close(recommendation: Recommendation) -> bool:
    """Return whether settings err little enough to be listed."""
    error = recommendation.error
    is_small = error is not None and error.share <= _MOST_ERROR
    return recommendation.effect != Effect.APPROXIMATE or is_small


def _offered(record: TuneRecord) -> list[Recommendation]:
    """Return what `tune` recommends, and the fastest settings that change something."""
    offered = [each for each in tuning.advised(record) if _is_close(each)]
    if any(each.effect == Effect.APPROXIMATE for each in offered):
        return offered
    changing = [
        each for each in record.front if each.effect == Effect.APPROXIMATE and _is_close(each)
    ]
    return [*offered, *sorted(changing, key=_time)[:1]]


def _of_settings(record: TuneRecord, target: str) -> Iterator[CheckupItem]:
    """Yield settings that err little, and those that give up something else."""
    for each in _offered(record):
        yield _of_faster(
            each.settings,
            each.ratio,
            target,
            change=_CHANGES[each.effect],
            change_detail=_in_other_runs(each.settings) if each.effect == Effect.FREE else "",
            error=each.error.share if each.error and each.effect == Effect.APPROXIMATE else None,
            slow_effects=tuning.slow_lines(each.settings),
            is_halving=each.is_allowed
            and any(knobs.halves(one, record.stages or {}) for one in each.settings),
        )
    for known in expected_gains.unjudged(record):
        yield _of_faster(
            (known.setting,),
            Interval(1 / known.factor, None, None),
            target,
            counted=known.reason,
            change=_CHANGES[known.effect],
            slow_effects=tuning.slow_lines([known.setting]),
            is_halving=True,
        )
    for attempt in tuning.faster_alone(record):
        accuracy, loses = attempt.accuracy, attempt.settings[0].loses
        if attempt.gives_up and (accuracy is None or accuracy.distance.share <= _MOST_ERROR):
            assert attempt.ratio is not None, "it is certainly faster"
            yield _of_faster(
                attempt.settings,
                attempt.ratio,
                target,
                change=ResultChange.STATED,
                change_detail=f"gives up {loses}" if loses else tuning.changes(attempt),
                slow_effects=tuning.slow_lines(attempt.settings) if loses else (),
            )


def _in_other_runs(settings: Sequence[Setting]) -> str:
    """Return what settings that changed nothing may change in states that were not seen."""
    edited = [knobs.find(each.knob) for each in settings if each.loop == NO_CHANGE]
    return "; ".join(
        f"{knob.name}: {knob.changes[:1].lower()}{knob.changes[1:].removesuffix('.')}"
        for knob in {knob.name: knob for knob in edited}.values()
    )


def _of_faster(
    settings: Sequence[Setting], ratio: Interval, target: str, **fields: Any
) -> CheckupItem:
    """Return the item of settings; `fields`: what they change."""
    return CheckupItem(
        action=f"settings: {label(settings)}",
        settings=settings,
        gain=ratio.inverse,
        unit=GainUnit.SIMULATED_SECOND,
        group=GainGroup.SETTINGS,
        command=f"mjbench tune {target}",
        snippet="\n".join(snippet.code for snippet in tuning.to_apply(settings)),
        **fields,
    )


def combination_gain(verdict: VerdictRow | None) -> Interval | None:
    """Return how many times the plain loop a combination is; None where that is not certain.

    It is not one of the same results where the work differs.
    """
    if verdict is None or verdict.ratio is None or verdict.changed_work:
        return None
    gain = verdict.ratio.inverse
    return gain if gain.is_above(1.0) else None


def combination_command(combination: Combination, target: str) -> str:
    settings = {"path": combination.variant.path, **combination.variant.options}
    if not combination.has_timer:
        settings["timer"] = "off"
    model = "tuned.xml" if combination.settings else target
    texts = [f"{name}={value}" for name, value in settings.items()]
    return f"mjbench ab {target} {model},{','.join(texts)}"


# -- a program -------------------------------------------------------------------------------------


def _of_program(row: ProgramRow, target: str) -> Iterator[CheckupItem]:
    """Yield what `run` says: wrong results, then what its first loop should change."""
    command = f"mjbench run {target}"
    for remedy in row.wrong:
        yield CheckupItem(action=placed(remedy), change=ResultChange.CORRECTED, command=command)
    remedies = program.first_loop(row).remedies if row.loops else ()
    for remedy in [each for each in remedies if each.is_certain][:_MOST_OF_PROGRAM]:
        keeps = remedy.effect in ("", "nothing")
        yield CheckupItem(
            action=placed(remedy),
            gain=remedy.share_saved,
            unit=GainUnit.LOOP_SHARE,
            is_bound=remedy.basis == Basis.BOUND,
            change=ResultChange.NONE if keeps else ResultChange.STATED,
            change_detail="" if keeps else remedy.effect,
            group=GainGroup.LOOP,
            command=command,
        )


def placed(remedy: Remedy) -> str:
    place = f"{short_name(remedy.place.file)}:{remedy.place.line}: " if remedy.place else ""
    code = f" ({remedy.code})" if remedy.code else ""
    # what a line mostly does may differ from run to run
    subject = "" if remedy.kind == RemedyKind.LINE else program.subject(remedy)
    return f"{place}{subject}{remedy.text}{code}"


def _of_source(findings: Sequence[Finding], rows: Sequence[ProgramRow]) -> Iterator[CheckupItem]:
    """Yield what `lint` finds, unless the program ran: `run` then says what it costs."""
    if any(row.loops or row.wrong or row.has_crashed for row in rows):
        return
    for finding in findings:
        place = finding_place(replace(finding, file=short_name(finding.file)))
        yield CheckupItem(
            action=f"{place}: {finding.message} ({finding.code})",
            change=ResultChange.CORRECTED if finding.is_wrong_result else ResultChange.NONE,
            command=f"mjbench lint {finding.file}",
        )


# -- an environment --------------------------------------------------------------------------------


def _of_environment(record: EnvironmentRecord, target: str) -> Iterator[CheckupItem]:
    """Yield what `env` says: what is not repeated, vectorised forms, and the physics alone."""
    command = f"mjbench env {target}"
    for line in environment.unrepeated_lines(record):
        yield CheckupItem(action=line, change=ResultChange.CORRECTED, command=command)
    forms = [form for form in record.vectors if environment.is_faster(form.speedup)]
    if form := environment.fastest(forms):
        yield CheckupItem(
            action=f"step {form.nenv} environments in one {form.form}",
            gain=form.speedup,
            unit=GainUnit.ONE_ENVIRONMENT,
            change=ResultChange.NONE,
            group=GainGroup.VECTORS,
            command=command,
        )
    paths = [path for path in record.physics_paths if environment.is_faster(path.speedup)]
    for closed_loop, loop in ((True, ""), (False, ", with controls known beforehand")):
        path = environment.fastest([path for path in paths if path.closed_loop == closed_loop])
        if path is not None:
            yield CheckupItem(
                action=f"step its physics yourself: {environment.place(path)}{loop}",
                variant=Variant(path.path, path.options),
                gain=path.speedup,
                unit=GainUnit.ENV_STEP,
                change=ResultChange.STATED,
                change_detail="the same physics, without observation, reward and wrappers",
                group=GainGroup.PHYSICS,
                command=command,
            )
