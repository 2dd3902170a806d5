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
        (machine_code.similarity(code, other), _similarity_of_names(name, new_name), name, new_name)
        for name, code in gone.items()
        for new_name, other in new.items()
        if min(len(code), len(other)) >= MIN_INSTRUCTIONS
    ]
    renamed: dict[str, str] = {}
    for similarity, _, name, new_name in sorted(pairs, reverse=True):
        if similarity < MIN_SIMILARITY:
            break
        if name not in renamed and new_name not in renamed.values():
            renamed[name] = new_name
    return renamed


def _similarity_of_names(old: str, new: str) -> float:
    return difflib.SequenceMatcher(None, old, new).ratio()
