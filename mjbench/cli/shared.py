"""How the options of a command become those of its command line."""

import functools
import inspect
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from mjbench.cli.command_help import Command
from mjbench.errors import one_line
from mjbench.options import Kind, Option, TextError, options_of
from mjbench.simulation import models


class Text(click.ParamType[Any]):
    """A text that stands for a value of a kind."""

    def __init__(self, kind: Kind):
        self.name, self.syntax, self._kind = kind.metavar, kind.syntax, kind

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return the value; a default may be one already."""
        if not isinstance(value, str):
            return value
        try:
            return self._kind.parse(value)
        except ValueError as error:
            more = f": {error}" if isinstance(error, TextError) and str(error) else ""
            expected = self._kind.expected
            self.fail(f"{one_line(repr(value), 60)} is not {expected}{more}", param, ctx)


class FileName(click.Path):
    """The name of a file, which is not empty."""

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> Any:
        if not os.fspath(value):
            self.fail("the name is empty", param, ctx)
        return super().convert(value, param, ctx)


FILE = FileName(path_type=Path)


class ProgramCommand(Command):
    """A command that takes a program, and leaves all words after it to the program."""

    def is_program(self, word: str) -> bool:
        """Return whether the first word that is no option, or `-m`, begins a program."""
        return True

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        flags = {
            name
            for option in self.get_params(ctx)
            if isinstance(option, click.Option) and option.is_flag
            for name in option.opts
        }
        i = 0
        while i < len(args) and args[i].startswith("-") and args[i] not in ("-m", "--"):
            i += 1 if args[i] in flags or "=" in args[i] else 2
        if i < len(args) and args[i] != "--" and self.is_program(args[i]):
            args = [*args[:i], "--", *args[i:]]
        return super().parse_args(ctx, args)


def as_one(
    argument: str, build: Callable[..., Any], *options: Any
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds options to a command, which gets them as one argument.

    Args:
      build: returns the argument; its parameters are named as the options.
      options: among them may be others that are one argument.
    """
    names = inspect.signature(build).parameters

    def add(command: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(command)
        def with_one(*arguments: Any, **values: Any) -> None:
            own = {name: values.pop(name) for name in names if name in values}
            command(*arguments, **{argument: build(**own)}, **values)

        return functools.reduce(lambda inner, option: option(inner), reversed(options), with_one)

    return add


def takes(kind: type[Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds options to a command, which gets them as `options`.

    Args:
      kind: a dataclass of options (see `mjbench.options`).
    """
    return as_one("options", kind, *map(_click_option, options_of(kind)))


def _click_option(option: Option) -> Callable[..., Any]:
    kind, default = option.kind, option.default
    unset = f"  [default: {option.unset}]" if option.unset else ""
    sentence = option.text.removesuffix(".") + "."
    settings: dict[str, Any] = {}
    if kind.is_flag:
        settings = {"is_flag": True, "default": default, "show_default": default}
    elif kind.is_repeated:
        settings = {"multiple": True}
    elif default is not None:
        settings = {"default": kind.written(default), "show_default": True}
    if not kind.is_flag:
        settings |= {"type": _click_type(kind), "metavar": kind.metavar or None}
    return click.option(*option.flags, option.name, help=f"{sentence}{unset}", **settings)


def _click_type(kind: Kind) -> click.ParamType[Any] | None:
    if kind.choices:
        return click.Choice(kind.choices)
    if kind.is_file:
        return FILE
    return Text(kind) if kind.expected else None


def models_argument(command: Callable[..., None]) -> Callable[..., None]:
    """Add the argument MODEL to a command, which gets `sources`."""
    argument = click.argument("names", nargs=-1, metavar="MODEL…")
    return as_one("sources", models.resolve_all, argument)(command)


def mode(flag: str, text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that names a mode in a command's help (see `command_names`)."""
    help_text = f"{text} `{flag} --help` lists its options."
    return click.option(flag, is_flag=True, expose_value=False, help=help_text)
