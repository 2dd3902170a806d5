"""What goes wrong with the memory of WebAssembly builds, and their sines against C's."""

import math

import pytest

from benchmarks.studies import web_memory
from mjbench.errors import MjbenchError
from mjbench.web import node_process, npm_package
from mjbench.web.npm_package import Build


def rotated(angles: list[float], sine: float = 0.0) -> list[tuple[float, float, float, float]]:
    return [(math.cos(a / 2), 0.0, 0.0, math.sin(a / 2) + sine) for a in angles]


def test_the_librarys_own_values_do_not_differ() -> None:
    angles = [0.1, -2.0, 3.0]
    expected = {"count": 3, "sines": 0, "cosines": 0, "difference": 0.0}
    assert web_memory.mathematics(angles, rotated(angles)) == expected


def test_differences_are_counted_by_function() -> None:
    angles = [0.1, 2.0]
    counted = web_memory.mathematics(angles, rotated(angles, sine=1e-9))
    assert (counted["sines"], counted["cosines"]) == (2, 0)
    assert math.isclose(counted["difference"], 1e-9, rel_tol=1e-6)


@pytest.mark.parametrize("build", [*Build])
def test_the_memory_of_the_pinned_builds_behaves_as_the_guide_says(build: Build) -> None:
    try:
        package, program = npm_package.find(), node_process.find_node()
    except MjbenchError as error:
        pytest.skip(str(error))
    tried = web_memory.examine(package, program, build)
    growth, snapshot, state = (tried["examined"][key] for key in ("growth", "snapshot", "state"))
    assert growth["grown_bytes"] > growth["heap_bytes"]
    assert growth["length"] == growth["new_length"] == 7
    assert growth["is_live"] == (build == Build.WASM_MT)
    assert growth["grown_length"] == (7 if growth["is_live"] else 0)
    assert snapshot["views_range_m"] == 0.0
    assert snapshot["copies_range_m"] == pytest.approx(0.2269, abs=5e-5)
    for key in ("data", "contact"):
        memory = tried["examined"][key]
        assert memory["again_bytes"] > memory["deleted_bytes"]
    assert not state["is_array_written"] and state["is_buffer_written"]
    usual, small = tried["limits"]
    assert usual["error"] and small["count"] > usual["count"]
    assert tried["mathematics"]["difference"] < 1e-15
