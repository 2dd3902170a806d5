"""Records of WebAssembly builds are whole, or refused."""

from dataclasses import replace

import pytest
from example_web_records import path, record, wasm


def test_no_path_has_more_rounds_than_c() -> None:
    longer = replace(path("wasm_mt", 5_000_000), block_ns=[5_000_000] * 9)
    for builds in ([longer], [longer, wasm(name="wasm_mt")]):
        with pytest.raises(ValueError, match="more rounds than rollout"):
            record(*builds)
