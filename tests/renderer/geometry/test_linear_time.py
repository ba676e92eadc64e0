"""OBJ and MTL text is read in a time that grows with its length, whatever stands in it."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.geometry.obj import plain_obj
from fit_material.renderer.materials.mtl_reader import read_mtl
from fit_material.renderer.materials.mtl_syntax import distinct
from fit_material.renderer.viewer_model.model import file_names, read_model

MANY = 40_000
VERTICES = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
FACE = "f 1 2 3\n"

OBJ: dict[str, Callable[[int], str]] = {
    "blank lines": lambda n: VERTICES + "\n" * n + FACE,
    "form feeds": lambda n: VERTICES + "\f" * n + FACE,
    "blanks": lambda n: VERTICES + " " * n + "\n" + FACE,
    "lines of blanks": lambda n: VERTICES + " \t\n" * n + FACE,
    "continued lines": lambda n: VERTICES + "\\\n" * n + "\n" + FACE,
    "faces": lambda n: VERTICES + FACE * (n // 10),
    "corners of a face": lambda n: VERTICES + "f" + " 1 2 3" * (n // 10) + "\n",
    "slashes": lambda n: VERTICES + "f " + "/" * n + " 2 3\n" + FACE,
    "words of a material": lambda n: VERTICES + "usemtl" + " #" * n + "\n" + FACE,
    "materials": lambda n: VERTICES + "".join(f"usemtl {i}\n{FACE}" for i in range(n // 40)),
}
MTL: dict[str, Callable[[int], str]] = {
    "digits before a letter": lambda n: f"newmtl a\nNs {'1' * n}x\n",
    "digits of an option": lambda n: f"newmtl a\nmap_Kd -bm {'1' * n}x a.png\n",
    "options": lambda n: f"newmtl a\nmap_Kd {'-s 1 1 1 ' * (n // 9)}x a.png\n",
    "half options": lambda n: f"newmtl a\nmap_Kd {'-mm 1 ' * (n // 6)}x a.png\n",
    "blanks in an option": lambda n: f"newmtl a\nmap_Kd -s 1{' ' * n}\n",
    "comments": lambda n: f"newmtl a\nKd 1 1 1{' #' * n}\n",
    "blank lines": lambda n: f"newmtl a\n{chr(10) * n}Kd 1 1 1\n",
    "keys": lambda n: "newmtl a\n" + "".join(f"k{i} 1\n" for i in range(n // 4)),
}


def growth(run: Callable[[int], object]) -> float:
    """Time of twice the length over that of the length, 2 of what is linear and 4 of a square; the best of several."""
    short, long = math.inf, math.inf
    for _ in range(6):
        short, long = min(short, _seconds(run, MANY)), min(long, _seconds(run, 2 * MANY))
        if long < 2.5 * short:
            break
    return long / (short + 0.002)  # of what takes no time at all, the clock's steps are no growth


def _seconds(run: Callable[[int], object], size: int) -> float:
    begun = time.process_time()
    run(size)
    return time.process_time() - begun


@pytest.mark.parametrize("text", OBJ.values(), ids=OBJ)
def test_an_obj_of_twice_the_length_takes_twice_the_time(text):
    data = {size: text(size).encode() for size in (MANY, 2 * MANY)}

    def read(size: int) -> None:
        plain = plain_obj(data[size], "default")
        assert plain.text
        assert plain.faces

    assert growth(read) < 3


@pytest.mark.parametrize("text", MTL.values(), ids=MTL)
def test_an_mtl_of_twice_the_length_takes_twice_the_time(text, tmp_path):
    paths = {size: tmp_path / f"{size}.mtl" for size in (MANY, 2 * MANY)}
    for size, path in paths.items():
        path.write_text(text(size))

    def read(size: int) -> None:
        with suppress(InputError):  # of what is no number
            read_mtl(paths[size])

    assert growth(read) < 3


def test_a_mtllib_line_of_twice_the_words_takes_twice_the_time(tmp_path):
    paths = {size: tmp_path / f"{size}.obj" for size in (MANY, 2 * MANY)}
    for size, path in paths.items():
        path.write_text(f"{VERTICES}mtllib {'a ' * (size // 40)}\n{FACE}")
    assert growth(lambda size: read_model(paths[size])) < 3


@pytest.mark.parametrize(
    "names", [lambda n: ["a"] * n, lambda n: [*(f"a_{i}" for i in range(n // 2)), *["a"] * (n // 2)]]
)
def test_twice_the_names_are_told_apart_in_twice_the_time(names):
    assert growth(lambda size: distinct(names(size))) < 3


@given(st.lists(st.sampled_from(["a", "b", "a_2", "a_3", "b_2", "a_2_2"])))
def test_names_get_the_first_number_that_is_free(names):
    taken: list[str] = []
    for name in names:
        taken.append(next(each for each in (name, *(f"{name}_{i}" for i in range(2, 99))) if each not in taken))
    assert distinct(list(names)) == taken


LINES = st.sampled_from(
    [
        "v 0 0 0",
        "vt 0 0",
        " vt 1 0",
        "\tvn 0 0 1",
        "vn 0 0 1",
        "f 1/1/1 2/1/1 3/1/1",
        "f 1//1 1//1 1//1",
        "",
        "  ",
        "vt",
        "x",
        "#vt 0 0",
        "vtx 0 0",
        "usemtl a",
        "vt \\",
    ]
)


@given(st.lists(LINES), st.sampled_from(["\n", "\r\n", "\n\n", "\n \n"]))
def test_a_face_keeps_normals_and_coordinates_where_a_line_has_them(lines, end):
    """By reading line for line, each with those that it goes on in."""
    text = end.join(["v 0 0 0"] * 3 + lines + ["v 0 0 0"])
    joined = text.replace("\r\n", "\n").replace("\\\n", " ").split("\n")
    words = [line.split() for line in joined if line.split()]
    if any(each == ["vt"] for each in words):
        with pytest.raises(ValueError, match="without 2 numbers"):
            plain_obj(text.encode(), "default")
        return
    written = {each[0] for each in words} & {"vt", "vn"}
    kept = {kind for _, kinds, _ in plain_obj(text.encode(), "default").faces for kind in kinds} - {"v"}
    asked = {kind for each in words if each[0] == "f" for kind in (("vt", "vn") if "1/1/1" in each[1] else ("vn",))}
    assert kept == asked & written


@given(st.lists(st.sampled_from(["a", "b.mtl", "c d", ".mtl", "x.MTL", "e.mtlx", " ", "\t"])))
def test_the_files_of_a_mtllib_line_are_what_one_expression_finds_in_it(words):
    """The expression itself takes a time that grows with the square of a line of words without an ending."""
    line = " ".join(words).strip()
    assert file_names(line) == re.findall(r"\S.*?\.mtl(?!\S)|\S+", line, re.IGNORECASE)
