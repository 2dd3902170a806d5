"""What was planted in a repository, and what the guide says of it."""

import ast

from benchmarks.studies import revisions_planted


def test_planted_revisions_differ_in_their_code_and_others_do_not() -> None:
    base = ast.dump(ast.parse(revisions_planted.BASE).body[1])
    for case in revisions_planted.planted():
        assert ast.dump(ast.parse(case.text)) != ast.dump(ast.parse(revisions_planted.BASE))
    texts = set()
    for case in revisions_planted.unchanged(20):
        texts.add(case.text)
        assert ast.dump(ast.parse(case.text).body[2]) == base  # after the docstring and the import
    assert len(texts) == 20
