"""What `mjbench web` says of made-up results."""

from dataclasses import replace

from example_web_records import CHECK, path, record, wasm

from mjbench.pages import terminal
from mjbench.report import web
from mjbench.status import Status
from mjbench.web.records import WebRecord
from mjbench.web.rounding_check import PointDifference


def printed(stored: WebRecord) -> str:
    return terminal.text_of(web.sections([stored]))


def test_speeds_are_over_c_round_by_round() -> None:
    *_, build = record(wasm()).path_results
    assert build.step_ns == 25_000.0
    assert build.steps_per_s == 40_000.0
    assert build.ratio is not None
    assert (round(build.ratio.median, 12), build.rounds) == (2.5, 8)


def test_the_conclusion_has_speed_and_agreement() -> None:
    first = printed(record(wasm())).splitlines()[0]
    assert first == (
        "cartpole: in WebAssembly, a step takes 2.50 times as long as in C (2.50 to 2.50);"
        " after 100 steps its states are within 3.0e-14 of C's"
    )
    identical = wasm(replace(CHECK, first=None))
    assert "its states are C's to the last bit" in printed(record(identical)).splitlines()[0]


def test_the_conclusion_names_a_build_that_disagrees_beside_one_that_agrees() -> None:
    bad = replace(wasm(), block_ns=(), status=Status.DISAGREES, detail="it differs")
    first = printed(record(bad, wasm(name="wasm_mt"))).splitlines()[0]
    assert first == (
        "cartpole: in WebAssembly (wasm_mt), a step takes 2.50 times as long as in C"
        " (2.50 to 2.50);"
        " after 100 steps its states are within 3.0e-14 of C's; wasm disagrees with C"
    )


def test_what_differs_may_be_no_part_of_the_motion() -> None:
    still = replace(CHECK, points=[PointDifference(0, 0.0, 0.0), PointDifference(100, 0.0, 1e-15)])
    first = printed(record(wasm(still))).splitlines()[0]
    assert first.endswith("; over 100 steps its positions, velocities and activations are C's")


def test_it_is_said_when_blocks_are_short() -> None:
    assert "ms in C" not in printed(record(wasm()))
    python_loop, _, build = record(wasm()).paths
    short = replace(record(), paths=[python_loop, path("rollout", 800_000), build])
    assert printed(short).startswith("A block takes only 0.80 ms in C")


def test_what_is_the_same_of_builds_is_said_once() -> None:
    text = printed(record(wasm(), wasm(name="wasm_mt")))
    line = (
        "wasm, wasm_mt: first differs from C after step 7, in qpos[1] of simulation 3, by 2.2e-16;"
        " also with the model that C compiled"
    )
    assert text.splitlines().count(line) == 1


def test_it_is_said_when_only_the_compiled_model_differs() -> None:
    only = replace(CHECK, first_of_same_model=None)
    assert "it does not: only the compiled model differs" in printed(record(wasm(only)))


def test_a_build_that_disagrees_comes_first() -> None:
    bad = replace(wasm(), block_ns=(), status=Status.DISAGREES, detail="it differs")
    text = printed(record(bad))
    assert text.splitlines()[0] == "cartpole: wasm: disagrees: it differs"
    row = next(line for line in text.splitlines() if line.startswith("wasm "))
    assert "NO" in row and "25,000" not in row


def test_a_model_that_failed_has_no_table() -> None:
    stored = WebRecord(
        model="a.xml", release="3.14.0", node="20.1.2", status=Status.INPUT, detail="b"
    )
    assert printed(stored) == "a.xml: input: b"
