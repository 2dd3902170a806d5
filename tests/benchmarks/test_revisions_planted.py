"""What was planted in a repository, and what the guide says of it."""

import ast
import json
import math
import re

from commands import ROOT

from benchmarks import revisions_planted

RESULTS = json.loads((ROOT / "results/revisions.json").read_text())


def test_planted_revisions_differ_in_their_code_and_others_do_not() -> None:
    base = ast.dump(ast.parse(revisions_planted.BASE).body[1])
    for case in revisions_planted.planted():
        assert ast.dump(ast.parse(case.text)) != ast.dump(ast.parse(revisions_planted.BASE))
    texts = set()
    for case in revisions_planted.unchanged(20):
        texts.add(case.text)
        assert ast.dump(ast.parse(case.text).body[2]) == base  # after the docstring and the import
    assert len(texts) == 20


def test_the_guide_has_the_committed_verdicts() -> None:
    guide = (ROOT / "docs/guides/revisions.md").read_text()
    for result in RESULTS:
        verdict = result["verdict"]
        if result["is_slower"]:
            change = f"{100 * (verdict['ratio']['estimate'] - 1):.2g}"
            assert f"| {result['case']} | {verdict['verdict']} by {change} % |" in guide
    unchanged = [result["verdict"] for result in RESULTS if not result["is_slower"]]
    assert {verdict["verdict"] for verdict in unchanged} == {"same"}
    assert f"docstrings, {len(unchanged)} times | same |" in guide
    (seconds,) = re.findall(r"A verdict took at most (\d+) s", guide)
    assert int(seconds) == math.ceil(max(result["verdict"]["seconds"] for result in RESULTS))
