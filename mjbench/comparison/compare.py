"""Compare the ways of stepping: one child process a model, one record a measurement.

The parent never loads a model. It starts `measure` in a child, gathers what the child streams,
and writes each model's records when the model ends, however it ends. A path that kills the child
loses its own row; the child is started again without it. Paths that compile first have a child
each, after all others and alone (see `apart`).
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mjbench import paths
from mjbench.comparison import accelerated_run, measure, selection
from mjbench.instrument import child, isolate, machine
from mjbench.instrument.runs import Record
from mjbench.paths.accelerated import AcceleratedPath
from mjbench.simulation import models

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class ComparisonPlan:
    """What to compare.

    Attributes:
      variants: path names with the option sets to try, the base path first.
      nbatch: simulations, or None to let each model have as many as its budget allows.
      nstep: steps per simulation, or None likewise.
      hold: steps per control.
      seed: of starts and controls.
      budget_s: seconds of timing per model.
      limit_s: a child that is silent for longer is killed.
      largest: most threads or processes asked for.
      import_from: a folder that paths of the user's own may be imported from.
      named: paths that the user asked for, and which are tried wherever they can be.
    """

    variants: tuple[tuple[str, dict[str, Any]], ...]
    nbatch: int | None = None
    nstep: int | None = None
    hold: int = 1
    seed: int = 0
    budget_s: float = measure.BUDGET_S
    limit_s: float = 60.0
    largest: int = 1
    import_from: str | None = None
    named: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as JSON-ready values."""
        return dataclasses.asdict(self)


@dataclass
class _Progress:
    """What is known about one model so far."""

    source: models.ModelSource
    plan: ComparisonPlan
    about: Record = field(default_factory=dict)
    verdicts: dict[int, Record] = field(default_factory=dict)
    samples: dict[int, list[float]] = field(default_factory=dict)
    cores: list[float] = field(default_factory=list)
    compiled: dict[int, Record] = field(default_factory=dict)
    finished: set[int] = field(default_factory=set)  # variants that are timed to the end
    budget_s: float = 1.0
    spent_s: float = 0.0

    def take(self, message: Record) -> None:
        """Take in one message of the child."""
        kind = message["kind"]
        if kind == "model":
            self.about = {k: v for k, v in message.items() if k != "kind"}
        elif kind == "verdict":
            self.verdicts[message["index"]] = message
        elif kind == "ready":
            self.budget_s = message["budget_s"]
        elif kind == "round":
            self.cores.append(message["cores"])
            for index, seconds in message["seconds"].items():
                self.samples.setdefault(int(index), []).append(seconds)
                self.spent_s += seconds
        elif kind == "broken":
            self.verdicts[message["index"]] |= {
                "status": "disagrees",
                "agrees": False,
                "detail": message["detail"],
                "agreement": message["detail"],
            }

    def take_apart(self, index: int, message: Record) -> None:
        """Take in one message of the child of one path."""
        kind = message["kind"]
        if kind == "verdict":
            self.verdicts[index] = message
        elif kind == "sample":
            self.samples.setdefault(index, []).append(message["seconds"])
        else:
            told = {k: v for k, v in message.items() if k != "kind"}
            self.compiled[index] = self.compiled.get(index, {}) | told

    def restart(self, fatal: dict[int, Record]) -> None:
        """Forget what is about to be measured again; keep the variants that were fatal."""
        self.verdicts = dict(fatal)
        self.samples, self.cores, self.spent_s = {}, [], 0.0

    def done(self) -> float:
        """Return the share of this model's work that is done, roughly, from 0 to 1."""
        verified = len(self.verdicts) / len(self.plan.variants)
        return 0.3 * verified + 0.7 * min(1.0, self.spent_s / max(self.budget_s, 1e-9))

    def records(self, ended: isolate.Ended | None) -> list[Record]:
        """Return the records of this model; `ended` is None when the user interrupted it."""
        yours = {"model": self.source.name}
        common = {
            key: self.about.get(key)
            for key in (
                "nbatch",
                "nstep",
                "hold",
                "seed",
                "diverged",
                "workload_digest",
                "state_digest",
                "work",
            )
        }
        head: Record = {
            "type": "model",
            **yours,
            "status": ended.status if ended else "interrupted",
            "detail": ended.detail if ended else "",
            **self.about,
            "nbatch_asked": self.plan.nbatch,
            "usable_cores": machine.usable_cores(),
            "cores_had": self.cores,
        }
        rows = [
            {
                "type": "measurement",
                **yours,
                "path": name,
                "options": options,
                **self._outcome(index, ended),
                **common,
                "nbatch_asked": self.plan.nbatch,
                **self._compiled(index),
                "samples_s": self.samples.get(index, []),
            }
            for index, (name, options) in enumerate(self.plan.variants)
        ]
        return [head, *rows]

    def _compiled(self, index: int) -> Record:
        """Return what is known of a path that compiles; nothing for others."""
        path = paths.find(self.plan.variants[index][0])
        if not isinstance(path, AcceleratedPath):
            return {}
        told = self.compiled.get(index, {})
        return {
            "precision": path.precision,
            "device": told.get("device"),
            "trace_s": told.get("trace_s"),
            "compile_s": told.get("compile_s"),
            "memory_bytes": told.get("memory_bytes"),
            "gpu_memory_bytes": told.get("gpu_memory_bytes"),
            "check": self.verdicts.get(index, {}).get("check"),
        }

    def _outcome(self, index: int, ended: isolate.Ended | None) -> Record:
        """Return status, detail, agreement and snippet of one variant."""
        verdict, name = self.verdicts.get(index, {}), self.plan.variants[index][0]
        status, detail = verdict.get("status"), verdict.get("detail", "")
        if status in (None, "ok") and not self.samples.get(index):
            if ended is None:
                status, detail = "interrupted", "stopped before it was timed"
            elif ended.status == "ok":
                status, detail = "failed", "never timed"
            else:
                status, detail = ended.status, ended.detail
        elif status == "ok" and ended is None and index not in self.finished:
            detail = f"interrupted after {len(self.samples[index])} rounds"
        return {
            "status": status,
            "detail": detail,
            "agrees": verdict.get("agrees"),
            "agreement": verdict.get("agreement", ""),
            "closed_loop": paths.find(name).closed_loop,
            "snippet": verdict.get("snippet", ""),
        }


