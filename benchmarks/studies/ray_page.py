"""What docs/guides/machines.md has of the tally of `benchmarks.studies.ray_crossover`."""

from collections.abc import Iterator

from benchmarks.studies.page_part import PagePart
from benchmarks.studies.ray_tally import Overtaking, PathTime, RayModel, RaySize, RayTally
from mjbench.pages import markdown
from mjbench.paths import BASE

PART = PagePart("guides/machines.md", "ray", "benchmarks.studies.ray_page")


def size_line(size: RaySize) -> str:
    """Return one size in a line, for somebody who waits."""
    times = ", ".join(f"{time.path} × {time.nthread} {_ms(time.ms)}" for time in size.times)
    return f"  {size.steps:,} steps, in ms: {times}"


def lines(tally: RayTally) -> Iterator[str]:
    """Yield the conclusion, from how much work on Ray overtakes other paths, and what it takes."""
    yield " ".join(_conclusion(tally))
    yield ""
    yield (
        f"The smallest call for which {tally.usable_cores} actors beat the other path: in"
        " milliseconds of the plain loop, and in steps of all simulations."
        " *Never* is followed by the largest size tried, and Ray's relative speed there."
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
    yield ""
    yield _cost(tally)


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
    return f"*never* up to {_ms(row.largest.loop_ms)} ms ({row.share:.2f}×)"


def _cost(tally: RayTally) -> str:
    cost = tally.cost
    return (
        f"Ray starts in {cost.start_s:.1f} s, two actors in {cost.actors_s:.1f} s; none of it is in"
        f" a timed call. Its services take {100 * cost.idle_share:.1f} % of a core while they are"
        f" idle, and {cost.services_bytes / 2**20:.0f} MiB. (Measured on {tally.date} on"
        f" {tally.usable_cores} cores of {tally.processor}, with MuJoCo {tally.mujoco} and Ray"
        f" {tally.ray}.)"
    )


def _ms(ms: float) -> str:
    return f"{ms:.0f}" if ms >= 100 else f"{ms:.2g}"
