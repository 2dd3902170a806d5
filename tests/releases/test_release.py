"""Pairs of releases between which nothing changed that a step executes."""

import itertools

from commands import ROOT

from mjbench.releases import bundle
from mjbench.releases.release import NO_CHANGE_PAIRS


def test_each_pair_is_two_neighbours_in_the_history() -> None:
    versions = [release.version for release in bundle.read(ROOT / "benchmarks/releases.bundle")]
    neighbours = set(itertools.pairwise(versions))
    assert NO_CHANGE_PAIRS
    assert {(pair.old, pair.new) for pair in NO_CHANGE_PAIRS} <= neighbours
