"""Invented races of paths with known speed-ups, run by the race itself without a process."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from example_records import measurement, model_record

from mjbench import paths
from mjbench.commands.compare import driver as model_comparison
from mjbench.commands.compare import results as path_speedups
from mjbench.commands.compare.results import ModelResults
from mjbench.paired.launches import Targets, launch
from mjbench.paired.race import RaceBudget, RaceRule
from mjbench.paired.race_record import RaceLaunch, RaceRecord
from mjbench.verification.plan import WITHOUT_TIMER, ComparisonPlan, Variant
from mjbench.verification.records import ModelRecord, VariantRecord

# A variant and its speed-up over the plain loop.
Entrant = tuple[Variant, float]

PLAIN = Variant("python_loop", {})
ROLLOUT = Variant("rollout", {"threads": 2, "pool": "kept"})
BATCH_STEP = Variant("batch_step", {"threads": 2, "data": "shared"})
THREADS = Variant("threads", {"threads": 2})
BATCH_ROLLOUT = Variant("batch_rollout", {"threads": 2})
# rollout is clearly the fastest for open loop, and Batch.step for closed loop.
CLEAR: Sequence[Entrant] = ((ROLLOUT, 3.0), (BATCH_STEP, 2.0), (THREADS, 0.8))
_BASE_NS, _STEPS = 1_000_000, 1000
# Speed-ups of paths by their names, whatever their options.
_SPEEDUPS = {"rollout": 3.0, "batch_step": 2.0}


def raced(
    entrants: Sequence[Entrant] = CLEAR,
    *,
    spread: float = 0.005,
    launches: int = 40,
    cores: float = 2.0,
    **fields: Any,
) -> RaceRecord:
    """Return how a race ended: by default of model `m`, with blocks of 1,000 steps of 1 µs.

    Args:
      entrants: all but the plain loop.
      spread: standard deviation of the logarithm of a block's time.
      launches: that there is time for.
      cores: that threads had in each.
      fields: of the record.
    """
    variants = [PLAIN, *(variant for variant, _ in entrants)]
    speedups = [1.0, *(speedup for _, speedup in entrants)]
    compete = [i for i, variant in enumerate(variants) if variant != WITHOUT_TIMER]
    closed_loop = [i for i in compete if paths.find(variants[i].path).closed_loop]
    entered = RaceRecord(
        **{
            "model": "m",
            "steps": _STEPS,
            "variants": variants,
            "groups": [compete, closed_loop],
            **fields,
        }
    )
    rng, ticks = np.random.default_rng(5), itertools.count()
    usual_ns = _BASE_NS / np.array(speedups)

    class Invented(Targets[RaceLaunch]):
        def launch(self, positions: Sequence[int]) -> RaceLaunch:
            noise = np.exp(rng.normal(0.0, spread, (4, len(positions))))
            ns = np.rint(usual_ns[list(positions)] * noise).astype(int).tolist()
            return RaceLaunch(cores, list(positions), ns)

    clock = ticks.__next__  # a second passes whenever the race looks
    *_, ended = race(entered, Invented(), RaceBudget(4.0 * launches, clock))
    return ended


def race(entered: RaceRecord, targets: Targets[RaceLaunch], budget: RaceBudget) -> list[RaceRecord]:
    """Run a race as `compare` does; return what is known after each launch, and how it ended."""
    rule, known = RaceRule(entered, budget), list[RaceRecord]()
    rule.end(launch(targets, rule, lambda: known.append(rule.record)))
    return [*known, rule.record]


def compared(
    record: RaceRecord, *, more: Sequence[VariantRecord] = (), **fields: Any
) -> list[ModelRecord | VariantRecord | RaceRecord]:
    """Return the records of a comparison: of the model, of each variant, and the race.

    Args:
      record: of the race.
      more: of variants that did not race.
      fields: of the model's record.
    """
    model = model_record(
        **{
            "model": record.model,
            "nbatch_asked": record.nbatch_asked,
            "usable_cores": 2,
            "start_contacts": 0,
            **fields,
        }
    )
    unable = {each.variant: each for each in record.unable}
    measurements = []
    for position, variant in enumerate(record.variants):
        left = unable.get(position)
        measurements.append(
            measurement(
                model=record.model,
                path=variant.path,
                options=variant.options,
                nbatch_asked=record.nbatch_asked,
                closed_loop=paths.find(variant.path).closed_loop,
                snippet=f"# {variant}",
                **({"status": left.status, "detail": left.detail} if left else {}),
            )
        )
    return [model, *measurements, *more, record]


def invent_comparisons(monkeypatch: pytest.MonkeyPatch, **fields: Any) -> list[ComparisonPlan]:
    """Have `compare` race invented paths; return the plans that it then has, as they come.

    Args:
      monkeypatch: of the test.
      fields: of the last model's record.
    """
    plans: list[ComparisonPlan] = []

    class Invented(model_comparison.ComparedModel):
        def run(self) -> None:
            name, plan = self._name, self._plan
            plans.append(plan)
            self._observer.begin(f"{name}: racing {len(plan.variants)} paths, about 20 s")
            self._show_progress(name, 0.5)
            self._show_known()

        def known(self) -> ModelResults:
            plan = self._plan
            entrants = [(each, _SPEEDUPS.get(each.path, 0.9)) for each in plan.variants[1:]]
            record = raced(entrants, model=self._name, nbatch_asked=plan.nbatch)
            sizes = {"nbatch": plan.nbatch or 10}
            model, *measurements, ended = compared(record, **{**sizes, **fields})
            assert isinstance(model, ModelRecord)
            assert isinstance(ended, RaceRecord)
            rows = tuple(row for row in measurements if isinstance(row, VariantRecord))
            return ModelResults(model, rows, ended)

    monkeypatch.setattr(model_comparison, "ComparedModel", Invented)
    return plans


def derived(
    record: RaceRecord, *, more: Sequence[VariantRecord] = (), **fields: Any
) -> ModelResults:
    """Return the results of a comparison; see `compared`."""
    (model_results,) = path_speedups.derive_all(compared(record, more=more, **fields))
    return model_results
