"""Whether what a process holds grows, on figures with a known answer."""

from dataclasses import replace

import pytest

from benchmarks.studies.soak import Usage, growth

MIB = 1 << 20
FLAT = [Usage(50 * i, 6, 2, 0, 1, 60 * MIB) for i in range(1, 21)]


def test_what_stays_the_same_does_not_grow() -> None:
    assert growth(FLAT) == []


@pytest.mark.parametrize("name", ["descriptors", "threads", "processes", "files"])
def test_a_single_one_more_is_growth(name: str) -> None:
    usages = [*FLAT[:-1], replace(FLAT[-1], **{name: getattr(FLAT[-1], name) + 1})]
    (line,) = growth(usages)
    assert line.startswith(f"{name} grew from")


def test_memory_that_varies_or_is_gained_once_is_no_growth() -> None:
    varying = [replace(u, memory_bytes=u.memory_bytes + i % 3 * MIB) for i, u in enumerate(FLAT)]
    assert growth(varying) == []
    once = [FLAT[0], *(replace(usage, memory_bytes=64 * MIB) for usage in FLAT[1:])]
    assert growth(once) == []


def test_memory_that_is_lost_in_every_comparison_is_growth() -> None:
    leaking = [replace(u, memory_bytes=u.memory_bytes + 20_000 * u.comparisons) for u in FLAT]
    (line,) = growth(leaking)
    assert line.startswith("memory grew by")


def test_one_report_shows_no_growth() -> None:
    assert growth(FLAT[:1]) == []
