"""The options of `mjbench show`, and of the lists of what there is to measure."""

from dataclasses import dataclass
from pathlib import Path

from mjbench.commands.shared_options import (
    FormOptions,
    JsonOptions,
    TimeLimitOptions,
    code_option,
    output_option,
    results_option,
)
from mjbench.commands.versions.fail_on import FailOnOptions
from mjbench.options import FLAG, option


@dataclass(frozen=True, kw_only=True)
class ShowOptions(FailOnOptions, FormOptions):
    """What is shown of run files, and where it goes."""

    lists_runs: bool = option(
        False, FLAG, "List the run files in --results, newest first: -1, -2, …", "--list"
    )
    across: bool = option(
        False,
        FLAG,
        "Compare two RUNs even where machine, JAX, jaxlib, XLA flags, device or precision differ.",
    )
    code: bool = code_option()
    results: Path = results_option()
    junit_file: str | None = output_option("--junit", "verdicts of one RUN as JUnit XML")
    comment_file: str | None = output_option(
        "--comment", "verdicts of one RUN as a comment on a pull request"
    )
    github_benchmark_file: str | None = output_option(
        "--github-benchmark", "times of one RUN for github-action-benchmark"
    )


@dataclass(frozen=True, kw_only=True)
class ListOptions(TimeLimitOptions, JsonOptions):
    """How models are listed."""
