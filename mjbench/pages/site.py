"""A static site of a project's results and documents: pages in Markdown, which Sphinx renders.

The pages keep the places that they have in the project, so that links between documents hold. A
link to a file that is not on the site becomes plain text.

Whoever writes the documents is trusted: they may have any markup of MyST. Run files are not: their
texts are no markup (see `markdown`), and pages that have any of them have no roles. What is
read or copied is the project's own: no symbolic link that leaves it is followed.
"""

import contextlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import urllib.parse
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mjbench import extras
from mjbench.errors import InputError, MachineError, one_line, writing
from mjbench.host.neighbours import Disturbance
from mjbench.pages import html, markdown, reports
from mjbench.pages.markdown import escaped
from mjbench.pages.reports import NamedRun
from mjbench.report import comparison, history, history_files, history_plots
from mjbench.report.content import Tone
from mjbench.report.path_speedups import derive_all
from mjbench.report.speed_history import SpeedHistory
from mjbench.status import Status

# A file that says that a folder is a site, and may be replaced by a new one.
MARKER = ".mjbench-site"
# What renders it.
PACKAGES = ("sphinx", "myst_parser", "furo")
# Files beside the documents that are on the site, too.
_BESIDE = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "LICENSE")
_FOLDERS_BESIDE = ("models", "results")
# Copied as they are, and not rendered.
_COPIED, _STYLED = "copied", "style"
_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)\s#]+)(#[^)\s]*)?\)")
# At the head of pages that have texts of run files.
_NO_ROLES = """\
---
myst:
  disable_syntax: [myst_role, myst_target, myst_line_comment, myst_block_break, html_block]
---
"""
_CONF = """\
project = "MuJoCo performance"
html_title = "MuJoCo performance"
extensions = ["myst_parser"]
html_theme = "furo"
html_extra_path = ["{copied}"]
html_static_path = ["{style}"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_copyright = False
smartquotes = False
exclude_patterns = ["{copied}", "{style}"]
myst_heading_anchors = 4
"""
# Numbers do not wrap.
_STYLE = "td.text-right, th.text-right { white-space: nowrap; }"
# What the theme leaves out for people who do not see it, by how its elements begin: a heading's
# level, the names of landmarks, and that what scrolls can be reached by the keyboard.
_MISSING_ATTRIBUTES = (
    ('p class="caption" role="heading"', 'aria-level="2"'),
    ('aside class="sidebar-drawer"', 'aria-label="Pages"'),
    ('aside class="toc-drawer', 'aria-label="On this page"'),
    ('div class="table-wrapper', 'tabindex="0"'),
)
# Groups of documents in the navigation, by the folder that they are in.
_GROUPS = (
    ("Guides", "docs/guides"),
    ("How a number comes about", "docs/method"),
    ("Reference", "docs"),
)


@dataclass(frozen=True)
class Project:
    """What a site is of.

    Attributes:
      runs: the newest last.
      asv_pages: folder that `asv publish` wrote.
      lab: page that `make lab` wrote.
    """

    folder: Path
    runs: Sequence[NamedRun]
    history: SpeedHistory | None = None
    asv_pages: Path | None = None
    lab: Path | None = None


def read(folder: Path, report: Callable[[str], None]) -> Project:
    """Return what a folder has for a site; `report` is called with what is left out, in a line."""

    def own(files: Iterable[Path]) -> list[Path]:
        chosen = []
        for file in files:
            if _is_foreign(file, folder):
                report(_left_out(file, folder))
            elif file.exists():
                chosen.append(file)
        return chosen

    named_runs: list[NamedRun] = []
    for file in own((folder / "results/runs").glob("*.jsonl")):
        with _reporting_unreadable(report):
            named_runs += reports.read([file])
    named_runs.sort(key=lambda named: (named.run.header.began, named.file.name))
    measured = None
    causes = next(iter(own([folder / "benchmarks/causes.toml"])), None)
    if files := own(history_files.run_files(folder / "results/history")):
        with _reporting_unreadable(report):
            measured, *others = history_files.read_each(files, causes)
            if others:
                names = ", ".join(each.name for each in others)
                report(f"the history is that of {measured.name}; left out: {names}")
    asv_pages = own([folder / ".asv/html/index.html"])
    if not (named_runs or measured or (folder / "docs").is_dir()):
        raise InputError(
            f"{folder} has neither results nor docs: measure something first, or give --project"
        )
    lab = own([folder / "build/lab/mujoco-lab.html"])
    return Project(
        folder,
        named_runs,
        measured,
        asv_pages[0].parent if asv_pages else None,
        lab[0] if lab else None,
    )


@contextlib.contextmanager
def _reporting_unreadable(report: Callable[[str], None]) -> Iterator[None]:
    try:
        yield
    except InputError as error:
        report(f"left out: {error}")


