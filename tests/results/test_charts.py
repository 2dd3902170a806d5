"""Charts that can be laid out."""

from mjbench.results import charts


def test_long_texts_do_not_reach_the_layout() -> None:
    part = {"data": {"values": [{"model": "x" * 10_000, "share": 0.5}]}, "title": "y" * 301}
    short = charts._shortened(part)
    assert len(short["title"]) == len(short["data"]["values"][0]["model"]) == 301
    assert short["data"]["values"][0]["share"] == 0.5
