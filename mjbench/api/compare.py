"""`mjbench.compare`: the ways of stepping a model: do they agree, and which is fastest?"""

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mjbench import paths as stepping_paths
from mjbench.api import argument_values, model_sources, start_states
from mjbench.api.measured import Measured
from mjbench.api.model_comparison import measurement
from mjbench.commands.compare.advice import Advice, ClockAdvice
from mjbench.commands.compare.crossovers import Crossover
from mjbench.commands.compare.results import ModelResults, PathResult, derive_all
from mjbench.commands.show.documents import CompareDocument
from mjbench.errors import InputError, wrong_argument
from mjbench.limits import LARGE_COUNT, SECONDS, SEED, THREADS, TIME_LIMIT_S
from mjbench.measuring.timing import Progress
from mjbench.simulation import models as shipped_models
from mjbench.simulation.workload import Product
from mjbench.verification import selection
from mjbench.verification.plan import BUDGET_S, ComparisonPlan

if TYPE_CHECKING:
    from mjbench.api.model_sources import Model
    from mjbench.api.start_states import Actions, States


@dataclass(frozen=True, repr=False, eq=False)
class Comparison(Measured):
    """Ways of stepping models, compared."""

    @property
    def models(self) -> tuple[ModelResults, ...]:
        """The results of each model at each size."""
        return tuple(derive_all(self.run.records))

    @property
    def document(self) -> CompareDocument:
        """All that `mjbench compare --json` has."""
        return CompareDocument.of(self.machine, self.models)

    @property
    def results(self) -> tuple[PathResult, ...]:
        """The results of all variants of paths, on all models."""
        return tuple(result for model in self.models for result in model.results)

    @property
    def advice(self) -> tuple[Advice, ...]:
        """Which path to use, for open and for closed loop."""
        return tuple(self.document.advice)

    @property
    def clock(self) -> tuple[ClockAdvice, ...]:
        """What turning MuJoCo's timer off gains, where that is certain."""
        return tuple(self.document.clock)

    @property
    def crossovers(self) -> tuple[Crossover, ...]:
        """From how many simulations on accelerated paths overtake C."""
        return tuple(self.document.crossovers)


def compare(
    *models: "Model",
    paths: str | Iterable[str] | None = None,
    threads: int | Iterable[int] | None = None,
    chunk: int | Iterable[int] | None = None,
    options: Mapping[str, Any] | None = None,
    nbatch: int | Iterable[int] | None = None,
    nstep: int | None = None,
    hold: int = 1,
    returns: str = Product.FINAL.value,
    seed: int = 0,
    settle_s: float | None = None,
    states: "States | None" = None,
    actions: "Actions | None" = None,
    budget_s: float = BUDGET_S,
    total_steps: float | None = None,
    time_limit_s: float = TIME_LIMIT_S,
    wait: bool = False,
    on_progress: Progress | None = None,
) -> Comparison:
    """Compare ways of stepping models: do they agree, and how fast are they?

    The same as `mjbench compare`. What paths return is compared first, bit by bit; a path that
    disagrees gets no speed. All is measured in child processes. A model that fails loses only its
    own results, unless all fail.

    Args:
      *models: names as on the command line, paths, MjModels or MjSpecs; none for all shipped ones.
      paths: names of paths (see `mjbench paths`), `c` for all C paths, `usual` for those
        and MJX where that is installed, `module:Class` for one of your own; None for `c`.
      threads: thread counts; None for one, and all usable cores.
      chunk: simulations that a thread takes at a time; None for the path's default.
      options: values of further options of paths by name, such as `{"pool": ["new", "kept"]}`.
      nbatch: simulations; several are measured one after the other; None for up to 64.
      nstep: steps of each simulation; None for up to 100.
      hold: steps for which each control is held: an environment's frame_skip.
      returns: what every path returns: `final`, `trajectory` or `sensors`.
      seed: of start states and controls.
      settle_s: simulated seconds for which the model moves before the first start state; 0 starts
        at keyframe 0, None stands for 0.1 with a keyframe, and for 5 without.
      states: a file of start states, or arrays by MjData field, as `mjbench.record` returns and
        `mjbench.capture` stores them.
      actions: a file of controls, or an array (ncontrol, nu) or (nsequence, ncontrol, nu), in place
        of random ones.
      budget_s: seconds for each model, agreement included; what compiles comes on top.
      total_steps: steps that you will take in all: a path that compiles is advised only if that
        pays within them; None for those of one block.
      time_limit_s: a child process that reports nothing for this long is killed.
      wait: whether to wait until no other mjbench measures on this machine.
      on_progress: called with what is measured now, and the share of all work that is done.

    Raises:
      InputError: there is no such model or path, an argument is out of its range, or no model can
        be compared.
      MachineError: a package is missing, or no model could be compared because processes failed.
      KeyboardInterrupt: Ctrl-C; no child process is left.
    """
    path_names = [] if paths is None else argument_values.names("paths", paths)
    plan = ComparisonPlan(
        variants=(),
        nstep=argument_values.optional(argument_values.whole, "nstep", nstep),
        hold=argument_values.whole("hold", hold),
        seed=argument_values.whole("seed", seed, SEED),
        returns=argument_values.choice("returns", returns, Product),
        budget_s=argument_values.number("budget_s", budget_s, SECONDS),
        limit_s=argument_values.number("time_limit_s", time_limit_s, SECONDS),
        import_from=_own_path_folder(path_names),
        named=selection.named(path_names),
        total_steps=argument_values.optional(
            argument_values.whole, "total_steps", total_steps, LARGE_COUNT, is_float=True
        ),
    )
    argument_values.holds(plan.nstep, plan.hold)
    plans = selection.plans(
        plan,
        path_names,
        argument_values.optional(argument_values.wholes, "threads", threads, THREADS),
        argument_values.optional(argument_values.wholes, "chunk", chunk),
        _option_texts(options or {}),
        argument_values.optional(argument_values.wholes, "nbatch", nbatch),
    )
    with (
        model_sources.sources(models or shipped_models.shipped()) as sources,
        start_states.plan(settle_s, states, actions) as starts,
    ):
        sized = [replace(plan, starts=starts) for plan in plans]
        return Comparison.of(measurement(sources, sized), wait, on_progress)


def _option_texts(options: Mapping[str, Any]) -> list[str]:
    if not isinstance(options, Mapping):
        raise wrong_argument("options", options, "a dictionary")
    several = {
        name: [values] if isinstance(values, str) or not isinstance(values, Iterable) else values
        for name, values in options.items()
    }
    return [f"{name}={','.join(map(str, values))}" for name, values in several.items()]


def _own_path_folder(path_names: Sequence[str]) -> str | None:
    """Return the folder of the user's own paths, for child processes; None without such paths."""
    folders = set()
    for name in path_names:
        module_name, colon, _ = name.partition(":")
        if not colon:
            continue
        stepping_paths.find(name)
        file = getattr(sys.modules[module_name], "__file__", None)
        if file is None or module_name == "__main__":
            raise InputError(
                f"path {name}: child processes can import it from a module's file only"
            )
        is_package = hasattr(sys.modules[module_name], "__path__")
        folders.add(str(Path(file).resolve().parents[module_name.count(".") + is_package]))
    if len(folders) > 1:
        raise InputError(f"paths of your own must lie in one folder, not in {', '.join(folders)}")
    return folders.pop() if folders else None
