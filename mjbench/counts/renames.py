"""Find functions that were renamed from one release to another, by their machine code."""

import difflib
from collections.abc import Mapping, Sequence

from mjbench.counts import machine_code
from mjbench.counts.machine_code import Instruction

# A function is the same under another name where this share of the code is, or a smaller share and
# most of the name. Among the functions that only one of two releases executes on a humanoid (MuJoCo
# 2.3.7 and 3.2.1, 2.3.7 and 3.4.0, 3.3.1 and 3.4.0) or a pile of boxes (3.17.0 and 4.0.0), renamed
# ones share 0.42 to 0.97 of the code and 0.71 to 0.96 of the name, others up to 0.57 and 0.55.
MIN_SIMILARITY = 0.75
MIN_SIMILARITY_OF_LIKE_NAMES = 0.4
MIN_SIMILARITY_OF_NAMES = 0.7
# Shorter functions are similar by chance.
MIN_INSTRUCTIONS = 10

Codes = Mapping[str, Sequence[Instruction]]


def renamed_functions(gone: Codes, new: Codes) -> dict[str, str]:
    """Return the new names of functions by their old ones; a function has one of each.

    Args:
      gone: the code of functions of the baseline, by name.
      new: the code of functions of the candidate that may be the same.
    """
    pairs = [
        (machine_code.similarity(code, other), _similarity_of_names(name, new_name), name, new_name)
        for name, code in gone.items()
        for new_name, other in new.items()
        if min(len(code), len(other)) >= MIN_INSTRUCTIONS
    ]
    renamed: dict[str, str] = {}
    for similarity, similarity_of_names, name, new_name in sorted(pairs, reverse=True):
        is_free = name not in renamed and new_name not in renamed.values()
        if is_free and _is_same(similarity, similarity_of_names):
            renamed[name] = new_name
    return renamed


def is_same_function(code: Sequence[Instruction], other: Sequence[Instruction]) -> bool:
    """Return whether functions of the same name are the same, however much the code changed."""
    return _is_same(machine_code.similarity(code, other), similarity_of_names=1.0)


def _is_same(similarity: float, similarity_of_names: float) -> bool:
    is_like_named = similarity_of_names >= MIN_SIMILARITY_OF_NAMES
    return similarity >= (MIN_SIMILARITY_OF_LIKE_NAMES if is_like_named else MIN_SIMILARITY)


def _similarity_of_names(old: str, new: str) -> float:
    return difflib.SequenceMatcher(None, old, new).ratio()
