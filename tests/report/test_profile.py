"""What `mjbench profile` prints."""

from step_profiles import step_profile

from mjbench.loop.profile import ProfileRow
from mjbench.pages import terminal
from mjbench.report import profile


def text(of: ProfileRow) -> str:
    return terminal.text_of(profile.sections([of]))


def test_step_stages_and_rendering_are_printed() -> None:
    printed = text(step_profile())
    assert "takes 3 µs: engine 2 µs (67 %), Python 1 µs" in printed
    assert "4 contacts, 0 constraints, 2.5 solver iterations" in printed
    assert "the timer of MuJoCo's Python package takes 17 %" in printed
    assert "kinematics" in printed
    assert "actuation" not in printed  # takes no time
    assert "by egl: 10 ms, as long as 3,333 steps" in printed
    assert "osmesa: not available (it needs libosmesa6)" in printed


def test_a_release_that_installs_no_timer_prints_nothing_about_it() -> None:
    assert "Python package" not in text(step_profile(clock_ns=None))
