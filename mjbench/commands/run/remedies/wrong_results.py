"""What makes a program's results wrong, whatever it costs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from mjbench.commands.lint.check import Finding
from mjbench.commands.run.activities import Place
from mjbench.commands.run.call_times import ProgramCalls
from mjbench.commands.run.hook import call_clock
from mjbench.commands.run.remedies.remedy import Remedy, RemedyKind
from mjbench.commands.run.source_loops import lines_reading
from mjbench.simulation import engine_warnings

# Fields of MjData that a step computes only for sensors that need them.
_FORCES = ("cfrc_ext", "cfrc_int", "cacc")
# What else only a run shows, and what to do about it.
_FACTS: Mapping[str, str] = {
    call_clock.SHARED_DATA: "two threads step one MjData at the same time: give each thread its"
    " own",
    call_clock.HALVES: "mj_step2 integrates by Euler, although the model asks for Runge-Kutta: call"
    " mj_step, or choose another integrator",
    call_clock.COPIED_ENVIRONMENT: "a copy of an environment of Gymnasium begins anew, not in the"
    " state of its original: copy that state with mj_getState and mj_setState"
    " (mjSTATE_INTEGRATION), and what wrappers hold",
}


def wrong_results(
    findings: Sequence[Finding],
    calls: ProgramCalls,
    files: Sequence[str] = (),
    computes_forces: bool | None = None,
) -> list[Remedy]:
    """Return what makes results wrong; `computes_forces` is whether a step computes `_FORCES`."""
    listed = list(_unfilled(calls, files) if computes_forces is False else ())
    for incident in filter(lambda each: each.is_wrong, calls.incidents):
        meaning = engine_warnings.MEANINGS.get(incident.name, "the engine warned")
        times = "once" if incident.count == 1 else f"{incident.count:,} times"
        warning = f"{meaning} ({times}, warning {incident.name})"
        listed.append(_wrong(incident.place, _FACTS.get(incident.name, warning)))
    halves = {i.place.file for i in calls.incidents if i.name == call_clock.HALVES}
    for finding in findings:
        if finding.is_wrong_result and not (finding.code == "MJB008" and finding.file in halves):
            place = Place(finding.file, finding.line, "")
            listed.append(replace(_wrong(place, finding.message), code=finding.code))
    return list(dict.fromkeys(listed))  # one line may have several, all with one remedy


def _unfilled(calls: ProgramCalls, files: Sequence[str]) -> Iterator[Remedy]:
    if any(call.callee == "mj_rnePostConstraint" for call in calls.calls):
        return
    seen = set()
    for file in files:
        for line, name in lines_reading(file, _FORCES):
            if name not in seen:
                seen.add(name)
                text = (
                    f"{name} stays zero, since no sensor of the model needs it: call"
                    " mj_rnePostConstraint(model, data) before it is read"
                )
                yield _wrong(Place(file, line, ""), text)


def _wrong(place: Place, text: str) -> Remedy:
    return Remedy(RemedyKind.RESULT, None, place, text, None, None)
