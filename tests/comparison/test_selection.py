"""What words of a command line name."""

from mjbench.comparison import selection


def test_words_stand_for_several_paths() -> None:
    c = selection.expanded(["c"])
    assert "rollout" in c
    assert "mjx" not in c
    assert selection.expanded(["mjx", "c", "rollout"]) == ["mjx", *c]
    assert selection.rivals(["mjx"])
    assert selection.rivals(["mjx", "rollout"]) == []
