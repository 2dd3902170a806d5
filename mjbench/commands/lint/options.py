"""The options of `mjbench lint` that name files."""

from dataclasses import dataclass

from mjbench.commands.shared_options import JsonOptions, output_option


@dataclass(frozen=True, kw_only=True)
class LintOptions(JsonOptions):
    """Where findings go, beside standard output."""

    github_file: str | None = output_option("--github", "annotations of GitHub Actions")
    sarif_file: str | None = output_option("--sarif", "findings as SARIF, for code scanning,")
