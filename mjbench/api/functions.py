"""The keywords of the functions of `import mjbench`: the options of their commands."""

import functools
import inspect
import itertools
import textwrap
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from mjbench.api import start_states
from mjbench.options import Option, options_of

_Result = TypeVar("_Result")
# Characters of a line of `Args:`.
_WIDTH = 100


def with_options(kind: type[Any]) -> Callable[[Callable[..., _Result]], Callable[..., _Result]]:
    """Return a decorator for a function that takes `options` of this kind.

    The result has a keyword for each option instead, whose text is among its `Args:`. Arrays of
    start states and controls lie in files while the function runs.

    Raises:
      InputError: by the function, for a value that an option cannot have.
    """
    options = [each for each in options_of(kind) if each.of_functions]

    def decorate(function: Callable[..., _Result]) -> Callable[..., _Result]:
        signature = _signature(inspect.signature(function), options)

        @functools.wraps(function)
        def with_keywords(*arguments: Any, **keywords: Any) -> _Result:
            try:
                signature.bind(*arguments, **keywords)
            except TypeError as error:
                raise TypeError(f"{function.__name__}(): {error}") from None
            values = {
                each.name: each.checked(keywords.pop(each.name))
                for each in options
                if each.name in keywords
            }
            with start_states.in_files(values) as files:
                return function(*arguments, options=kind(**values | files), **keywords)

        vars(with_keywords)["__signature__"] = signature
        with_keywords.__doc__ = _documented(function.__doc__ or "", options)
        return with_keywords

    return decorate


def _signature(signature: inspect.Signature, options: list[Option]) -> inspect.Signature:
    """Return a signature with a keyword for each option in place of `options`."""
    keywords = [
        inspect.Parameter(
            each.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=each.default,
            annotation=each.annotation,
        )
        for each in options
    ]
    parameters = list(signature.parameters.values())
    place = list(signature.parameters).index("options")
    parameters[place : place + 1] = keywords
    return signature.replace(parameters=parameters)


def _documented(doc: str, options: list[Option]) -> str:
    """Return a docstring whose `Args:` have the options last; `Raises:` follows them."""
    before, raises, after = doc.partition("\n    Raises:")
    lines = itertools.chain.from_iterable(map(_lines, options))
    return "\n".join([before.rstrip(), *lines, raises + after])


def _lines(option: Option) -> Iterator[str]:
    unset = f"Default: {option.unset}." if option.unset else ""
    text = " ".join(filter(None, [option.text.removesuffix(".") + ".", option.kind.note, unset]))
    first, other = f"      {option.name}: ", 8 * " "
    yield from textwrap.wrap(
        text, _WIDTH, initial_indent=first, subsequent_indent=other, break_on_hyphens=False
    )
