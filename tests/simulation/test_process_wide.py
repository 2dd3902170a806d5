"""Changes of a setting of the whole process begin and end in any order."""

import threading
from collections.abc import Sequence

import pytest

from mjbench.simulation.process_wide import ProcessWide


def test_a_change_that_ends_first_leaves_the_others_in_their_order() -> None:
    applied: list[tuple[str, ...]] = []
    setting = ProcessWide[str](lambda active: applied.append(tuple(active)))
    for change in ("a", "b", "c"):
        setting.begin(change)
    for change in ("a", "c", "b", "b"):
        setting.end(change)
    assert applied[3:] == [("b", "c"), ("b",), ()]


def test_a_change_that_cannot_be_applied_is_not_active() -> None:
    applied: list[tuple[str, ...]] = []

    def apply(active: Sequence[str]) -> None:
        if "bad" in active:
            raise ValueError("cannot be applied")
        applied.append(tuple(active))

    setting = ProcessWide[str](apply)
    setting.begin("a")
    with pytest.raises(ValueError, match="cannot be applied"):
        setting.begin("bad")
    assert setting.active == applied[-1] == ("a",)


def test_changes_of_many_threads_are_all_active_and_all_gone() -> None:
    applied: list[tuple[object, ...]] = []
    setting = ProcessWide[object](lambda active: applied.append(tuple(active)))
    all_begun = threading.Barrier(3)

    def change() -> None:
        for own in [object() for _ in range(100)]:
            setting.begin(own)
            all_begun.wait()
            setting.end(own)
            all_begun.wait()

    threads = [threading.Thread(target=change) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert max(map(len, applied)) == 3
    assert applied[-1] == setting.active == ()
