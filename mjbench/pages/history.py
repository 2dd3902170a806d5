"""The page of `mjbench history`, in Markdown: in which releases speed changed, and why."""

import os
from collections.abc import Sequence
from pathlib import Path

from mjbench.pages import markdown
from mjbench.report import history, history_across, history_files, history_plots


def page(
    files: Sequence[Path],
    causes: Path | None,
    since: str | None,
    machine: str | None,
    plots: Path | None,
    folder: Path,
) -> str:
    """Return the page of what run files and run sets hold; see `history_files.read_each`.

    Args:
      machine: name of the one to report; None for the only one, or for all side by side.
      plots: folder to draw in; None for a page without plots.
      folder: of the page.

    Raises:
      MachineError: plots cannot be drawn or written.
    """
    each = history_files.read_each(files, causes, since)
    if len(each) > 1 and machine is None and plots is None:
        lines = markdown.document([history_across.section(each)])
    else:
        measured = history_files.choose(each, machine)
        link = ""
        if plots is not None:
            history_plots.draw(measured, plots)
            link = Path(os.path.relpath(plots, folder)).as_posix()
        sections = history.sections(measured, has_plots=plots is not None)
        lines = markdown.document(sections, link)
    return "\n".join(lines) + "\n"
