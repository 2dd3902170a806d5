"""Build the lab: one HTML file in which MuJoCo's WebAssembly build runs in a browser, offline.

    python -m benchmarks.studies.lab [-o FILE] [--package DIR] [--figures FILE]

puts together the sources in docs/lab, the shipped models, and the npm package that `mjbench web`
measures. The package is the code of others: the page that is written holds it, not the project.
Figures of C and of Node are those that `mjbench web --json results/web.json` wrote.
"""

import base64
import gzip
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import mjbench
from benchmarks.studies import tally_command
from mjbench import extras, paths
from mjbench.errors import InputError, MachineError, one_line, writing
from mjbench.host import files
from mjbench.simulation import models
from mjbench.status import ExitCode
from mjbench.web import npm_package
from mjbench.web.npm_package import Build, NpmPackage

ROOT = Path(__file__).parents[2]
SOURCES = ROOT / "docs/lab"
PAGE = ROOT / "build/lab/mujoco-lab.html"
# What `mjbench web` measured, where it was committed.
RESULTS = ROOT / "results/web.json"
MODELS = ("cartpole", "humanoid")
# The one form in which the sources import each other.
_IMPORT = re.compile(r'^import \{[^}]*\} from "\./([\w-]+)\.mjs";\n', flags=re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(async )?(function|class|const)\b)", flags=re.MULTILINE)
_LEFT_OVER = re.compile(r"^(import|export)\b.*|</script", flags=re.MULTILINE)


@dataclass(frozen=True)
class Figure:
    """What a program reached on a model.

    Attributes:
      where: such as `C`.
      steps_per_s: the median.
      ratio: time over that of C; None for C.
    """

    model: str
    where: str
    steps_per_s: float
    ratio: float | None


@dataclass(frozen=True)
class OtherFigures:
    """What other programs than a browser reached.

    Attributes:
      contacts: contacts of a step, by model.
    """

    machine: str
    figures: tuple[Figure, ...]
    contacts: Mapping[str, float]


def read_figures(file: Path, release: str) -> OtherFigures | None:
    """Return what `mjbench web --json` wrote; None where there is no such file.

    Raises:
      InputError: it is no such document, or of another release.
    """
    # late: asv imports this module where few packages are
    import msgspec

    from mjbench.report.kinds import WEB
    from mjbench.store.json_form import json_type

    if not file.exists():
        return None
    kind: Any = WEB.document_type
    try:
        document = msgspec.json.decode(file.read_bytes(), type=json_type(kind))
    except (OSError, msgspec.DecodeError) as error:
        raise InputError(f"cannot read {file}: {one_line(error)}") from error
    rows = [row for row in document.results if row.model in MODELS]
    if others := sorted({row.release for row in rows} - {release}):
        raise InputError(
            f"{file} is of MuJoCo {', '.join(others)}, the page of {release}:"
            f" mjbench web {' '.join(MODELS)} --json {file}"
        )
    machine = document.machine
    return OtherFigures(
        machine=f"{machine.cpu}, {machine.usable_cores} cores",
        figures=tuple(figure for row in rows for figure in _figures(row)),
        contacts={row.model: row.work.contacts for row in rows if row.work is not None},
    )


def _figures(row: Any) -> Iterator[Figure]:
    """Yield what programs reached with the build that is in the page, and what C did; C first."""
    from mjbench.web.records import C_PATH

    names = {
        C_PATH: "C",
        paths.BASE: "Python",
        Build.WASM.value: f"Node {row.node}",
    }
    for path in sorted(row.paths, key=lambda path: path.path != C_PATH):
        if path.steps_per_s is None or path.path not in names:
            continue
        ratio = None if path.path == C_PATH or path.ratio is None else path.ratio.median
        yield Figure(row.model, names[path.path], path.steps_per_s, ratio)


def bundle(entry: str, folder: Path = SOURCES) -> str:
    """Return a module and all that it imports as one script, whose names share one scope.

    Args:
      folder: holds the module, and what it imports by `import { … } from "./NAME.mjs";`.

    Raises:
      InputError: a module imports or exports in another form, or holds the end of a script element.
    """
    parts: dict[str, str] = {}

    def visit(name: str) -> None:
        if name in parts:
            return
        source = (folder / f"{name}.mjs").read_text(encoding="utf-8")
        parts[name] = ""  # seen: modules may import each other
        for imported in _IMPORT.findall(source):
            visit(imported)
        content = _EXPORT.sub("", _IMPORT.sub("", source))
        if left_over := _LEFT_OVER.search(content):
            raise InputError(f"{name}.mjs: cannot put into one script: {left_over[0]}")
        del parts[name]
        parts[name] = content.strip()

    visit(entry)
    return "\n\n".join(parts.values())


def render(package: NpmPackage, others: OtherFigures | None) -> str:
    """Return the page.

    Args:
      others: figures beside those of the browser.
    """
    try:
        import jinja2
        from markupsafe import Markup
    except ImportError as error:
        raise MachineError(f"the lab needs Jinja2: {extras.install_command('report')}") from error
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(SOURCES),
        autoescape=jinja2.select_autoescape(["html.j2"]),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
    )
    script = package.script(Build.WASM)
    return environment.get_template("index.html.j2").render(
        version=package.version,
        package=npm_package.NAME,
        mjbench_version=mjbench.__version__,
        style=Markup((SOURCES / "style.css").read_text(encoding="utf-8")),
        script=Markup(bundle("lab")),
        worker=Markup(bundle("worker")),
        engine_script=_packed(script),
        engine_wasm=_packed(script.with_suffix(".wasm")),
        models=[{"name": name, "xml": _mjcf(name)} for name in MODELS],
        others=None if others is None else asdict(others),
    )


def _packed(file: Path) -> str:
    """Return a file's content, compressed by gzip, in base64."""
    try:
        content = file.read_bytes()
    except OSError as error:
        raise MachineError(f"cannot read {file}: {error.strerror}") from error
    return base64.b64encode(gzip.compress(content, mtime=0)).decode()


def _mjcf(name: str) -> str:
    return models.resolve(name).path.read_text(encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> ExitCode:
    """Build it."""
    parser = tally_command.parser(__doc__)
    parser.add_argument("-o", "--output", type=Path, default=PAGE, metavar="FILE")
    parser.add_argument("--package", type=Path, metavar="DIR", help="into which npm installed it")
    parser.add_argument("--figures", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)

    def action() -> ExitCode:
        package = npm_package.find(folder=options.package)
        if options.figures is not None and not options.figures.exists():
            raise InputError(f"--figures: there is no {options.figures}")
        page = render(package, read_figures(options.figures or RESULTS, package.version))
        with writing(options.output):
            options.output.parent.mkdir(parents=True, exist_ok=True)
            with files.replacing(options.output) as file:
                file.write_text(page, encoding="utf-8")
        print(f"Lab: {options.output}")
        return ExitCode.OK

    return tally_command.run("lab", action)


if __name__ == "__main__":
    sys.exit(main())
