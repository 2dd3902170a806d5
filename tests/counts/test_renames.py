"""Functions that were renamed, found by their code."""

from assembly import ADD, COPY, LOAD_FIELD, RETURN, ROOT, SUBTRACT

from mjbench.counts.machine_code import Instruction, Surroundings, decode
from mjbench.counts.renames import renamed_functions


def decoded(*code: bytes) -> list[Instruction]:
    return decode(b"".join(code), 0x1000, Surroundings())


SUMS = decoded(*[ADD, SUBTRACT, COPY, LOAD_FIELD] * 4, RETURN)
SUMS_AND_ROOT = decoded(ROOT, *[ADD, SUBTRACT, COPY, LOAD_FIELD] * 4, RETURN)
ROOTS = decoded(*[ROOT, LOAD_FIELD] * 8, RETURN)


def test_each_function_is_matched_with_the_most_similar_one() -> None:
    gone = {"f": SUMS, "g": SUMS_AND_ROOT, "h": ROOTS}
    new = {"mj_g": SUMS_AND_ROOT, "mj_f": SUMS, "mj_h": decoded(ADD, RETURN)}
    assert renamed_functions(gone, new) == {"f": "mj_f", "g": "mj_g"}


def test_of_functions_of_equal_code_the_similar_name_decides() -> None:
    assert renamed_functions({"copyRow": SUMS}, {"advance": SUMS, "mj_copyRow": SUMS}) == {
        "copyRow": "mj_copyRow"
    }


def test_a_like_name_needs_less_similar_code() -> None:
    half = decoded(*[ADD, SUBTRACT, COPY, LOAD_FIELD] * 2, *[ROOT, LOAD_FIELD] * 4, RETURN)
    assert renamed_functions({"mj_copyRow": SUMS}, {"mj_copyRows": half}) == {
        "mj_copyRow": "mj_copyRows"
    }
    assert renamed_functions({"mj_copyRow": SUMS}, {"advance": half}) == {}
    assert renamed_functions({"mj_copyRow": SUMS}, {"mj_copyRows": ROOTS}) == {}


def test_short_functions_are_not_matched() -> None:
    assert renamed_functions({"f": SUMS[:9]}, {"g": SUMS[:9]}) == {}
    assert renamed_functions({"f": SUMS[:10]}, {"g": SUMS[:10]}) == {"f": "g"}
