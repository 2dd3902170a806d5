"""Which path is advised on each of several machines, for each model at each size.

Nothing is averaged, and unlike things are apart: models, sizes, products, start states, and on one
machine also software.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from mjbench.comparison.records import ModelRecord
from mjbench.paired.race_record import Loop
from mjbench.report import formats
from mjbench.report.advice import Advice, advise
from mjbench.report.comparison import mark
from mjbench.report.path_speedups import derive_all, disturbed
from mjbench.simulation.starts import Starts
from mjbench.simulation.workload import Product
from mjbench.store.machine_identity import RunSoftware, software_names
from mjbench.store.runs import InputFile, Run

# Models that a sentence names, at most.
_MOST_NAMES = 10


@dataclass(frozen=True)
class AdviceQuestion:
    """What advice of several machines must share to stand side by side.

    Attributes:
      hold: steps per control.
      returns: what every run returned.
      files: of the model, start states and controls, where they are the user's.
      loop: for which a path is advised.
    """

    model: str
    nbatch: int | None
    nstep: int | None
    hold: int | None
    returns: Product | None
    seed: int | None
    starts: Starts | None
    files: tuple[InputFile, ...]
    loop: Loop

    @property
    def name(self) -> str:
        """The question for people, such as `humanoid, 64 × 200 steps, open loop`."""
        parts = [self.model]
        if self.nbatch is not None:
            parts.append(f"{self.nbatch:,} × {self.nstep:,} steps")
        if self.hold is not None and self.hold > 1:
            parts.append(f"each control held {self.hold} steps")
        if self.returns not in (None, Product.FINAL):
            parts.append(f"returns {self.returns}")
        return ", ".join([*parts, f"{self.loop} loop"])


@dataclass(frozen=True)
class MachineAdvice:
    """What one machine says to a question.

    Attributes:
      machine: its name, with its software where it has several.
      advice: of each run that asked; usually one.
      detail: why there is none; empty otherwise.
      disturbances: what disturbed its runs, a clause each.
    """

    machine: str
    advice: Sequence[Advice] = ()
    detail: str = ""
    disturbances: Sequence[str] = ()

    @property
    def path(self) -> str:
        """The path that all its runs advise; empty where they differ, and where there is none."""
        paths = {advice.path for advice in self.advice}
        return paths.pop() if len(paths) == 1 else ""


@dataclass(frozen=True)
class AdviceAcross:
    """Which path is advised on each machine.

    Attributes:
      question: for which model, at which size.
      machines: what each says.
    """

    question: AdviceQuestion
    machines: Sequence[MachineAdvice]


def advice_across(runs: Sequence[Run], names: Sequence[str]) -> list[AdviceAcross]:
    """Return which path is advised on each machine, in the order of the runs.

    A model that failed on a machine before its size was known is part of every question about it.
    `names` has that of each run's machine.
    """
    answers: dict[AdviceQuestion, dict[str, MachineAdvice]] = defaultdict(dict)
    failed: list[tuple[AdviceQuestion, MachineAdvice]] = []
    for run, name in zip(runs, _with_software(runs, names), strict=True):
        for results in derive_all(run.records) if run.of_type(ModelRecord) else ():
            question = _question(results.model, run)
            if results.model.nbatch is None:
                detail = f"{results.model.status}: {results.model.detail}"
                failed.append((question, MachineAdvice(name, detail=detail)))
                continue
            advice = advise(results)
            why_none = "no plain loop was timed"
            if results.is_former:
                why_none = "timed by an earlier version of mjbench"
            for loop in Loop:
                answer = answers[replace(question, loop=loop)]
                earlier = answer.get(name, MachineAdvice(name))
                given = [*earlier.advice, *(each for each in advice if each.loop == loop)]
                disturbances = [*earlier.disturbances, *results.disturbances]
                detail = "" if given else why_none
                answer[name] = MachineAdvice(name, given, detail, disturbances)
    for question, failure in failed:
        for other, of_other in answers.items():
            if (other.model, other.files) == (question.model, question.files):
                of_other.setdefault(failure.machine, failure)
    return [AdviceAcross(question, list(a.values())) for question, a in answers.items()]


def cell(machine: MachineAdvice) -> str:
    """Return the path that is advised on a machine, with its speed-up, for a cell of a table."""
    texts = []
    for advice in machine.advice:
        text = f"{mark(advice.is_certain)} {advice.variant}"
        if (gain := advice.speedup) is not None:  # the plain loop has none over itself
            text += f" {formats.factor(gain.estimate)}×{formats.in_brackets(gain)}"
        texts.append(text)
    return "; ".join(dict.fromkeys(texts)) or machine.detail


def cautions(all_advice: Sequence[AdviceAcross]) -> list[str]:
    """Return what disturbed the runs of machines, a sentence each."""
    sentences = (
        f"{machine.machine}, {across.question.model}: {disturbed(machine.disturbances)}"
        for across in all_advice
        for machine in across.machines
        if machine.disturbances
    )
    return list(dict.fromkeys(sentences))


def describe(all_advice: Sequence[AdviceAcross]) -> Iterator[str]:
    """Yield sentences: each question that machines answer differently, then what they agree on."""
    agreed: dict[tuple[Loop, str, int], list[str]] = defaultdict(list)
    for across in all_advice:
        total = len(across.machines)
        counts = Counter(
            m.path or ("undecided" if m.advice else "not measured") for m in across.machines
        )
        (first, count), *others = counts.most_common()
        if not any(machine.advice for machine in across.machines):
            continue  # the table says why
        if count == total:
            agreed[across.question.loop, first, total].append(across.question.model)
            continue
        rest = "".join(f", {path} on {number}" for path, number in others)
        yield f"{across.question.name}: {first} on {count} of {total} machines{rest}"
    for (loop, path, total), models in agreed.items():
        names = list(dict.fromkeys(models))
        listed = ", ".join(names[:_MOST_NAMES])
        more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
        machines = formats.all_machines(total)
        if total == 1:
            machines = f"the only machine that measured {'it' if len(names) == 1 else 'them'}"
        yield f"{loop.capitalize()} loop: {path} on {machines}, for {listed}{more}"


def _question(record: ModelRecord, run: Run) -> AdviceQuestion:
    starts = record.starts
    named = [record.model, *filter(None, (starts.file, starts.controls_file) if starts else ())]
    return AdviceQuestion(
        model=record.model,
        nbatch=record.nbatch,
        nstep=record.nstep,
        hold=record.hold,
        returns=record.returns,
        seed=record.seed,
        starts=starts,
        files=run.header.files_of(named),
        loop=Loop.OPEN,
    )


def _with_software(runs: Sequence[Run], names: Sequence[str]) -> list[str]:
    """Return the names of machines, each with its software where it has several."""
    softwares: dict[str, list[RunSoftware]] = defaultdict(list)
    for run, name in zip(runs, names, strict=True):
        if run.of_type(ModelRecord):
            softwares[name].append(RunSoftware.of(run.header.machine))
    details = {name: software_names(of_machine) for name, of_machine in softwares.items()}
    named = []
    for run, name in zip(runs, names, strict=True):
        detail = details.get(name, {}).get(RunSoftware.of(run.header.machine))
        named.append(f"{name} ({detail})" if detail else name)
    return named
