"""Write the stub of `import mjbench`, in which editors and mypy read the keywords of functions.

    python -m benchmarks.studies.function_stub

Keywords are the options of commands, which exist only when the functions are imported. Do it again
when an option changed; a test compares.
"""

import inspect
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import mjbench

FILE = Path(mjbench.__file__).with_suffix(".pyi")
_HEAD = '''\
"""Written by benchmarks.studies.function_stub: what `import mjbench` offers."""

import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from mjbench.api.model_sources import Model
from mjbench.api.start_states import Actions, States
'''


def main() -> None:
    """Write the file."""
    FILE.write_text(text(), encoding="utf-8")


def text() -> str:
    """Return the stub: a signature for what has options as keywords, an import for all else."""
    imports, others = [], ["__version__: str\n__all__: list[str]"]
    for name in mjbench.__all__:
        offered = getattr(mjbench, name)
        module, own = offered.__module__, offered.__name__
        if "__signature__" in vars(offered):
            result = inspect.signature(offered).return_annotation.__name__
            imports.append(f"from {module} import {result}")
            others.append("\n".join(_function(offered)))
        else:
            imports.append(f"from {module} import {own} as {own}")
            others += [f"{name} = {own}"] if name != own else []
    return "\n\n".join([_HEAD + "\n".join(imports), *others]) + "\n"


def _function(function: Callable[..., Any]) -> Iterator[str]:
    signature = inspect.signature(function)
    yield f"def {function.__name__}("
    has_marker = False
    for parameter in signature.parameters.values():
        if parameter.kind == parameter.KEYWORD_ONLY and not has_marker:
            yield "    *,"
        has_marker |= parameter.kind in (parameter.KEYWORD_ONLY, parameter.VAR_POSITIONAL)
        yield f"    {_parameter(parameter)},"
    yield f") -> {signature.return_annotation.__name__}:"
    yield textwrap.indent(f'"""{inspect.getdoc(function)}\n"""', "    ")


def _parameter(parameter: inspect.Parameter) -> str:
    star = "*" if parameter.kind == parameter.VAR_POSITIONAL else ""
    annotation = parameter.annotation
    if not isinstance(annotation, str):
        annotation = inspect.formatannotation(annotation).replace("collections.abc.", "")
    is_needed = parameter.default is parameter.empty
    default = "" if is_needed else f" = {parameter.default!r}".replace("'", '"')
    return f"{star}{parameter.name}: {annotation}{default}"


if __name__ == "__main__":
    main()
