"""Parameters that one command takes from another function, declared once; and the same as words in a file."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from copy import copy
from functools import wraps
from inspect import Parameter
from typing import Annotated, Any, get_args

import typer
from typer.core import TyperCommand
from typer.exceptions import TyperException
from typer.models import OptionInfo

from fit_material.renderer.errors.input_error import InputError

Command = Callable[..., None]


def with_parameters_of(other: Callable[..., object], panel: str | None = None) -> Callable[[Command], Command]:
    """A decorator: the command has the parameters of `other`, too, and gets them in its `**options`.

    They stand behind the command's parameters that must be given, before those that may be left out.

    Args:
        panel: a heading for them in `--help`.
    """

    def decorate(command: Command) -> Command:
        own = [each for each in _parameters(command) if each.kind is not Parameter.VAR_KEYWORD]
        given = [each for each in own if each.default is Parameter.empty]
        taken = [each if panel is None else _under(panel, each) for each in _parameters(other)]
        every = [*given, *taken, *(each for each in own if each not in given)]

        @wraps(command)
        def joined(**values: Any) -> None:
            command(**values)

        joined.__signature__ = inspect.Signature(every)  # type: ignore[attr-defined] — what typer looks at
        joined.__annotations__ = {each.name: each.annotation for each in every}
        return joined

    return decorate


def _parameters(function: Callable[..., object]) -> list[Parameter]:
    return list(inspect.signature(function, eval_str=True).parameters.values())


def _under(panel: str, parameter: Parameter) -> Parameter:
    """The option, below that heading."""
    kind, option, *others = get_args(parameter.annotation)
    assert isinstance(option, OptionInfo)
    option = copy(option)
    option.rich_help_panel = panel
    return parameter.replace(annotation=Annotated[kind, option, *others])


def options_said(words: Sequence[str], function: Callable[..., object]) -> dict[str, Any]:
    """Those of a function's parameters that command-line words give, as typer reads them.

    Raises:
        InputError: typer refuses them; the file is "", for the caller to fill in.
    """
    said: dict[str, Any] = {}
    app = typer.Typer(add_completion=False)

    @app.command(add_help_option=False)
    @with_parameters_of(function)
    def note(**options: Any) -> None:
        said.update(options)

    command = typer.main.get_command(app)
    assert isinstance(command, TyperCommand)
    try:
        with command.make_context("", list(words)) as context:
            command.invoke(context)
    except TyperException as error:
        message = " ".join(error.format_message().split()).rstrip(".")  # type: ignore[attr-defined] — of click's part
        raise InputError("", expected=f"{message[:1].lower()}{message[1:]}") from None
    return {name: said[name] for name in said if _is_said(context, name)}


def _is_said(context: Any, name: str) -> bool:
    return context.get_parameter_source(name).name == "COMMANDLINE"