def check_output(output: Path, folder: Path) -> None:
    """Refuse to replace what is no site, or the folder of the project."""
    if output.exists() and any(output.iterdir() if output.is_dir() else [output]):
        if not (output / MARKER).is_file():
            raise InputError(f"{output} exists and is no site of mjbench: choose another folder")
        if output.resolve() in (Path.cwd(), folder.resolve()):
            raise InputError(f"{output} is the folder of the project: choose another folder")


def build(project: Project, scratch: Path, output: Path) -> list[str]:
    """Write a site; return what was left out, and Sphinx's warnings about its pages.

    Args:
      scratch: an empty folder for what Sphinx reads.
      output: folder of the site; a site that is there is replaced.

    Raises:
      MachineError: a package is missing, Sphinx fails, or the folder cannot be written.
    """
    missing = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        install = extras.install_command("site")
        raise MachineError(f"a site needs Sphinx, MyST and Furo: {install}")
    source, rendered = scratch / "source", scratch / "site"
    lines = write_source(project, source)
    warnings = _render(source, rendered)
    for page in rendered.rglob("*.html"):
        if not page.is_relative_to(rendered / "reports"):
            page.write_text(_accessible(page.read_text(encoding="utf-8")), encoding="utf-8")
    with writing(output):
        (rendered / MARKER).touch()
        output = output.resolve()
        complete = output.with_name(f".{output.name}.new")
        shutil.rmtree(complete, ignore_errors=True)
        shutil.copytree(rendered, complete)
        if output.exists():
            shutil.rmtree(output)
        complete.rename(output)
    return [*lines, *warnings]


def _render(source: Path, rendered: Path) -> list[str]:
    """Have Sphinx render the pages of a folder; return its warnings."""
    command = [sys.executable, "-m", "sphinx", "-q", "--no-color", "-b", "html"]
    done = subprocess.run(
        [*command, str(source), str(rendered)], capture_output=True, text=True, check=False
    )
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    if done.returncode:
        named = [line for line in lines if re.match(r"[\w.]+(Error|Exception)\b", line)]
        raise MachineError(f"Sphinx failed: {one_line((named or lines or ['no message'])[-1])}")
    return [line.removeprefix(f"{source}/") for line in lines]


def _accessible(page: str) -> str:
    page = page.replace("<pre>", '<pre tabindex="0">')
    for element, attribute in _MISSING_ATTRIBUTES:
        tag, beginning = element.split(" ", 1)
        page = page.replace(f"<{element}", f"<{tag} {attribute} {beginning}")
    return page


def write_source(project: Project, source: Path) -> list[str]:
    """Write the pages that Sphinx renders, and its configuration; return what was left out."""
    copied = source / _COPIED
    _write_page(source / "conf.py", [_CONF.format(copied=_COPIED, style=_STYLED)])
    _write_page(source / _STYLED / "site.css", [_STYLE])
    with writing(copied):
        copied.mkdir()
    with _copying(project.folder):
        lines = _copy_documents(project.folder, source)
    documents = set(source.rglob("*.md"))
    if project.history is not None:
        _write_history(project.history, source)
        documents.discard(source / "docs/history.md")
    shown: list[NamedRun] = []
    for file, named_runs in _by_file(project.runs).items():
        try:
            page = html.render(reports.build(named_runs))
        except InputError as error:  # such as a history without times of steps
            lines.append(f"left out: {file}: {error}")
            continue
        shown += named_runs
        _write_page(copied / "reports" / f"{file.stem}.html", [page])
    project = replace(project, runs=shown)
    if project.asv_pages is not None:
        with _copying(project.asv_pages):
            lines += _copy_tree(project.folder, project.asv_pages, copied / "asv")
    if project.lab is not None:
        with _copying(project.lab):
            (copied / "lab").mkdir()
            shutil.copy(project.lab, copied / "lab/index.html")
    _drop_dead_links(documents, source)
    if project.runs:
        _write_page(source / "reports.md", [_NO_ROLES, *_reports_page(project.runs)])
    _write_page(source / "index.md", [_NO_ROLES, *_index(project, source)])
    return lines


@contextlib.contextmanager
def _copying(folder: Path) -> Iterator[None]:
    """Turn the refusal to copy a folder's files into a MachineError."""
    try:
        yield
    except shutil.Error as error:  # of several files; each has its name, that of its copy, and why
        _, _, reason = error.args[0][0]
        raise MachineError(f"cannot copy {folder}: {one_line(reason)}") from error
    except OSError as error:
        raise MachineError(f"cannot copy {folder}: {one_line(error)}") from error


