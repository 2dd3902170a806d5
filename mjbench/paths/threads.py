"""Python threads, an MjData each: `mj_step` releases the interpreter lock."""

from concurrent.futures import ThreadPoolExecutor

from mjbench.paths import snippets
from mjbench.paths.base import (
    Option,
    Options,
    Prepared,
    Resources,
    SteppingPath,
    make_simulate,
    prepared_arrays,
)
from mjbench.simulation.workload import Product, Workload


class Threads(SteppingPath):
    """A ThreadPoolExecutor whose threads each loop over their simulations."""

    name = "threads"
    summary = "ThreadPoolExecutor, each thread a Python loop with its own MjData"
    title = "a thread pool of Python loops"
    closed_loop = True
    products = tuple(Product)
    options = (
        Option("threads", "Python threads", (), int),
        Option(
            "chunk", "simulations a thread takes at a time (default: one share each)", (None,), int
        ),
    )

    def prepare(self, workload: Workload, options: Options, resources: Resources) -> Prepared:
        threads = options["threads"]
        pool = resources.get_or_create(("executor", threads), lambda: ThreadPoolExecutor(threads))
        resources.at_close(pool.shutdown)
        idle = resources.datas(threads)[:]  # list.pop and append are atomic
        final_state, outputs = resources.final_state(), resources.step_outputs()
        simulate = make_simulate(workload.model, workload.hold, workload.returns)
        parts = shares(workload.nbatch, threads, options.get("chunk"))

        def work(part: slice) -> None:
            data = idle.pop()
            try:
                simulate(
                    data,
                    workload.initial_state[part],
                    workload.control[part],
                    final_state[part],
                    outputs.part(part),
                )
            finally:
                idle.append(data)

        def run() -> None:
            for _ in pool.map(work, parts):
                pass

        return prepared_arrays(run, final_state, outputs)

    def snippet(self, workload: Workload, options: Options) -> str:
        parts = shares(workload.nbatch, options["threads"], options.get("chunk"))
        return _SNIPPET.format(
            threads=options["threads"],
            size=parts[0].stop - parts[0].start,
            allocate=snippets.allocation(workload),
            count=snippets.counter(workload, indent=8),
            step=snippets.data_steps(workload, indent=12, row="i"),
        )


def shares(count: int, workers: int, size: int | None = None) -> list[slice]:
    """Return slices of `size` that cover `range(count)`; without one, about one a worker."""
    size = size or -(-count // workers)
    return [slice(i, min(i + size, count)) for i in range(0, count, size)]


_SNIPPET = """\
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np

full = int(mujoco.mjtState.mjSTATE_INTEGRATION)
free = [mujoco.MjData(model) for _ in range({threads})]
final_state = np.empty_like(initial_state)
{allocate}
def work(first):
    data = free.pop()
    for i in range(first, min(first + {size}, len(initial_state))):
        mujoco.mj_setState(model, data, initial_state[i], full)
{count}        for u in control[i]:  # or u = policy(data), which all threads call at the same time
            data.ctrl[:] = u
{step}        mujoco.mj_getState(model, data, final_state[i], full)
    free.append(data)

with ThreadPoolExecutor({threads}) as pool:
    list(pool.map(work, range(0, len(initial_state), {size})))
"""
