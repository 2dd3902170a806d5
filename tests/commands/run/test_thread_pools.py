"""Threads of libraries are too many where several processes have more of them than cores run."""

import pytest

from mjbench.commands.run import thread_pools
from mjbench.commands.run.activities import Activity
from mjbench.commands.run.gil_waits import ThreadTime
from mjbench.commands.run.thread_pools import MappedLibraries

OPENBLAS = {Activity.NUMPY: "OPENBLAS_NUM_THREADS"}


def times(*busy, processor_s=5.0):
    """Return threads by process and number; the main thread of a process has its number."""
    return [ThreadTime(pid, tid, 10.0, processor_s, 0.0) for pid, tid in busy]


WORKERS = times((2, 2), (2, 20), (3, 3), (3, 30))
OF_PYTHON = {(1, 1), (2, 2), (3, 3)}


def test_two_processes_with_two_threads_each_are_too_many_for_two_cores():
    variables = {2: OPENBLAS, 3: OPENBLAS}
    pools = thread_pools.crowded(WORKERS, OF_PYTHON, variables, usable_cores=2)
    assert (pools.pids, pools.threads, pools.usable_cores) == ([2, 3], 2, 2)
    assert pools.environment == {"OPENBLAS_NUM_THREADS": "1"}
    assert thread_pools.crowded(WORKERS, OF_PYTHON, variables, usable_cores=4) is None


@pytest.mark.parametrize(
    ("seen", "of_python", "variables"),
    [
        (WORKERS, OF_PYTHON, {}),  # the threads are of no library with a variable
        (WORKERS, OF_PYTHON | {(2, 20), (3, 30)}, {2: OPENBLAS, 3: OPENBLAS}),
        (times((2, 2), (2, 20)), OF_PYTHON, {2: OPENBLAS}),  # one process alone
        (times((2, 20), (3, 30), processor_s=0.1), OF_PYTHON, {2: OPENBLAS, 3: OPENBLAS}),
    ],
)
def test_other_threads_are_not_meant(seen, of_python, variables):
    assert thread_pools.crowded(seen, of_python, variables, usable_cores=1) is None


@pytest.mark.parametrize(
    ("mapped", "variables"),
    [
        ("/lib/libscipy_openblas64_-1.so", OPENBLAS),
        ("/lib/libopenblas.so\n/lib/libmkl_rt.so", {Activity.NUMPY: "MKL_NUM_THREADS"}),
        ("/torch/lib/libgomp.so", {Activity.POLICY: "OMP_NUM_THREADS"}),
        ("/lib/libc.so", {}),
    ],
)
def test_the_variable_is_of_the_library_that_a_process_has_mapped(tmp_path, mapped, variables):
    (tmp_path / "2").mkdir()
    (tmp_path / "2/maps").write_text(mapped)
    libraries = MappedLibraries()
    libraries.look([2, 3], tmp_path)
    assert libraries.variables == {2: variables}
