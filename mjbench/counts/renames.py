"""Find functions that were renamed from one release to another, by their machine code."""

import difflib
from collections.abc import Mapping, Sequence

from mjbench.counts import machine_code
from mjbench.counts.machine_code import Instruction

# A renamed function has at least this share of its code in common with itself. Between MuJoCo 3.1.3
# and 3.2.0, 3.3.1 and 3.4.0, and 3.17.0 and 4.0.0, renamed functions had 0.66 to 1, others up to
# 0.65.
MIN_SIMILARITY = 0.75
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
        (machine_code.similarity(old_code, new_code), _similarity_of_names(old, new), old, new)
        for old, old_code in gone.items()
        for new, new_code in new.items()
        if min(len(old_code), len(new_code)) >= MIN_INSTRUCTIONS
    ]
    renamed: dict[str, str] = {}
    for similarity, _, old, name in sorted(pairs, reverse=True):
        if similarity < MIN_SIMILARITY:
            break
        if old not in renamed and name not in renamed.values():
            renamed[old] = name
    return renamed


def _similarity_of_names(old: str, new: str) -> float:
    return difflib.SequenceMatcher(None, old, new).ratio()