@dataclass(frozen=True)
class ModelRecords:
    """One model's records, and whether the user stopped it before it was done."""

    records: list[Record]
    interrupted: bool


def compare_model(
    source: models.ModelSource, plan: ComparisonPlan, progress: Progress
) -> ModelRecords:
    """Measure one model and return its records, also when the user interrupts (Ctrl-C)."""
    known = _Progress(source, plan)
    fatal: dict[int, Record] = {}

    def on_message(message: Record) -> None:
        known.take(message)
        progress(source.name, known.done())

    ended: isolate.Ended | None = None
    compiling = [i for i, (name, _) in enumerate(plan.variants) if selection.compiles(name)]
    try:
        with child.scratch() as folder:
            work = folder / "work.pickle" if compiling else None
            while True:
                ended = isolate.run(
                    "mjbench.comparison.measure:measure",
                    _request(source, plan, sorted([*fatal, *compiling]), work),
                    on_message,
                    plan.limit_s,
                    plan.import_from,
                )
                culprit = _culprit(ended, known, plan)
                if culprit is None:
                    break
                fatal[culprit] = {"status": ended.status, "detail": ended.detail}
                known.restart(fatal)
            if ended.status == "ok":
                known.finished = set(range(len(plan.variants))) - set(compiling)
            if ended.status == "ok" and work is not None:
                for index in compiling:
                    _measure_apart(source, plan, index, work, known)
    except KeyboardInterrupt:
        return ModelRecords(known.records(None), interrupted=True)
    return ModelRecords(known.records(ended), interrupted=False)


def _measure_apart(
    source: models.ModelSource, plan: ComparisonPlan, index: int, work: Path, known: _Progress
) -> None:
    """Measure one path that compiles, alone; whatever becomes of it costs its own row."""
    name, options = plan.variants[index]
    ended = accelerated_run.run(
        source,
        name,
        options,
        work,
        lambda message: known.take_apart(index, message),
        named=name in plan.named,
        limit_s=plan.limit_s,
        import_from=plan.import_from,
    )
    known.finished.add(index)
    told = known.compiled.get(index, {}).get("workload_digest", known.about["workload_digest"])
    if ended.status != "ok":
        known.verdicts[index] = known.verdicts.get(index, {}) | {
            "status": ended.status,
            "detail": ended.detail,
        }
    elif told != known.about["workload_digest"]:
        detail = "it was given another workload than the paths before"
        known.verdicts[index] = {"status": "failed", "detail": detail}


def _request(
    source: models.ModelSource, plan: ComparisonPlan, exclude: list[int], work: Path | None
) -> Record:
    return {
        **plan.as_dict(),
        "model": {"name": source.name, "path": str(source.path.resolve())},
        "exclude": exclude,
        "work": str(work) if work else None,
    }


def _culprit(ended: isolate.Ended, known: _Progress, plan: ComparisonPlan) -> int | None:
    """Return the variant that ended the child, if one did and others are left to measure."""
    if ended.status not in ("crashed", "timeout"):
        return None
    for index, (name, options) in enumerate(plan.variants):
        told = known.verdicts.get(index, {}).get("status", "ok")
        words = (
            f"preparing {measure.Variant(paths.find(name), options)} on {known.source.name}",
            f"timing {name} {options}",
        )
        if told == "ok" and ended.where in words and name != paths.BASE:
            return index
    return None
