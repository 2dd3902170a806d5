"""Building the lab: one file with everything in it, or one line that says what is missing."""

import json
import re
from pathlib import Path

import pytest

from benchmarks.studies import lab
from mjbench.errors import InputError
from mjbench.status import ExitCode

SCRIPT = '"use strict"; export default loadMujoco; // </script>'


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Write what looks like the npm package, in a folder into which npm installed it."""
    folder = tmp_path / "node_modules" / lab.NAME
    for name in ("mujoco.js", "mujoco.wasm"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(SCRIPT)
    manifest = {"name": lab.NAME, "version": "3.14.0"}
    (folder / "package.json").write_text(json.dumps(manifest))
    return tmp_path


def write(folder: Path, **modules: str) -> Path:
    for name, content in modules.items():
        (folder / f"{name}.mjs").write_text(content)
    return folder


def test_modules_become_one_script_in_the_order_of_their_imports(tmp_path: Path) -> None:
    write(
        tmp_path,
        top='import { b } from "./middle.mjs";\nimport {\n  a,\n} from "./base.mjs";\n\nb(a);\n',
        middle='import { a } from "./base.mjs";\nexport function b() {\n  return a;\n}\n',
        base="// a\nexport const a = 1;\n",
    )
    expected = "// a\nconst a = 1;\n\nfunction b() {\n  return a;\n}\n\nb(a);"
    assert lab.bundle("top", tmp_path) == expected


@pytest.mark.parametrize(
    "content", ['import a from "./a.mjs";', "export default 1;", 'const a = "</script>";']
)
def test_what_one_script_cannot_hold_is_refused(tmp_path: Path, content: str) -> None:
    with pytest.raises(InputError, match=r"top\.mjs: cannot put into one script: "):
        lab.bundle("top", write(tmp_path, top=content))


def test_the_names_of_all_modules_of_a_script_differ() -> None:
    for entry in ("lab", "worker"):
        script = lab.bundle(entry)
        names = re.findall(r"^(?:async )?(?:function|class|const|let) (\w+)", script, flags=re.M)
        assert len(names) == len(set(names)), sorted(names)


def test_the_page_is_one_file_that_needs_nothing_else(
    package: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("jinja2")
    page = package / "new/lab.html"
    lab.main(["--package", str(package), "-o", str(page)])
    text = page.read_text()
    assert str(page) in capsys.readouterr().out
    assert not re.search(r"\b(src|href)=(?!\"data:)", text)
    assert "https:" not in re.sub(r"<script.*?</script>", "", text, flags=re.S)
    assert SCRIPT not in text
    assert "This page contains MuJoCo 3.14.0" in text


def test_what_is_missing_ends_in_one_line_and_leaves_the_earlier_page(
    package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "lab.html"
    page.write_text("earlier")
    assert lab.main(["--package", str(tmp_path / "empty"), "-o", str(page)]) != ExitCode.OK
    assert re.search(
        r"^lab: .*empty has no npm package @mujoco/mujoco: make lab installs ",
        capsys.readouterr().err,
    )
    assert page.read_text() == "earlier"
    assert lab.main(["--package", str(package), "-o", str(page / "lab.html")]) != ExitCode.OK
    assert capsys.readouterr().err.startswith("lab: cannot write ")
