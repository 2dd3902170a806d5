"""Which core a launch runs on."""

import os
import subprocess
import sys

import pytest

from mjbench.paired import cores

pytestmark = pytest.mark.skipif(
    not hasattr(os, "sched_getaffinity"), reason="no affinity on this system"
)


def test_the_freest_core_is_one_of_ours_and_leaves_the_affinity_as_it_was() -> None:
    allowed = os.sched_getaffinity(0)
    assert cores.freest_core(probe_s=0.001) in allowed
    assert os.sched_getaffinity(0) == allowed


def test_pinning_ends_with_its_block_even_when_that_fails() -> None:
    allowed = os.sched_getaffinity(0)
    core = max(allowed)
    with pytest.raises(ZeroDivisionError), cores.pinned(core):
        assert os.sched_getaffinity(0) == {core}
        _ = 1 / 0
    assert os.sched_getaffinity(0) == allowed


def test_confining_moves_a_process_and_passes_over_one_that_has_ended() -> None:
    core = max(os.sched_getaffinity(0))
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        cores.confine([process.pid], {core})
        assert os.sched_getaffinity(process.pid) == {core}
    finally:
        process.communicate(b"\n")
    cores.confine([process.pid], {core})
