"""Options that two commands share: declared once, given on the command line or in a file."""

from __future__ import annotations

from typing import Annotated, Any

import pytest
import typer
from typer.testing import CliRunner

from fit_material.fitter.command_line.choices import TypeName
from fit_material.fitter.command_line.signature import options_said, with_parameters_of
from fit_material.fitter.commands.fit import chosen
from fit_material.renderer.errors.input_error import InputError


def shared(size: Annotated[int, typer.Option(help="Of it.")] = 3, name: Annotated[str, typer.Option()] = "") -> object:
    return size, name


@pytest.fixture
def app():
    seen: list[dict[str, Any]] = []
    app = typer.Typer()

    @app.command()
    @with_parameters_of(shared, panel="Of another one")
    def command(path: str, loud: bool = False, **options: Any) -> None:
        seen.append({"path": path, "loud": loud, **options})

    return app, seen


def test_a_command_gets_its_own_parameters_and_the_others(app):
    app, seen = app
    assert CliRunner().invoke(app, ["here", "--size", "7", "--loud"]).exit_code == 0
    assert seen == [{"path": "here", "loud": True, "size": 7, "name": ""}]


def test_help_has_them_under_their_heading(app):
    told = CliRunner().invoke(app[0], ["--help"], env={"COLUMNS": "100"}).output
    assert told.index("--loud") < told.index("Of another one") < told.index("--size")


def test_only_what_is_said_counts():
    assert options_said(["--type", "metal", "--with", "blur", "--with", "horizon"], chosen) == {
        "type_": TypeName.metal,
        "with_": ["blur", "horizon"],
    }
    assert options_said([], chosen) == {}
    assert options_said(["--seed", "0"], chosen) == {"seed": 0}  # its default, and said all the same


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--type", "metl"], "'metl' is not one of 'auto', 'metal', 'glossy', 'matte'"),
        (["--seed", "-1"], "greater than or equal to 0"),
        (["more.toml"], "more.toml"),
        (["--out", "x"], "--out"),
        (["--polish", "--seed"], "--seed"),
    ],
)
def test_what_fit_does_not_take_is_refused(words, sentence):
    with pytest.raises(InputError, match=r"^: expected ") as error:
        options_said(words, chosen)
    assert sentence in str(error.value)
