"""The page docs/method/ray.md, written from the tally of `benchmarks.ray_crossover`."""

from collections.abc import Iterator

from benchmarks.studies.ray_tally import Overtaking, PathTime, RayModel, RaySize, RayTally
from mjbench.pages import markdown
from mjbench.paths import BASE


def page(tally: RayTally) -> str:
    """Return the Markdown page of a tally."""
    return "\n".join(_lines(tally)) + "\n"


def size_line(size: RaySize) -> str:
    """Return one size in a line, for somebody who waits."""
    times = ", ".join(f"{time.path} × {time.nthread} {_ms(time.ms)}" for time in size.times)
    return f"  {size.steps:,} steps, in ms: {times}"


def _lines(tally: RayTally) -> Iterator[str]:
    yield "# When Ray pays"
    yield ""
    yield " ".join(_conclusion(tally))
    yield ""
    yield "Written by `python -m benchmarks.ray_crossover` from `results/ray.json`; do not edit."
    yield from _WHAT
    yield ""
    yield "## From how much work on"
    yield ""
    yield (
        "Work of a call, in milliseconds of the plain loop and in steps of all simulations"
        f" together, at which {tally.usable_cores} actors are faster than the other path, and stay"
        " so at every larger size that was tried. *never* is followed by the largest size tried,"
        " and Ray's speed relative to the other path there. Ratios are taken round by round, and"
        " times are medians, so the two differ by a few percent."
    )
    yield ""
    # the last column is Ray's own
    rivals = tally.models[0].sizes[0].times[:-1]
    yield from markdown.table_lines(
        ["model", "µs a step", *(rival.column for rival in rivals)],
        (
            [model.model, f"{model.step_us:.3g}", *(_cell(model, rival) for rival in rivals)]
            for model in tally.models
        ),
        ["µs a step"],
    )
    for model in tally.models:
        yield ""
        yield from _call_table(model)
    yield ""
    yield from _cost(tally)
    yield from _HOW


def _conclusion(tally: RayTally) -> Iterator[str]:
    """Yield what the table comes to: the path that needs no Ray first."""
    cores = tally.usable_cores
    threads = {m.model: _overtaking(m, "rollout", cores) for m in tally.models}
    loops = [_overtaking(model, BASE, 1) for model in tally.models]
    ahead = [
        f"{name} ({row.share:.2f} of its speed at the largest call)"
        for name, row in threads.items()
        if row.least
    ]
    if not ahead:
        yield (
            f"On one machine, Ray does not pay: `mujoco.rollout` on {cores} threads was faster than"
            f" {cores} Ray actors on all {len(threads)} models, up to the largest call tried."
        )
    else:
        yield (
            f"On one machine, {cores} Ray actors overtake `mujoco.rollout` on {cores} threads on"
            f" {len(ahead)} of {len(threads)} models: {', '.join(ahead)}."
        )
    overtaken = [row.least.loop_ms for row in loops if row.least]
    if overtaken:
        yield (
            f"Ray actors beat a plain loop on {len(overtaken)} of {len(loops)} models, once a call"
            f" takes {_range(overtaken)} ms of its work. Other machines were not measured; to reach"
            " them, make calls much longer than that, and use `rollout` on threads in each actor."
        )


def _range(values: list[float]) -> str:
    low, high = _ms(min(values)), _ms(max(values))
    return low if low == high else f"{low} to {high}"


def _overtaking(model: RayModel, path: str, nthread: int) -> Overtaking:
    return next(row for row in model.crossovers if (row.path, row.nthread) == (path, nthread))


def _cell(model: RayModel, rival: PathTime) -> str:
    row = _overtaking(model, rival.path, rival.nthread)
    if row.least:
        return f"{_ms(row.least.loop_ms)} ms ({row.least.steps:,} steps)"
    return f"never up to {_ms(row.largest.loop_ms)} ms ({row.share:.2f}×)"


def _call_table(model: RayModel) -> Iterator[str]:
    yield f"Milliseconds of a call on `{model.model}`, {model.nstep} steps a simulation:"
    yield ""
    columns = ["simulations", "steps", *(time.column for time in model.sizes[0].times)]
    rows = (
        [f"{size.nbatch:,}", f"{size.steps:,}", *(_ms(time.ms) for time in size.times)]
        for size in model.sizes
    )
    yield from markdown.table_lines(columns, rows, columns)


def _cost(tally: RayTally) -> Iterator[str]:
    cost = tally.cost
    yield "## What Ray takes"
    yield ""
    yield (
        f"Ray starts in {cost.start_s:.1f} s, two actors in {cost.actors_s:.1f} s. None of it"
        f" is in a timed call. Its services take {100 * cost.idle_share:.1f} % of a core while"
        f" nobody uses them, and {cost.services_bytes / 2**20:.0f} MiB; each actor takes"
        f" {cost.actor_bytes / 2**20:.0f} MiB, with the cart-pole."
    )
    yield ""
    yield (
        f"Measured on {tally.date} on {tally.usable_cores} cores of {tally.processor}, with"
        f" MuJoCo {tally.mujoco} and Ray {tally.ray}."
    )


def _ms(ms: float) -> str:
    return f"{ms:.0f}" if ms >= 100 else f"{ms:.2g}"


_WHAT = """
## What the path does

`mjbench compare --paths ray` steps in Ray actors: processes that Ray starts, each with its own
model and one thread of `mujoco.rollout`. A release without rollout gets a Python loop in each
actor. Actors are as many as usable cores, or as `--threads` says. What they return is compared
with what the plain loop returns, bit by bit, as of every other C path. The path runs only
where `--paths` names it, and needs the extra `ray`. `compare` never advises it: Ray takes
seconds to start, so it has [four launches of its own](timing.md#the-race) beside the plain loop.

A call sends each actor the start states and controls of its share, and copies what comes back to
one array. Both go as arguments and return values. Ray puts what is larger than 100 KB into its
object store, which the receiver reads without a copy; with less, it comes with the message.
Nothing but the model stays in an actor.

Ray runs on this machine alone, whatever `RAY_ADDRESS` says: a comparison is of one machine. It
starts before the first call, without a dashboard and without usage statistics, and ends with the
comparison, however that ends. Its ports are open to the network while it runs; a secret of this
run protects them.""".splitlines()

_HOW = """
## Run it again

`python -m benchmarks.ray_crossover` takes about five minutes, and needs the machine for itself.
On your model:

```
mjbench compare robot.xml --paths python_loop,rollout,ray --nstep 20 --nbatch 2,32,512,8192
```""".splitlines()
