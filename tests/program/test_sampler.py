"""Why there are no samples is said in one line."""

from types import SimpleNamespace

import pytest

from mjbench.program import sampler

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
