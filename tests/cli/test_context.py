"""What a command that measures says of the machine."""

import pytest

from mjbench.api.session import Session
from mjbench.cli.context import RunContext
from mjbench.host.machine import ProcessorTime


@pytest.mark.parametrize(("share", "is_reported"), [(0.13, True), (0.01, False)])
def test_time_that_the_host_took_is_reported_where_it_matters(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    share: float,
    is_reported: bool,
) -> None:
    monkeypatch.setattr(ProcessorTime, "stolen_since", lambda now, begin: share)
    with RunContext(session=Session("versions")):
        pass
    expected = "The host took 13 % of this machine's processor time for others"
    assert (expected in capsys.readouterr().out) == is_reported


def test_a_command_that_measures_no_time_says_nothing_of_the_host(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ProcessorTime, "stolen_since", lambda now, begin: 0.5)
    with RunContext(session=Session("instructions", wait=None)):
        pass
    assert capsys.readouterr().out == ""
