"""What the check of asv says of a planted slowdown."""

from benchmarks.studies.slowdown import Detection, conclusion

PAIRED = Detection("the paired ratio", set(), set(), set())
UNPAIRED = Detection("unpaired times", {"humanoid"}, set(), {"cartpole"})


def test_the_first_line_says_which_arm_found_the_slowdown() -> None:
    assert conclusion(1.2, 8, [PAIRED, UNPAIRED]) == (
        "mj_step, slowed 1.2 times on 8 models, was found by the paired ratio,"
        " not by unpaired times."
    )
    both = [PAIRED, Detection("unpaired times", set(), set(), set())]
    assert conclusion(1.2, 8, both).endswith("was found by the paired ratio and unpaired times.")


def test_a_slowdown_that_no_arm_found_is_said_to_be_missed() -> None:
    missed = Detection("the paired ratio", set(), {"humanoid"}, set())
    assert conclusion(1.2, 8, [missed, UNPAIRED]).endswith(
        "was found by neither the paired ratio nor unpaired times."
    )


def test_what_an_arm_missed_and_wrongly_called_slower_is_listed() -> None:
    assert str(UNPAIRED).splitlines() == [
        "unpaired times (step.Step.time_1000_steps)",
        "  asv continuous missed humanoid",
        "  asv continuous called cartpole slower in an unchanged release",
        "  the regressions page missed none",
    ]
