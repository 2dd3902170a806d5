"""What `mjbench env` measures: environments, one after the other."""

import functools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mjbench.commands.env import measurement as environments
from mjbench.commands.env.child_process import EnvironmentPlan
from mjbench.commands.env.options import EnvironmentOptions
from mjbench.commands.env.result import EnvironmentRecord
from mjbench.commands.env.source import EnvironmentSource, resolve
from mjbench.errors import Failure, InputError, MjbenchError, failure_of
from mjbench.host import machine
from mjbench.measuring.timing import Progress
from mjbench.session import Item, Measurement, finished, in_turn
from mjbench.status import Status


def measurement(names: Sequence[str], options: EnvironmentOptions) -> Measurement:
    """Return the measurement of environments; without numbers, of powers of two and all cores."""
    if options.skip and options.nbatch:
        raise InputError("give --nbatch or --skip vectors, not both")
    sources = [resolve(name, Path.cwd()) for name in names]
    cores = machine.usable_cores()
    counts = options.nbatch or sorted({cores, *(2**i for i in range(cores.bit_length()))})
    plan = EnvironmentPlan(
        options.nstep,
        options.seed,
        tuple(options.threads or sorted({1, cores})),
        tuple([] if options.skip else counts),
        options.budget.each_s,
        options.time_limit_s,
        must_end=options.budget_s is not None,
    )

    def measure(source: EnvironmentSource, budget_s: float, _: Progress) -> Item:
        try:
            record = environments.measure(source, replace(plan, budget_s=budget_s))
        except MjbenchError as error:
            record = EnvironmentRecord.failed(source.name, failure_of(error))
        if record.facts is None and record.status != Status.INTERRUPTED:
            return Item([record], Failure(record.status, f"{source.name}: {record.detail}"))
        return Item([record])

    items = functools.partial(in_turn, sources, measure, options.budget, attribute="environment")
    arguments = {"environments": list(names), "plan": plan, "budget_s": options.budget_s}
    return Measurement("env", arguments, [], items, finished)
