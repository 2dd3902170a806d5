"""The page of `mjbench history`, in Markdown: in which releases speed changed, and why."""

import os
from collections.abc import Sequence
from pathlib import Path

from mjbench.pages import markdown
from mjbench.report import history, history_files, history_plots


def page(
    files: Sequence[Path],
    causes: Path | None,
    since: str | None,
    machine: str | None,
    plots: Path | None,
    folder: Path,
) -> str:
    """Return the page of what run files hold; see `history_files.read_each`.

    Args:
      machine: name of the one to report; None for the only one.
      plots: folder to draw in; None for a page without plots.
      folder: of the page.

    Raises:
      MachineError: plots cannot be drawn or written.
    """
    measured = history_files.choose(history_files.read_each(files, causes, since), machine)
    link = ""
    if plots is not None:
        history_plots.draw(measured, plots)
        link = Path(os.path.relpath(plots, folder)).as_posix()
    sections = history.sections(measured, has_plots=plots is not None)
    return "\n".join(markdown.document(sections, link)) + "\n"
