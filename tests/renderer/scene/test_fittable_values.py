"""What a scene file may leave to the fit, and how it says so."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from fit_material.fitter.least_squares.nuisances import unknowns_of
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.image_file import write_exr
from fit_material.renderer.scene.scene_file import Scene, read_scene


@pytest.fixture
def scene(tmp_path):
    """Reads a scene of two photographs, with lines added at the top, to the environment, and to each photograph."""
    for name in ("map", "a", "b"):
        write_exr(tmp_path / f"{name}.exr", np.ones((2, 4, 3), np.float32))

    def read(top: str = "", environment: str = "", first: str = "", second: str = "", end: str = "") -> Scene:
        path = Path(tmp_path / "scene.toml")
        camera = "[photographs.camera]\norigin = [0, 0, 4]\ntarget = [0, 0, 0]\n"
        head = f'{top}\n[geometry]\nshape = "sphere"\n[environment]\nmap = "map.exr"\n{environment}\n'
        photographs = [
            f'[[photographs]]\nimage = "{name}.exr"\n{own}\n{camera}' for name, own in (("a", first), ("b", second))
        ]
        path.write_text(head + "".join(photographs) + end)
        return read_scene(path)

    return read


def told(found: Scene) -> list[tuple]:
    return [(each.key, each.photograph, each.channel) for each in unknowns_of(found)]


def test_nothing_is_unknown_unless_asked_for(scene):
    assert unknowns_of(scene(first="exposure = 2.0\nwhite_balance = [2, 1, 1.5]")) == ()


def test_what_is_asked_for_becomes_free_numbers(scene):
    fit = '"fit"'
    assert told(scene(f"exposure = {fit}")) == [("exposure", None, None)]
    assert told(scene(f"white_balance = {fit}")) == [("white_balance", None, 0), ("white_balance", None, 2)]
    assert told(scene(second=f"exposure = {fit}")) == [("exposure", 1, None)]
    assert told(scene(first=f"white_balance = {fit}")) == [("white_balance", 0, 0), ("white_balance", 0, 2)]
    found = scene(environment=f'scale = {fit}\nrotation = "fit:-90.5"')
    assert told(found) == [("scale", None, None), ("rotation", None, None)]
    assert found.environment.start == (-90.5, 1.0)
    assert unknowns_of(found)[-1].start == -90.5
    assert scene(environment='rotation = "fit"').environment.start == (0.0, 1.0)


@pytest.mark.parametrize(
    ("added", "sentence"),
    [
        (
            {"top": "exposure = 2.0"},
            'exposure: is 2.0, expected "fit", or nothing: each of the photographs has its',
        ),
        (
            {"environment": 'rotation = "fit:north"'},
            'environment.rotation: is "fit:north", expected a number of deg',
        ),
        ({"environment": "scale = true"}, "environment.scale: is True, expected a number from 1e-12"),
        ({"first": "white_balance = [2, 1]"}, 'photographs[0].white_balance: is [2, 1], expected "fit", or factors of'),
        ({"first": "white_balance = [2, 1, 0]"}, "photographs[0].white_balance: is [2, 1, 0], expected"),
        (
            {"top": 'exposure = "fit"', "first": 'exposure = "fit"', "second": 'exposure = "fit"'},
            'exposure: is "fit", expected it here or in each of the photographs, not both',
        ),
        (
            {"top": 'exposure = "fit"', "environment": 'scale = "fit"'},
            'environment.scale: is "fit", expected a number: exposures are fitted, and twice the one is half the other',
        ),
        (
            {
                "environment": 'scale = "fit"',
                "end": '[[lights]]\ntype = "directional"\ndirection = [0, 1, 0]\nirradiance = [1, 1, 1]\n',
            },
            'environment.scale: is "fit", expected a number, and exposure = "fit" at the top: the [[lights]] would',
        ),
    ],
)
def test_what_says_nothing_or_the_same_twice_is_refused(scene, added, sentence):
    with pytest.raises(InputError) as told:
        scene(**added)
    assert sentence in str(told.value)


def test_scenes_are_written_as_they_were_read(scene):
    """Without a word of warning, which tests take for an error: that is how photographs that repeat are found."""
    found = scene(first="white_balance = [2, 1, 1.5]", second='exposure = "fit"')
    assert [json.loads(each.model_dump_json(include={"white_balance"})) for each in found.photographs] == [
        {"white_balance": [2, 1, 1.5]},
        {"white_balance": [1, 1, 1]},
    ]
    listed = found.photographs[0].model_copy(update={"exposure": (1.0, 2.0)})
    assert json.loads(listed.model_dump_json(include={"exposure"})) == {"exposure": [1.0, 2.0]}
