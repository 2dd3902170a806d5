"""What several machines answer to the same questions: one table, with a column a machine.

A question is which path is advised for a model, or whether one of two targets is slower. Nothing is
averaged over machines, and questions about different work are apart. Verdicts of all machines are
decided together (see `paired.family`).
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from mjbench import formats
from mjbench.commands.compare.advice import Advice
from mjbench.commands.compare.results import derive_all
from mjbench.commands.compare.show import mark
from mjbench.commands.versions import family
from mjbench.commands.versions import show as verdicts
from mjbench.host import disturbance
from mjbench.interval import Interval
from mjbench.paired.metrics import METRICS
from mjbench.paired.outcomes import Verdict
from mjbench.paired.race_record import Loop
from mjbench.paired.records import VerdictRecord, VerdictRow
from mjbench.releases import release_names
from mjbench.results.content import Column, Conclusion, DataTable, Section, Tone
from mjbench.results.machine_identity import MachineIdentity, identify
from mjbench.results.runs import Run
from mjbench.simulation.workload import Product
from mjbench.verification.records import ModelRecord

# Machines have a column each where the table is no wider than so many characters; otherwise each
# cell of the table is a row.
_MOST_WIDTH = 150
# Sentences, and questions or machines that one of them names, at most; the table has all.
_MOST_SENTENCES, _MOST_NAMES = 30, 10

_UNDECIDED = "undecided"
_TONES = {Verdict.SLOWER: Tone.BAD, Verdict.FASTER: Tone.GOOD}


@dataclass(frozen=True)
class MachineAnswer:
    """What one machine answers to a question.

    Attributes:
      question: such as `humanoid, 64 × 200 steps, open loop`, or `humanoid, 3.17.0 → 4.0.0`.
      answer: the advised path, the certain verdict, or `undecided`; empty where nothing was timed.
      verdict: of a comparison; None where it is not certain, and of an advised path.
      ratio: how many times as fast as the plain loop the path is, or new time over old.
      text: answer, ratio and what else to know, for a cell of a table.
    """

    question: str
    model: str
    machine: str
    answer: str
    verdict: Verdict | None
    ratio: Interval | None
    text: str


@dataclass(frozen=True)
class _Question:
    """A question.

    Attributes:
      about: what is timed, such as `humanoid, 3.17.0 → 4.0.0`.
      size: of the work, such as `64 × 200 steps`; empty where the measurement failed before it was
        known.
      loop: for which a path is advised; empty for a verdict.
      facts: what else answers must share.
    """

    about: str
    size: str = ""
    loop: str = ""
    facts: str = ""


@dataclass(frozen=True)
class Machines:
    """Runs of several machines.

    Attributes:
      identities: the machine of each run.
      together: what all verdicts show together, in a sentence; empty without verdicts.
      cautions: what disturbed runs, a sentence each.
    """

    identities: Sequence[MachineIdentity]
    answers: Sequence[MachineAnswer]
    together: str
    cautions: Sequence[str]

    @property
    def has_several(self) -> bool:
        return len(set(self.identities)) > 1

    @property
    def by_question(self) -> Mapping[str, Sequence[MachineAnswer]]:
        grouped: dict[str, list[MachineAnswer]] = defaultdict(list)
        for answer in self.answers:
            grouped[answer.question].append(answer)
        return grouped


def of_runs(runs: Sequence[Run]) -> Machines:
    identities = identify([run.header.machine for run in runs])
    names = _with_mujoco(runs, [identity.name for identity in identities])
    verdict_answers, together = _verdict_answers(runs, names)
    answers = [*verdict_answers, *_advice_answers(runs, names)]
    cautions = [
        f"{name}, {results.model.model}: {disturbance.sentence(results.disturbances)}"
        for run, name in zip(runs, names, strict=True)
        for results in derive_all(run.records)
        if results.disturbances
    ]
    return Machines(identities, _named(answers), together, list(dict.fromkeys(cautions)))


def _with_mujoco(runs: Sequence[Run], names: Sequence[str]) -> list[str]:
    """Return the names of machines, with MuJoCo's version where one ran several."""
    versions = [run.header.machine.versions.get("mujoco", "unknown") for run in runs]
    of_machine: dict[str, set[str]] = defaultdict(set)
    for run, name, version in zip(runs, names, versions, strict=True):
        if run.of_type(ModelRecord):
            of_machine[name].add(version)
    return [
        f"{name} (MuJoCo {version})" if len(of_machine[name]) > 1 else name
        for name, version in zip(names, versions, strict=True)
    ]


