"""Why there are no samples is said in one line; the rate is lowered where samples cost too much."""

from types import SimpleNamespace

import pytest

from mjbench.program import launch, sampler

REFUSED = """\
Error: Permission Denied: Try running again with elevated permissions by going 'sudo env …'
Error: Failed to open process 1 - check if it is running.
Reason: Permission denied (os error 13)
"""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (REFUSED, ["Permission denied", "SYS_PTRACE"]),
        ("Error: Operation not permitted\n", ["SYS_PTRACE", "ptrace_scope"]),
        ("py-spy> Samples: 0 Errors: 0\n", [sampler.TOO_SHORT]),
        ("Error: /root/x: anyhow\n", [sampler.TOO_SHORT]),
        ("", [sampler.TOO_SHORT]),
    ],
)
def test_why_there_are_no_samples(tmp_path, text, words):
    log = tmp_path / "log"
    log.write_text(text)
    problem = sampler.Sampler(SimpleNamespace(), tmp_path / "samples.json", log).problem()
    assert all(word in problem for word in words)
    assert "\n" not in problem


class FakeSampler:
    """A profiler that never ends by itself."""

    def __init__(self, folder):
        self.is_running = True
        self.file = folder / "samples.json"
        self.has_begun = True

    def stop(self):
        self.has_begun = False


@pytest.mark.parametrize(("paused", "rate"), [(3, 10), (30, 3), (6, 5)])
def test_the_rate_is_lowered_once_where_samples_cost_too_much(tmp_path, monkeypatch, paused, rate):
    started = []

    def start(pid, folder, rate_hz, has_native, seconds=None):
        started.append(rate_hz)
        return FakeSampler(folder)

    monkeypatch.setattr(sampler, "start", start)
    states = iter([b"t"] * paused + [b"R"] * 10_000)
    monkeypatch.setattr(launch, "process_state", lambda pid: next(states))
    profiling = launch.Profiling.begin(1, tmp_path, launch.Sampling())
    for _ in range(2 * launch.LOOKS_TO_ADAPT):
        profiling.look_for_pause()
    assert profiling.rate_hz == rate
    assert started == ([10] if rate == 10 else [10, rate])


def test_a_rate_that_was_asked_for_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(sampler, "start", lambda pid, folder, *_: FakeSampler(folder))
    monkeypatch.setattr(launch, "process_state", lambda pid: b"t")
    profiling = launch.Profiling.begin(1, tmp_path, launch.Sampling(50))
    for _ in range(2 * launch.LOOKS_TO_ADAPT):
        profiling.look_for_pause()
    assert profiling.rate_hz == 50
    assert profiling.paused_share == 1.0


@pytest.mark.parametrize(
    ("children", "has_native", "started"),
    [(1, None, [True]), (2, None, [True, False]), (2, True, [True]), (0, False, [False])],
)
def test_stacks_of_libraries_are_left_out_of_many_processes_unless_asked_for(
    tmp_path, monkeypatch, children, has_native, started
):
    modes = []

    def start(pid, folder, rate_hz, native, seconds=None):
        modes.append(native)
        return FakeSampler(folder)

    monkeypatch.setattr(sampler, "start", start)
    for pid in range(1, children + 2):
        (tmp_path / f"{pid}.steps").touch()
    profiling = launch.Profiling.begin(1, tmp_path, launch.Sampling(None, has_native))
    for _ in range(3):
        profiling.look()
    assert modes == started
    assert profiling.has_native == started[-1]
    assert profiling.rate_hz == sampler.DEFAULT_RATE_HZ
