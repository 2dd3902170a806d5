"""The findings of `mjbench lint`, as a line and as a document; imports no engine."""

from collections.abc import Sequence
from dataclasses import dataclass

from mjbench.instrument.runs import SCHEMA
from mjbench.loop.lint import Finding


@dataclass(frozen=True, kw_only=True)
class LintDocument:
    """What `mjbench lint --json` writes."""

    schema: int = SCHEMA
    findings: Sequence[Finding]


def finding_line(finding: Finding) -> str:
    """Return a finding as linters print it: `FILE:LINE:COLUMN CODE MESSAGE`, with its cost."""
    ns = finding.ns_per_step
    cost = f" (about {ns:.0f} ns per step)" if ns else ""
    place = f"{finding.file}:{finding.line}:{finding.col}"
    return f"{place} {finding.code} {finding.message}{cost}"