def _named(answers: Sequence[tuple[_Question, MachineAnswer]]) -> list[MachineAnswer]:
    """Return answers with the names of their questions, a number where only other facts differ.

    A failure whose size is not known belongs to the only question that shares all else.
    """
    sized: dict[tuple[str, str], list[_Question]] = defaultdict(list)
    for question in dict.fromkeys(question for question, _ in answers if question.size):
        sized[question.about, question.loop].append(question)
    facts: dict[str, list[str]] = defaultdict(list)
    named = []
    for question, answer in answers:
        others = sized[question.about, question.loop]
        known = others[0] if not question.size and len(others) == 1 else question
        name = ", ".join(filter(None, (known.about, known.size, known.loop)))
        if known.facts not in facts[name]:
            facts[name].append(known.facts)
        number = facts[name].index(known.facts) + 1
        named.append(replace(answer, question=f"{name} ({number})" if number > 1 else name))
    return named


def _advice_answers(
    runs: Sequence[Run], names: Sequence[str]
) -> Iterator[tuple[_Question, MachineAnswer]]:
    for run, name in zip(runs, names, strict=True):
        for results in derive_all(run.records):
            model = results.model
            if model.nbatch is None:
                text = f"{model.status}: {model.detail}"
                failure = MachineAnswer("", model.model, name, "", None, None, text)
                yield from ((_Question(model.model, loop=f"{loop} loop"), failure) for loop in Loop)
            for advice in results.advice:
                text = _advice_text(advice)
                answer = MachineAnswer(
                    "", model.model, name, advice.path, None, advice.speedup, text
                )
                yield _advice_question(model, advice, run), answer


def _advice_question(record: ModelRecord, advice: Advice, run: Run) -> _Question:
    starts = record.starts
    files = [record.model, *filter(None, (starts.file, starts.controls_file) if starts else ())]
    parts = [f"{record.nbatch:,} × {record.nstep:,} steps"]
    if record.hold is not None and record.hold > 1:
        parts.append(f"each control held {record.hold} steps")
    if record.returns not in (None, Product.FINAL):
        parts.append(f"returns {record.returns}")
    facts = repr((record.seed, starts, run.header.files_of(files)))
    return _Question(record.model, ", ".join(parts), f"{advice.loop} loop", facts)


def _advice_text(advice: Advice) -> str:
    text = f"{mark(advice.is_certain)} {advice.variant}"
    if (gain := advice.speedup) is not None:  # the plain loop has none over itself
        text += f" {formats.factor(gain.estimate)}×{formats.in_brackets(gain)}"
    return text


def _verdict_answers(
    runs: Sequence[Run], names: Sequence[str]
) -> tuple[list[tuple[_Question, MachineAnswer]], str]:
    """Return what machines say of comparisons, and what all verdicts show together."""
    judged = [
        (run, name, record.row())
        for run, name in zip(runs, names, strict=True)
        for record in run.of_type(VerdictRecord)
    ]
    if not judged:
        return [], ""
    # of runs that were asked for different confidences, the highest holds for all
    confidence = max(family.confidence_of(run.header) for run, _, _ in judged)
    decided = family.adjust_for_family([row for _, _, row in judged], confidence)
    answers = []
    for run, name, row in judged:
        question = _comparison(row, run)
        is_certain = not any(row is other for other in decided.undecided)
        answers.append((question, _verdict_answer(name, row, is_certain)))
    return answers, verdicts.describe_family(decided, confidence)


def _comparison(row: VerdictRow, run: Run) -> _Question:
    size = "" if row.nbatch is None else f"{row.nbatch:,} × {row.nstep:,} steps"
    name = f"{verdicts.label(row)}{METRICS[row.metric].suffix}"
    # builds of one release for several processors are the same release
    sides = [replace(side, build=release_names.wheel_digest(side.build)) for side in row.sides]
    starts = [row.starts.file, row.starts.controls_file] if row.starts else []
    files = run.header.files_of([*(side.model for side in row.sides), *filter(None, starts)])
    asked = [run.header.arguments.get(key) for key in ("min_effect", "sizes", "as_shipped")]
    return _Question(name, size, facts=repr((sides, row.starts, files, asked)))


