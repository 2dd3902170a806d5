"""Commands of earlier versions."""

from click.testing import CliRunner

from mjbench.cli import cli


def test_a_command_that_became_an_example_names_it() -> None:
    result = CliRunner().invoke(cli, ["falls", "--samples", "10"])
    assert result.exit_code == 2
    assert result.stderr == (
        "mjbench: `falls` is an example of mjbench's repository now:"
        " python docs/examples/falls.py\n"
    )
