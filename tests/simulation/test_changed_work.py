from mjbench.simulation import changed_work
from mjbench.simulation.reference_run import Work


def test_changed_work_is_listed_counter_by_counter() -> None:
    before, after = Work(1.0, 10.001, 2.0), Work(5.0, 10.0, 2.0)
    assert changed_work.counter_changes(before.as_dict(), after.as_dict()) == ["contacts 1 → 5"]
    many = Work(12345.6, 10.0, 2.0)
    (change,) = changed_work.counter_changes(before.as_dict(), many.as_dict())
    assert change == "contacts 1 → 12346"
    changes = changed_work.work_changes(before, after, 1e-3, (0, 2))
    assert changes == [
        "contacts 1 → 5",
        "one step differs by 0.001 times the largest qpos, qvel or act",
        "2 simulations diverge instead of 0",
    ]


def test_work_that_differs_by_rounding_is_the_same() -> None:
    same = Work(1.0, 10.0, 2.0)
    assert changed_work.work_changes(same, same, changed_work.ROUNDING / 2, (1, 1)) == []
    assert changed_work.work_changes(same, same, None, (1, 1)) == []


def test_work_that_is_unknown_is_not_changed() -> None:
    assert changed_work.work_changes(None, Work(1.0, 10.0, 2.0), None, (1, 1)) == []