def _copy_documents(folder: Path, source: Path) -> list[str]:
    """Copy a project's documents, and return what was left out; without `docs` there are none."""
    if not (folder / "docs").is_dir():
        return []
    lines = _copy_tree(folder, folder / "docs", source / "docs")
    for name in (*_BESIDE, *(f"{name}/README.md" for name in _FOLDERS_BESIDE)):
        file = folder / name
        if _is_foreign(file, folder):
            lines.append(_left_out(file, folder))
        elif file.is_file():
            (source / name).parent.mkdir(exist_ok=True)
            shutil.copy(file, source / name)
    return lines


def _copy_tree(project: Path, folder: Path, target: Path) -> list[str]:
    """Copy a folder of a project without links to folders; return which were left out."""
    lines: list[str] = []

    def foreign(parent: str, names: list[str]) -> list[str]:
        files = [Path(parent) / name for name in names]
        chosen = [f for f in files if _is_foreign(f, project) or (f.is_symlink() and f.is_dir())]
        lines.extend(_left_out(file, project) for file in chosen)
        return [file.name for file in chosen]

    if _is_foreign(folder, project):
        target.mkdir(parents=True)
        return [_left_out(folder, project)]
    shutil.copytree(folder, target, ignore=foreign)
    return lines


def _is_foreign(file: Path, project: Path) -> bool:
    """Return whether a file is outside a project, which a link may lead to, or a pipe or device."""
    own = Path(os.path.realpath(file))
    if not own.is_relative_to(os.path.realpath(project)):
        return True
    return own.exists() and not (own.is_file() or own.is_dir())


def _left_out(file: Path, project: Path) -> str:
    """Return the line that says that a file is not on the site."""
    why = (
        "links out of the project or to folders are not followed"
        if file.is_symlink()
        else "no file"
    )
    return f"left out: {file.relative_to(project)}: {why}"


def _write_history(measured: SpeedHistory, source: Path) -> None:
    docs = source / "docs"
    history_plots.draw(measured, docs / "history")
    page = markdown.document(history.sections(measured), "history")
    _write_page(docs / "history.md", [_NO_ROLES, *page])
    releases = measured.releases()[1:]
    for release in releases:
        page = markdown.document(history.release_sections(measured, release))
        _write_page(source / "releases" / f"{release}.md", [_NO_ROLES, *page])
    if releases:
        _write_page(source / "releases.md", [_NO_ROLES, *_releases_page(measured, releases)])


def _releases_page(measured: SpeedHistory, releases: Sequence[str]) -> Iterator[str]:
    yield "# Releases\n"
    yield "What each release of MuJoCo changed, beside the release before it.\n"
    rows = [
        (
            f"[{release}](releases/{release}.md)",
            escaped(history.release_conclusion(measured, release)),
        )
        for release in reversed(releases)
    ]
    yield from markdown.table_lines(["release", "time of a step"], rows)
    yield from _toctree("", [f"releases/{release}" for release in reversed(releases)])


def _reports_page(runs: Sequence[NamedRun]) -> Iterator[str]:
    yield "# Reports\n"
    yield "One report for each run file or set: charts, tables, and the command that gave them.\n"
    rows = [
        (
            _report_link(named, _name([named, *others])),
            escaped(named.run.header.began[:10]),
            markdown.code(named.file.name),
            escaped(", ".join(dict.fromkeys(n.run.header.machine.cpu for n in (named, *others)))),
            ", ".join(dict.fromkeys(filter(None, map(_remark, (named, *others))))),
        )
        for named, *others in reversed(_by_file(runs).values())
    ]
    headings = ["report", "began", "run file", "processor", "remarks"]
    count = len(headings) if any(row[-1] for row in rows) else len(headings) - 1
    # dates do not wrap, as numbers do not
    yield from markdown.table_lines(headings[:count], (row[:count] for row in rows), ["began"])


def _count_models(named: NamedRun) -> int:
    return len({model for r in named.run.records if (model := getattr(r, "model", ""))})


def _name(named_runs: Sequence[NamedRun]) -> str:
    several = f" ({len(named_runs)} runs)" if len(named_runs) > 1 else ""
    return f"{reports.title(named_runs)}{several}"


def _remark(named: NamedRun) -> str:
    """Return what speaks against the numbers of a run; empty for nothing."""
    records, disturbances = named.run.records, named.run.of_type(Disturbance)
    measured = [record for record in records if not isinstance(record, Disturbance)]
    if Status.OK not in {getattr(record, "status", Status.OK) for record in measured}:
        return "failed"
    results = [result for model in derive_all(records) for result in model.results]
    is_disturbed = disturbances or any(result.disturbances for result in results)
    return "disturbed" if is_disturbed else ""


def _by_file(runs: Sequence[NamedRun]) -> dict[Path, list[NamedRun]]:
    by_file: dict[Path, list[NamedRun]] = {}
    for named in runs:
        by_file.setdefault(named.file, []).append(named)
    return by_file


