"""Build the lab: one HTML file in which MuJoCo's WebAssembly build runs in a browser, offline.

    python -m benchmarks.studies.lab [-o FILE] [--package DIR]

puts together the sources in docs/lab, the shipped models, and the npm package that `make lab`
installs. The package is the code of others: the page that is written holds it, not the project.
"""

import base64
import gzip
import json
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mjbench
from benchmarks.studies import tally_command
from mjbench import extras
from mjbench.errors import InputError, MachineError, writing
from mjbench.host import files
from mjbench.simulation import models
from mjbench.status import ExitCode

ROOT = Path(__file__).parents[2]
SOURCES = ROOT / "docs/lab"
PAGE = ROOT / "build/lab/mujoco-lab.html"
# Of the npm package, and the folder into which `make lab` has npm install it.
NAME = "@mujoco/mujoco"
INSTALLED = ROOT / "build/lab"
MODELS = ("cartpole", "humanoid")
# The one form in which the sources import each other.
_IMPORT = re.compile(r'^import \{[^}]*\} from "\./([\w-]+)\.mjs";\n', flags=re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(async )?(function|class|const)\b)", flags=re.MULTILINE)
_LEFT_OVER = re.compile(r"^(import|export)\b.*|</script", flags=re.MULTILINE)


@dataclass(frozen=True)
class NpmPackage:
    """MuJoCo's installed WebAssembly build: its folder has `mujoco.js` and `mujoco.wasm`."""

    folder: Path
    version: str


def find_package(folder: Path) -> NpmPackage:
    """Return the package that npm installed into a folder.

    Raises:
      MachineError: it is not there.
    """
    package = folder / "node_modules" / NAME
    try:
        version = json.loads((package / "package.json").read_text(encoding="utf-8"))["version"]
    except (OSError, ValueError, KeyError) as error:
        raise MachineError(
            f"{folder} has no npm package {NAME}: make lab installs the release that"
            " docs/lab/package.json names"
        ) from error
    return NpmPackage(package, str(version))


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


def render(package: NpmPackage) -> str:
    """Return the page."""
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
    return environment.get_template("index.html.j2").render(
        version=package.version,
        package=NAME,
        mjbench_version=mjbench.__version__,
        style=Markup((SOURCES / "style.css").read_text(encoding="utf-8")),
        script=Markup(bundle("lab")),
        worker=Markup(bundle("worker")),
        engine_script=_packed(package.folder / "mujoco.js"),
        engine_wasm=_packed(package.folder / "mujoco.wasm"),
        models=[{"name": name, "xml": _mjcf(name)} for name in MODELS],
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
    parser.add_argument(
        "--package", type=Path, default=INSTALLED, metavar="DIR", help="into which npm installed it"
    )
    options = parser.parse_args(arguments)

    def action() -> ExitCode:
        page = render(find_package(options.package))
        with writing(options.output):
            options.output.parent.mkdir(parents=True, exist_ok=True)
            with files.replacing(options.output) as file:
                file.write_text(page, encoding="utf-8")
        print(f"Lab: {options.output}")
        return ExitCode.OK

    return tally_command.run("lab", action)


if __name__ == "__main__":
    sys.exit(main())
