"""The findings of `mjbench lint`, as a line and as a document; imports no engine."""

from collections.abc import Sequence
from dataclasses import dataclass

from mjbench.errors import printable
from mjbench.instrument.runs import SCHEMA
from mjbench.loop.lint import Finding
from mjbench.loop.script_files import UncheckedFile


@dataclass(frozen=True, kw_only=True)
class LintDocument:
    """What `mjbench lint --json` writes."""

    schema: int = SCHEMA
    findings: Sequence[Finding]
    unchecked: Sequence[UncheckedFile]


def finding_line(finding: Finding) -> str:
    """Return a finding as linters print it: `FILE:LINE:COLUMN CODE MESSAGE`, with its cost.

    In a notebook, `FILE:cell CELL:LINE:COLUMN`.
    """
    ns = finding.ns_per_step
    cost = f" (about {ns:.0f} ns per step)" if ns else ""
    cell = f"cell {finding.cell}:" if finding.cell else ""
    place = f"{printable(finding.file)}:{cell}{finding.line}:{finding.col}"
    return f"{place} {finding.code} {finding.message}{cost}"
