"""Building the lab: one file with everything in it, or one line that says what is missing."""

import json
import re
from pathlib import Path

import pytest

from benchmarks.studies import lab
from mjbench.errors import InputError
from mjbench.host import machine
from mjbench.report.kinds import WEB
from mjbench.simulation.reference_run import Work
from mjbench.status import ExitCode
from mjbench.store.json_form import json_form
from mjbench.web import npm_package
from mjbench.web.records import WebPathRecord, WebRecord

SCRIPT = '"use strict"; export default loadMujoco; // </script>'


def web_record(model: str, release: str = "3.14.0") -> WebRecord:
    block_ns = {"python_loop": 11_000, "rollout": 10_000, "wasm": 20_000, "wasm_mt": 25_000}
    return WebRecord(
        model=model,
        release=release,
        node="20.1.0",
        block_nbatch=1,
        block_nstep=1000,
        work=Work(contacts=2.5, constraints=0.0, solver_iterations=0.0),
        paths=[
            WebPathRecord(path=path, options={}, block_ns=[ns] * 8) for path, ns in block_ns.items()
        ],
    )


@pytest.fixture
def figures_file(tmp_path: Path) -> Path:
    records = [web_record("cartpole"), web_record("pile")]
    document = WEB.document_type(machine=machine.describe(), results=records)
    file = tmp_path / "web.json"
    file.write_text(json.dumps(json_form(document)))
    return file


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Write what looks like the npm package, in a folder into which npm installed it."""
    folder = tmp_path / "node_modules" / npm_package.NAME
    for name in ("mujoco.js", "mujoco.wasm", "mt/mujoco.js", "mt/mujoco.wasm"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(SCRIPT)
    manifest = {"name": npm_package.NAME, "version": "3.14.0"}
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
    "content",
    ['import a from "./a.mjs";', "export default 1;", 'const a = "</script>";'],
)
def test_what_one_script_cannot_hold_is_refused(tmp_path: Path, content: str) -> None:
    with pytest.raises(InputError, match=r"top\.mjs: cannot put into one script: "):
        lab.bundle("top", write(tmp_path, top=content))


def test_the_names_of_all_modules_of_a_script_differ() -> None:
    for entry in ("lab", "worker"):
        script = lab.bundle(entry)
        names = re.findall(r"^(?:async )?(?:function|class|const|let) (\w+)", script, flags=re.M)
        assert len(names) == len(set(names)), sorted(names)


def test_figures_are_of_the_models_and_the_build_in_the_page_and_c_comes_first(
    figures_file: Path,
) -> None:
    figures = lab.read_figures(figures_file, "3.14.0")
    assert figures is not None
    assert figures.figures == (
        lab.Figure("cartpole", "C", 1e8, None),
        lab.Figure("cartpole", "Python", 1e9 / 11, pytest.approx(1.1)),
        lab.Figure("cartpole", "Node 20.1.0", 5e7, pytest.approx(2.0)),
    )
    assert figures.contacts == {"cartpole": 2.5}


def test_a_file_of_figures_that_is_named_must_be_there(
    package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--package", str(package), "-o", str(tmp_path / "lab.html")]
    assert lab.main([*options, "--figures", str(tmp_path / "none.json")]) == ExitCode.USAGE
    assert re.search(r"^lab: --figures: there is no .*none\.json$", capsys.readouterr().err)
    assert not (tmp_path / "lab.html").exists()


def test_figures_of_another_release_or_none_at_all_are_not_shown(
    figures_file: Path, tmp_path: Path
) -> None:
    assert lab.read_figures(tmp_path / "none.json", "3.14.0") is None
    with pytest.raises(InputError, match=r"is of MuJoCo 3\.14\.0, the page of 3\.12\.0: mjbench"):
        lab.read_figures(figures_file, "3.12.0")
    figures_file.write_text("{}")
    with pytest.raises(InputError, match="cannot read "):
        lab.read_figures(figures_file, "3.14.0")


def test_the_page_is_one_file_that_needs_nothing_else(
    package: Path, figures_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("jinja2")
    page = package / "new/lab.html"
    options = ["--package", str(package), "--figures", str(figures_file), "-o", str(page)]
    lab.main(options)
    text = page.read_text()
    assert str(page) in capsys.readouterr().out
    assert not re.search(r"\b(src|href)=(?!\"data:)", text)
    assert "https:" not in re.sub(r"<script.*?</script>", "", text, flags=re.S)
    assert SCRIPT not in text
    others = re.search(r'id="figures">(.*?)</script>', text)
    assert others is not None
    assert json.loads(others[1])["figures"][2]["ratio"] == pytest.approx(2.0)
    assert "Compare proportions, not speeds" in text


def test_what_is_missing_ends_in_one_line_and_leaves_the_earlier_page(
    package: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "lab.html"
    page.write_text("earlier")
    assert lab.main(["--package", str(tmp_path / "empty"), "-o", str(page)]) != ExitCode.OK
    assert re.search(r"^lab: .*npm install .*@mujoco/mujoco@", capsys.readouterr().err)
    assert page.read_text() == "earlier"
    assert lab.main(["--package", str(package), "-o", str(page / "lab.html")]) != ExitCode.OK
    assert capsys.readouterr().err.startswith("lab: cannot write ")