def _report_link(named: NamedRun, text: str) -> str:
    # a link in HTML: what it names is no page of Sphinx's
    address = urllib.parse.quote(os.fsencode(f"reports/{named.file.stem}.html"))
    return f'<a href="{address}">{markdown.code(text)}</a>'


def _index(project: Project, source: Path) -> Iterator[str]:
    """Yield the first page; runs that failed or were disturbed are not on it."""
    by_file = _by_file(project.runs)
    yield "# How fast is MuJoCo from Python?\n"
    if project.history is not None:
        yield "## From release to release\n"
        yield from map(escaped, history.conclusions(project.history))
        *earlier, newest = project.history.releases()
        links = ["[All changes](docs/history.md)"]
        if earlier:
            change = escaped(history.release_conclusion(project.history, newest))
            yield f"\nThe newest release, {newest}: {change}"
            links.append("[release by release](releases.md)")
        yield f"\n{' · '.join(links)}\n"
    good = [runs[-1] for runs in by_file.values() if not any(map(_remark, runs))]
    for title, command in (("Ways of stepping", "compare"), ("Two releases", "versions")):
        of_command = [named for named in good if named.run.header.command == command]
        if of_command:
            named = max(reversed(of_command), key=_count_models)  # the newest of equal ones
            yield f"## {title}, {escaped(named.run.header.began[:10])}\n"
            yield from _summary(by_file[named.file])
            yield f"\n{_report_link(named, _name([named]))}\n"
    if project.asv_pages is not None:
        yield '<a href="asv/index.html">The pages of asv</a>: every benchmark over all releases\n'
    if project.lab is not None:
        yield '<a href="lab/index.html">The lab</a>: MuJoCo in your browser\n'
    yield from _licence(source / "LICENSE")
    results = {"releases": "releases.md", "docs/history": "docs/history.md"}
    listed = [name for name, file in results.items() if (source / file).exists()]
    listed += ["reports"] if project.runs else []
    yield from _toctree("Results", listed)
    pages = sorted(path.relative_to(source) for path in source.rglob("*.md"))
    pages = [page for page in pages if page.parts[0] not in (_COPIED, "releases")]
    remaining = [str(page.with_suffix("")) for page in pages]
    remaining = [name for name in remaining if name not in listed]
    for caption, folder in _GROUPS:
        group = [name for name in remaining if str(Path(name).parent) == folder]
        yield from _toctree(caption, _in_order(group, source / folder / "README.md"))
        remaining = [name for name in remaining if name not in group]
    yield from _toctree("Project", remaining)


def _licence(file: Path) -> Iterator[str]:
    if file.is_file():
        lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
        name = next((line.strip() for line in lines if line.strip()), "")
        yield f"\n[{escaped(name) or 'Licence'}]({file.name})\n"


def _in_order(names: Sequence[str], readme: Path) -> list[str]:
    """Return a folder's pages: the README first, then those that it links, in its order."""
    linked = [match[2] for match in _LINK.finditer(readme.read_text())] if readme.is_file() else []
    order = {file: i for i, file in reversed([*enumerate(["README.md", *linked])])}
    return sorted(names, key=lambda name: order.get(f"{Path(name).name}.md", len(order)))


def _summary(runs: Sequence[NamedRun]) -> Iterator[str]:
    advice = comparison.advice_table([r for each in runs for r in derive_all(each.run.records)])
    conclusions = reports.build(runs).conclusions
    is_bad = any(conclusion.tone == Tone.BAD for conclusion in conclusions)
    has_table = len(runs) == 1 and advice.rows and not is_bad
    for conclusion in reports.first_of(conclusions) if has_table else conclusions:
        yield f"- {escaped(conclusion.text)}"
    if has_table:
        yield ""
        yield from markdown.data_table(advice)


def _toctree(caption: str, names: Sequence[str]) -> Iterator[str]:
    if not names:
        return
    yield "\n```{toctree}"
    yield ":hidden:"
    if caption:
        yield f":caption: {caption}"
    yield ""
    yield from names
    yield "```"


def _write_page(file: Path, lines: Sequence[str]) -> None:
    text = "\n".join(lines) + "\n"
    with writing(file):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")


def _drop_dead_links(pages: Collection[Path], source: Path) -> None:
    """Turn links of documents to files that are not on the site into their text."""
    root = source.resolve()
    for page in pages:

        def live(match: re.Match[str], folder: Path = page.parent) -> str:
            target = match[2]
            if re.match(r"[a-z]+:", target):
                return match[0]
            file = (folder / target).resolve()
            return match[0] if file.is_relative_to(root) and file.is_file() else match[1]

        with writing(page):
            page.write_text(_LINK.sub(live, page.read_text(encoding="utf-8")), encoding="utf-8")
