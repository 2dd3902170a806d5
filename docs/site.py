"""Write the documents, and a report of each run file in results/, as a static site: `make site`.

    python docs/site.py -o build/site

Sphinx with MyST and Furo renders a copy of the documents, which holds only files of the project.
Markdown of a pull request is somebody else's, so no directive reads files, and every image and
download must be a file of that copy. The HTML of `asv publish` and of `make lab` is part of the
site where it was built.
"""

import argparse
import html
import io
import shutil
import sys
import tempfile
import urllib.parse
from collections.abc import Iterator, Sequence
from pathlib import Path

from docutils import nodes
from sphinx.addnodes import download_reference
from sphinx.application import Sphinx
from sphinx.errors import SphinxError
from sphinx.util.console import nocolor
from sphinx.util.docutils import docutils_namespace, patch_docutils

from mjbench.commands.show import reports
from mjbench.errors import MjbenchError, printable
from mjbench.results import html as report_page

# Documents, run files, and pages that others wrote: their files, and the first page.
DOCUMENTS = ("*.md", "LICENSE", "docs/**/*", "models/README.md", "results/README.md")
RUNS = ("results/runs/*.jsonl",)
WRITTEN = {
    "asv": (".asv/html/**/*", "index.html"),
    "lab": ("build/lab/*.html", "mujoco-lab.html"),
}
# A folder with this file is a site, which a new one may replace.
MARKER = ".mjbench-site"
# Directives of docutils, Sphinx and MyST that read files heed this.
DOCUTILS = "[general]\nfile_insertion_enabled: no\nraw_enabled: no\n"
SETTINGS = {
    "project": "mjbench",
    "html_title": "mjbench",
    "extensions": ["myst_parser"],
    "html_theme": "furo",
    "html_copy_source": False,
    "html_show_copyright": False,
    "html_extra_path": ["extra"],
    "exclude_patterns": ["extra", "site.py"],
    "smartquotes": False,
    "myst_heading_anchors": 4,
    # links to source files, which are not on the site
    "suppress_warnings": ["myst.xref_missing"],
}
GROUPS = {
    "Results": ["reports", "docs/history", "docs/results"],
    "Guides": ["docs/guides/README", "docs/guides/*"],
    "How a number comes about": ["docs/method/README", "docs/method/*"],
    "Reference": ["docs/*"],
    "Project": ["*", "models/README", "results/README"],
}


def main() -> int:
    parser = argparse.ArgumentParser(description="Write the documents and reports as a site.")
    parser.add_argument("-o", "--output", type=Path, default=Path("build/site"))
    parser.add_argument("--project", type=Path, default=Path(__file__).parents[1])
    options = parser.parse_args()
    try:
        for line in build(options.project.resolve(), options.output.resolve()):
            print(line, file=sys.stderr)
    except (SphinxError, MjbenchError, OSError) as error:
        sys.exit(f"docs/site.py: {error}")
    print(f"Site: {options.output / 'index.html'}")
    return 0


def build(project: Path, output: Path) -> list[str]:
    """Write the site of a project; return what was left out, and what Sphinx warns of."""
    if output.exists() and any(output.iterdir()) and not (output / MARKER).is_file():
        raise SphinxError(f"{output} is not a site: choose another folder")
    with tempfile.TemporaryDirectory() as folder:
        source, rendered = Path(folder).resolve() / "source", Path(folder) / "site"
        copy(project, DOCUMENTS, source)
        for name, (pattern, _) in WRITTEN.items():
            copy(project, (pattern,), source / "extra" / name, strip=2)
        left_out = write_reports(project, source)
        (source / "index.md").write_text("\n".join(index(source)), encoding="utf-8")
        (source / "docutils.conf").write_text(DOCUTILS, encoding="utf-8")
        warnings = io.StringIO()
        folders = (source, None, rendered, Path(folder) / "doctrees")
        nocolor()
        with patch_docutils(source), docutils_namespace():
            app = Sphinx(*folders, "html", confoverrides=SETTINGS, status=None, warning=warnings)
            app.connect("doctree-read", check_files, priority=0)
            app.build()
        (rendered / MARKER).touch()
        shutil.rmtree(output, ignore_errors=True)
        shutil.copytree(rendered, output)
    return [*left_out, *warnings.getvalue().splitlines()]


def own_files(project: Path, patterns: Sequence[str]) -> Iterator[Path]:
    """Yield the files of a project: no link that leaves it, and no pipe."""
    for pattern in patterns:
        for file in sorted(project.glob(pattern)):
            if file.is_file() and file.resolve().is_relative_to(project):
                yield file


def copy(project: Path, patterns: Sequence[str], target: Path, strip: int = 0) -> None:
    for file in own_files(project, patterns):
        copied = target.joinpath(*file.relative_to(project).parts[strip:])
        copied.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copied)


def check_files(app: Sphinx, doctree: nodes.document) -> None:
    """Refuse an image or a download that is not a file of the copy."""
    for node in doctree.findall(lambda n: isinstance(n, nodes.image | download_reference)):
        name = node["uri"] if isinstance(node, nodes.image) else node["reftarget"]
        if "://" in name or name.startswith("data:"):
            continue
        file = Path(app.env.relfn2path(name, app.env.docname)[1])
        if not file.resolve().is_relative_to(app.srcdir):
            raise SphinxError(f"{app.env.docname}: {name} is outside the project")


def write_reports(project: Path, source: Path) -> list[str]:
    """Write a report of each run file, and the page that lists them; return what was left out."""
    rows: list[Sequence[str]] = []
    left_out = []
    folder = source / "extra/reports"
    folder.mkdir(parents=True)
    for file in own_files(project, RUNS):
        try:
            (named,) = reports.read([file])
            page = report_page.render(reports.build([named]))
        except MjbenchError as error:
            left_out.append(f"left out: {file.relative_to(project)}: {error}")
            continue
        (folder / f"{file.stem}.html").write_text(page, encoding="utf-8")
        header, address = named.run.header, urllib.parse.quote(f"reports/{file.stem}.html")
        rows.append([header.began[:10], address, named.command, header.machine.cpu, file.name])
    lines = ["# Reports", "", "<table>"]
    for row in sorted(rows, reverse=True):
        began, address, command, cpu, name = map(html.escape, map(printable, row))
        link = f'<a href="{address}"><code>{command}</code></a>'
        lines.append(f"<tr><td>{began}</td><td>{link}</td><td>{cpu}</td><td>{name}</td></tr>")
    (source / "reports.md").write_text("\n".join([*lines, "</table>", ""]), encoding="utf-8")
    return left_out


def index(source: Path) -> Iterator[str]:
    """Yield the first page: what there is, and the navigation."""
    yield "# mjbench\n"
    yield "[What it is](README.md) · [guides](docs/guides/README.md) · [reports](reports.md)\n"
    for name, (_, page) in WRITTEN.items():
        if (source / "extra" / name / page).is_file():
            yield f'<a href="{name}/{page}">{name}</a>\n'
    listed: set[str] = {"index"}
    for caption, patterns in GROUPS.items():
        files = [file for each in patterns for file in sorted(source.glob(f"{each}.md"))]
        names = [str(file.relative_to(source).with_suffix("")) for file in files]
        names = [name for name in dict.fromkeys(names) if name not in listed]
        listed |= {*names}
        if names:
            yield from ("```{toctree}", ":hidden:", f":caption: {caption}", "", *names, "```")


if __name__ == "__main__":
    sys.exit(main())