def _verdict_answer(machine: str, row: VerdictRow, is_certain: bool) -> MachineAnswer:
    verdict = row.verdict if is_certain else None
    own = METRICS[row.metric].outcome(row.verdict) if row.verdict else row.detail or row.status
    answer, detail = (own, "") if verdict else (_UNDECIDED, f" ({own})")
    if row.verdict in _TONES and not is_certain:
        is_placement = family.may_be_placement(row)
        why = ", or because of where its code lies" if is_placement else " if judged alone"
        detail = f" ({own}{why})"
    text = f"{answer}{detail}{', changed work' if row.changed_work else ''}"
    if row.ratio is not None:
        text = f"{formats.with_interval(row.ratio, formats.change)} {text}"
    return MachineAnswer("", row.model, machine, answer, verdict, row.ratio, text)


def section(machines: Machines) -> Section | None:
    """Return what machines show side by side; None where they answer nothing."""
    if not machines.answers:
        return None
    return Section(
        "Across machines",
        conclusions=[
            *([Conclusion(machines.together)] if machines.together else ()),
            *_sentences(machines.by_question),
        ],
        tables=[_table(machines.by_question)],
        notes=list(_notes(machines)),
        is_open=True,
    )


def _table(by_question: Mapping[str, Sequence[MachineAnswer]]) -> DataTable:
    """Return a table with a column for each machine, or, where that is too wide, a row a cell.

    A machine that was asked several times has all its answers.
    """
    cells: dict[str, dict[str, str]] = {}
    for question, answers in by_question.items():
        texts: dict[str, list[str]] = defaultdict(list)
        for answer in answers:
            texts[answer.machine].append(answer.text)
        cells[question] = {name: "; ".join(dict.fromkeys(each)) for name, each in texts.items()}
    names = list(dict.fromkeys(name for row in cells.values() for name in row))
    headings = ["question", *names]
    rows = [[question, *(row.get(each, "–") for each in names)] for question, row in cells.items()]
    widths = [max(map(len, column)) for column in zip(headings, *rows, strict=True)]
    if sum(widths) + len(widths) > _MOST_WIDTH:
        headings = ["question", "machine", "answer"]
        rows = [[question, *pair] for question, row in cells.items() for pair in row.items()]
    return DataTable("Answers by machine", [*map(Column, headings)], rows)


def _sentences(by_question: Mapping[str, Sequence[MachineAnswer]]) -> list[Conclusion]:
    """Return which questions machines answer differently, then what they agree on."""
    differing: list[Conclusion] = []
    agreed: dict[tuple[str, Verdict | None, int], list[str]] = defaultdict(list)
    for question, answers in by_question.items():
        machines: dict[str, list[str]] = defaultdict(list)
        for answer in answers:
            machines[answer.answer or "not measured"].append(answer.machine)
        total = len({answer.machine for answer in answers})
        if len(machines) == 1:
            agreed[answers[0].answer or "not measured", answers[0].verdict, total].append(question)
            continue
        (first, most), *others = sorted(machines.items(), key=lambda each: -len(each[1]))
        rest = "".join(f", {text} on {_listed(names)}" for text, names in others)
        text = f"{question}: {first} on {len(most)} of {total} machines{rest}"
        differing.append(Conclusion(text, _tone([answer.verdict for answer in answers])))
    same = [
        Conclusion(
            f"{answer} on {formats.all_machines(total) if total > 1 else 'the only machine'}, for"
            f" {_listed(questions)}",
            _tone([verdict]),
        )
        for (answer, verdict, total), questions in agreed.items()
    ]
    sentences = [*differing, *same]
    rest_count = len(sentences) - _MOST_SENTENCES
    more = [Conclusion(f"{rest_count} further sentences are only in the table.")]
    return [*sentences[:_MOST_SENTENCES], *(more if rest_count > 0 else [])]


def _listed(names: Sequence[str]) -> str:
    """Return names in a sentence; of many, how many more there are."""
    more = len(names) - _MOST_NAMES
    return ", ".join(names[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")


def _tone(verdicts_of_machines: Sequence[Verdict | None]) -> Tone:
    """Return what verdicts mean: slower on one machine is bad, whatever the others say."""
    tones = (tone for verdict, tone in _TONES.items() if verdict in verdicts_of_machines)
    return next(tones, Tone.NEUTRAL)


def _notes(machines: Machines) -> Iterator[str]:
    """Yield which questions are apart because machines did different work, and what to do."""
    asked: dict[str, set[str]] = defaultdict(set)
    for answer in machines.answers:
        asked[answer.model].add(answer.machine)
    lone = {
        answers[0].model
        for answers in machines.by_question.values()
        if {answer.machine for answer in answers} < asked[answers[0].model]
    }
    if lone:
        yield (
            f"Not all machines answered the same questions about {_listed(sorted(lone))}. Give the"
            " same --nbatch, --nstep, --settle and files on all machines."
        )
