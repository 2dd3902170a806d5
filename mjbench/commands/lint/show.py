"""The findings of `mjbench lint`, in each of its formats; imports no engine."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mjbench
from mjbench.commands.lint.check import Finding
from mjbench.commands.lint.rules import RULES
from mjbench.commands.lint.script_files import UncheckedFile
from mjbench.errors import printable
from mjbench.results.runs import SCHEMA


@dataclass(frozen=True, kw_only=True)
class LintDocument:
    """What `mjbench lint --json` writes."""

    schema: int = SCHEMA
    findings: Sequence[Finding]
    unchecked: Sequence[UncheckedFile]


def finding_line(finding: Finding) -> str:
    """Return a finding as linters print it: its place, its code, what it is, and its cost."""
    ns = finding.ns_per_step
    cost = f" (about {ns:.0f} ns per step)" if ns else ""
    return f"{finding_place(finding)} {finding.code} {finding.message}{cost}"


def finding_place(finding: Finding) -> str:
    """Return `FILE:LINE:COLUMN`."""
    file = printable(finding.file)
    # a runner of GitHub takes a line that begins with two colons for a command
    place = f"./{file}" if file.startswith("::") else file
    return f"{place}:{finding.line}:{finding.col}"


def statistics_lines(findings: Sequence[Finding]) -> list[str]:
    counts = Counter(finding.code for finding in findings)
    width = max((len(str(count)) for count in counts.values()), default=0)
    return [
        f"{counts[rule.code]:{width}} {rule.code} {rule.message}"
        for rule in RULES
        if rule.code in counts
    ]


def as_github(document: LintDocument) -> str:
    """Return findings as workflow commands of GitHub Actions, which mark lines of a change."""
    lines = []
    for finding in document.findings:
        places = {"file": finding.file, "line": str(finding.line), "col": str(finding.col)}
        places["title"] = finding.code
        values = ",".join(f"{key}={_github_value(value)}" for key, value in places.items())
        lines.append(f"::error {values}::{_github_text(finding_line(finding))}\n")
    for unchecked in document.unchecked:
        file = _github_value(unchecked.file)
        text = _github_text(unchecked.detail)
        lines.append(f"::warning file={file},title=not checked::{text}\n")
    return "".join(lines)


def _github_text(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _github_value(text: str) -> str:
    return _github_text(printable(text)).replace(":", "%3A").replace(",", "%2C")


def as_sarif(document: LintDocument) -> str:
    """Return findings in the Static Analysis Results Interchange Format (SARIF 2.1.0, OASIS)."""
    rules = [
        {
            "id": rule.code,
            "shortDescription": {"text": rule.message},
            "fullDescription": {"text": rule.explanation},
        }
        for rule in RULES
    ]
    notifications = [
        {"level": "error", "message": {"text": f"{printable(u.file)}: {u.detail}"}}
        for u in document.unchecked
    ]
    ending = {"executionSuccessful": not notifications, "toolExecutionNotifications": notifications}
    driver = {"name": "mjbench lint", "version": mjbench.__version__, "rules": rules}
    run = {
        "tool": {"driver": driver},
        "columnKind": "unicodeCodePoints",
        "invocations": [ending],
        "results": [_sarif_result(finding) for finding in document.findings],
    }
    schema = "https://json.schemastore.org/sarif-2.1.0.json"
    content = {"$schema": schema, "version": "2.1.0", "runs": [run]}
    return json.dumps(content, indent=1) + "\n"


def _sarif_result(finding: Finding) -> Mapping[str, Any]:
    place = {
        "artifactLocation": {"uri": _uri(finding.file)},
        "region": {"startLine": finding.line, "startColumn": finding.col},
    }
    return {
        "ruleId": finding.code,
        "level": "error" if finding.is_wrong_result else "warning",
        "message": {"text": finding.message},
        "locations": [{"physicalLocation": place}],
    }


def _uri(file: str) -> str:
    uri = Path("/", file).as_uri()
    return uri if Path(file).is_absolute() else uri.removeprefix("file:///")
