"""Rungs against each other: errors by hand, the frontier by brute force, the knee of a known curve."""

from __future__ import annotations

import csv
import io
import json
import math
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fit_material.fitter.frontier import runs as frontier_runs
from fit_material.fitter.frontier.errors import Reference, consensus, errors, require_of_scene, truth_beside
from fit_material.fitter.frontier.page import render_frontier
from fit_material.fitter.frontier.pareto import ERRORS, STAGES, frontier_of, knee, spread
from fit_material.fitter.frontier.plot import frontier_png, plain_ticks
from fit_material.fitter.frontier.rungs import CHOICES, LADDER, Rung, named
from fit_material.fitter.frontier.runs import Experiment, Run, measured
from fit_material.fitter.frontier.table import csv_text, json_text, terminal_table
from fit_material.fitter.result.schema import FittedMaterial, InputFile, Time
from fit_material.renderer.errors.input_error import InputError

GOLD: dict[str, Any] = {"n": (0.2, 0.4, 1.6), "k": (3.2, 2.4, 1.9), "f0": (0.93, 0.75, 0.4), "alpha": 0.2}
TRUTH = (Reference(name="default", type="metal", **GOLD),)
MIB = 2**20


def metal(**changes: Any) -> FittedMaterial:
    return FittedMaterial(name="default", type="metal", **{**GOLD, **changes})


def run(rung: str = "a", seed: int = 0, command: float = 10.0, n: float = 0.2, **changes: Any) -> Run:
    """A run whose only error is that of n of red."""
    values = {
        "status": "converged",
        "message": "It converged.",
        "time": Time(load=1, prepare=command / 2, solve=1, report=1, total=command - 0.5),
        "peak": 900 * MIB,
        "cpu": command / 4,
        "materials": (metal(n=(n, 0.4, 1.6)),),
        "picture": 0.05,
    }
    return Run(rung=rung, options=(), seed=seed, command=command, **{**values, **changes})


def rungs(*names: str) -> tuple[Rung, ...]:
    return tuple(Rung(name, ("--fidelity", name)) for name in names)


# Errors


def test_errors_of_metals_are_relative_and_of_the_worst_channel():
    """By hand: n of blue 1.6 → 1.64 is 2.5 %, k of red 3.2 → 3.04 is 5 %, F0 of blue errs by 0.0093 of 0.93."""
    found = run(materials=(metal(n=(0.2, 0.4, 1.64), k=(3.04, 2.4, 1.9), f0=(0.93, 0.75, 0.3907), alpha=0.19),))
    expected = {"n": 0.025, "k": 0.05, "f0": 0.01, "alpha": 0.05, "color": None, "picture": 0.05, "worst": 0.05}
    assert errors(found, TRUTH) == {key: value and pytest.approx(value) for key, value in expected.items()}


def test_a_channel_without_colour_does_not_blow_up_the_error():
    right = Reference(name="clay", type="matte", color=(0.5, 0.25, 0.0))
    found = run(materials=(FittedMaterial(name="clay", type="matte", color=(0.5, 0.25, 0.01)),))
    assert errors(found, (right,))["color"] == pytest.approx(0.02)


def test_a_wrong_type_has_no_errors():
    found = run(materials=(FittedMaterial(name="default", type="matte", color=(0.5, 0.5, 0.5)),))
    assert {value for key, value in errors(found, TRUTH).items() if key != "picture"} == {None}


def test_the_viewers_pictures_are_compared_by_its_roughness():
    right = Reference(name="default", type="metal", **{**GOLD, "alpha": None, "roughness": 0.5})
    assert errors(run(materials=(metal(roughness=0.55),)), (right,))["alpha"] == pytest.approx(0.1)


def test_consensus_is_the_median_of_each_number():
    runs = [run(n=n, seed=seed) for seed, n in enumerate((0.19, 0.25, 0.2))]
    (found,) = consensus(runs)
    assert (found.n, found.k) == ((0.2, 0.4, 1.6), GOLD["k"])


def test_what_came_out_of_two_types_has_no_consensus():
    other = run(seed=1, materials=(FittedMaterial(name="default", type="matte", color=(0.5, 0.5, 0.5)),))
    assert consensus([run(), other]) == ()


def test_a_truth_that_is_none_is_told(tmp_path):
    scene = tmp_path / "scene.toml"
    assert truth_beside(scene) is None
    (tmp_path / "truth.json").write_text('{"materials": [{"name": "a", "type": "wood"}]}')
    with pytest.raises(InputError, match=r"truth.json: materials\[0\].type: is \"wood\", expected"):
        truth_beside(scene)


def test_a_truth_of_another_scene_is_told(tmp_path):
    scene = tmp_path / "scene.toml"
    require_of_scene(TRUTH, ("default", "base"), scene)
    expected = f"the name of a material of {scene}: a, b; or no truth.json there"
    with pytest.raises(InputError) as told:
        require_of_scene(TRUTH, ("a", "b"), scene)
    assert str(told.value) == f"{tmp_path / 'truth.json'}: materials[].name: is default, expected {expected}"


def test_what_came_out_of_another_type_than_the_truths_is_told():
    clay = FittedMaterial(name="default", type="matte", color=(0.5, 0.5, 0.5))
    runs = [run("a", materials=(clay,)), run("b"), run("a", 1, materials=(clay,)), run("b", 1)]
    told = "default is metal in truth.json but came out as matte from a: no errors of it there."
    found = frontier_of("scene", rungs("a", "b"), runs, TRUTH)
    assert found.gaps == (told,)
    assert told in terminal_table(found).splitlines()
    assert told in render_frontier(found, "A title")
    assert frontier_of("scene", rungs("a", "b"), runs[1::2], TRUTH).gaps == ()


def test_a_material_that_the_truth_lacks_is_told():
    runs = [run(materials=(metal(), metal().model_copy(update={"name": "lid"})))]
    found = frontier_of("scene", rungs("a"), runs, TRUTH)
    assert found.gaps == ("lid is not in truth.json: the errors are without it.",)


# Frontier and knee


TIMES = st.lists(st.tuples(st.floats(1, 100), st.floats(0.001, 1)), min_size=1, max_size=8, unique=True)


@given(TIMES)
def test_nothing_beats_the_frontier_and_all_else_is_beaten(points):
    """Against every pair. n of red is the only error, |n/0.2 - 1|."""
    names = [f"r{index}" for index in range(len(points))]
    runs = [run(name, command=x, n=0.2 * (1 + y)) for name, (x, y) in zip(names, points, strict=True)]
    found = frontier_of("scene", rungs(*names), runs, TRUTH)
    at = {row.rung: row.point("worst") for row in found.rows}
    assert at == {name: pytest.approx(point) for name, point in zip(names, points, strict=True)}
    free = {a for a in names if not any(at[b][0] < at[a][0] and at[b][1] < at[a][1] for b in names)}
    assert set(found.frontier) == free
    assert {row.rung for row in found.rows if row.beaten_by is None} == free


@pytest.mark.parametrize("ends", [(6.9, 9.6), (8.4, 21.0), (0.05, 40.0)])
def test_an_axis_has_numbers_to_read_it_by(ends):
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    axes.set(xscale="log", yscale="log", xlim=ends)
    plain_ticks(axes)
    shown = [tick for tick in axes.get_xticks() if ends[0] <= tick <= ends[1]]
    assert 3 <= len(shown) <= 14  # two tell no scale, and of more the numbers of a small plot would meet


def test_the_knee_is_where_a_hyperbola_bends():
    """Of log-log points on XY = 1 with X, Y from 1 to 9 the one farthest from the chord X + Y = 10 has X = Y = 3."""
    points = [(f"at {x:g}", (math.exp(x), math.exp(9 / x))) for x in (1.0, 1.5, 2.2, 3.0, 4.0, 6.0, 9.0)]
    assert knee(points) == "at 3"


@given(st.floats(0.1, 10), st.floats(0.01, 100), st.floats(0.01, 100))
def test_units_do_not_move_the_knee(power, seconds, share):
    points = [("a", (1.0, 1.0)), ("b", (2.0, 0.2)), ("c", (5.0, 0.1)), ("d", (30.0, 0.05))]
    assert knee(points) == "b"
    assert knee([(name, (seconds * x**power, share * y)) for name, (x, y) in points]) == "b"


@pytest.mark.parametrize(
    "points",
    [
        [("a", (1.0, 1.0)), ("b", (2.0, 0.1))],
        [("a", (1.0, 1.0)), ("b", (10.0, 0.9)), ("c", (20.0, 0.1))],  # above the chord
    ],
)
def test_no_bend_no_knee(points):
    assert knee(points) is None


def test_without_truth_the_finest_rung_is_the_measure_and_is_not_measured():
    runs = [run("a", n=0.22), run("b", n=0.21)]
    found = frontier_of("scene", rungs("a", "b"), runs, None)
    assert found.rows[0].errors["n"].median == pytest.approx(0.22 / 0.21 - 1)  # type: ignore[union-attr]
    assert found.rows[1].is_reference
    assert found.frontier == ("a",)
    assert found.against.startswith("the finest rung, b")
    assert "Errors are against the finest rung, b" in terminal_table(found)


def test_prices_are_ratios_of_runs_side_by_side():
    """The machine was twice as slow in the second round: ratios of medians would give 40/15."""
    runs = [run("a", 0, 10.0), run("b", 0, 20.0), run("a", 1, 20.0), run("b", 1, 60.0)]
    found = frontier_of("scene", rungs("a", "b"), runs, TRUTH, priced=True)
    assert found.rows[1].price == spread([2.0, 3.0])


def test_single_choices_have_no_knee(three):
    """The ladder of the same numbers has one."""
    made = [run(row.rung, 0, row.seconds["command"].median, 0.2 + 0.2 * row.errors["n"].median) for row in three.rows]
    names = rungs(*(row.rung for row in three.rows))
    assert frontier_of("scene", names, made, TRUTH).knee == "b"
    assert frontier_of("scene", names, made, TRUTH, priced=True).knee is None


def test_a_failed_rung_is_told_and_spoils_nothing():
    failed = run("b", status="failed", message="ended with code -9", time=None, materials=(), picture=None)
    found = frontier_of("scene", rungs("a", "b"), [run("a"), failed], TRUTH)
    assert found.rows[1].seconds["command"] is None
    assert "b failed: ended with code -9" in terminal_table(found)
    assert csv_text(found).count("\n") == 3
    assert frontier_png(found)


# What is written


@pytest.fixture(scope="module")
def three():
    made = {"a": (5.0, 0.3), "b": (6.0, 0.21), "c": (20.0, 0.202), "worse": (25.0, 0.25)}
    runs = [run(name, seed, x * (1 + seed / 10), n) for seed in range(3) for name, (x, n) in made.items()]
    return frontier_of("scene.toml", rungs(*made), runs, TRUTH)


def test_csv_has_every_number(three):
    rows = list(csv.DictReader(io.StringIO(csv_text(three))))
    assert [row["rung"] for row in rows] == ["a", "b", "c", "worse"]
    assert float(rows[0]["error_n_median"]) == pytest.approx(0.5)
    assert [float(rows[0][f"seconds_command_{part}"]) for part in ("median", "low", "high")] == [5.5, 5.0, 6.0]
    assert {f"error_{key}_high" for key in ERRORS} | {f"seconds_{stage}_low" for stage in STAGES} <= set(rows[0])
    assert rows[0]["error_color_median"] == ""
    assert rows[3]["verdict"] == "beaten by b"


def test_json_is_strict_and_says_what_the_table_says(three):
    data = json.loads(json_text(three), parse_constant=lambda text: pytest.fail(text))
    assert (data["format"], data["knee"], data["frontier"]) == (1, "b", ["a", "b", "c"])
    table = terminal_table(three)
    assert "The knee is b" in table
    assert "beaten by b" in table
    assert "against the truth" in table


def test_the_table_of_medians_says_where_the_ranges_are(three):
    told = "The range of the repeats is in the page, and in the .csv and .json beside it."
    assert told in terminal_table(three).splitlines()
    assert told not in terminal_table(frontier_of("scene", rungs("a"), [run("a")], TRUTH))


def test_the_page_loads_nothing_and_shows_every_rung(three):
    page = render_frontier(three, "A title", "fit-material frontier <scene>")
    addresses: list[str] = []

    class Addresses(HTMLParser):
        def handle_starttag(self, tag, attrs):
            addresses.extend(value for key, value in attrs if key in ("src", "href") and not value.startswith("#"))

    Addresses().feed(page)
    assert addresses == []
    assert "://" not in page
    assert "&lt;scene&gt;" in page
    assert all(f"<b>{name}</b>" in page for name in ("a", "b", "c", "worse"))
    assert "<svg" in page


def test_the_plot_is_a_picture_with_ink(three):
    from PIL import Image

    pixels = np.asarray(Image.open(io.BytesIO(frontier_png(three))).convert("RGB"))
    assert pixels.shape[1] > pixels.shape[0] > 500
    assert (pixels == 255).all(-1).mean() > 0.5  # white, and something on it
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 20


# Rungs by name


def test_rungs_are_chosen_by_name_in_the_ladders_order():
    assert [rung.name for rung in named(LADDER, "standard, viewer")] == ["viewer", "standard"]
    assert named(CHOICES, None) == CHOICES
    assert [rung.name for rung in named(CHOICES, "adam", always=CHOICES[:1])] == ["standard", "adam"]


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        ("standrad,viewer", r"--rungs: is standrad, expected names .* viewer"),
        ("viewer", "expected two rungs at least"),
        ("", '--rungs: is "", expected names'),
        ("viewer,", '--rungs: is "", expected names'),
    ],
)
def test_slips_in_names_are_told(names, sentence):
    with pytest.raises(InputError, match=sentence):
        named(LADDER, names)


def test_what_choices_are_compared_with_is_no_choice():
    with pytest.raises(InputError, match="--rungs: is standard, expected another than standard"):
        named(CHOICES, "standard", always=CHOICES[:1])


@pytest.mark.parametrize("rung", [*LADDER, *CHOICES], ids=lambda rung: rung.name)
def test_every_rung_is_a_command_line_that_fit_takes(rung):
    """Typer and the fidelity accept the options; the missing scene is the first thing to be told."""
    import typer.main
    from typer.core import TyperGroup

    from fit_material.fitter.commands.app import app

    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    context = group.commands["fit"].make_context("fit", ["scene.toml", "-o", "x", *rung.options])
    given = {key.lstrip("-").replace("-", "_"): value for key, value in zip(rung.options[::2], rung.options[1::2])}  # noqa: B905
    assert {key: str(getattr(context.params[key], "value", context.params[key])) for key in given} == given


# Runs


@pytest.fixture
def experiment(tmp_path) -> Experiment:
    folder = tmp_path / "runs"
    folder.mkdir()
    return Experiment(tmp_path / "scene.toml", (InputFile(path="a", sha256="0" * 64),), (), folder)


def test_runs_take_no_module_of_the_working_folder(experiment, tmp_path, monkeypatch):
    for name in ("typer", "torch", "fit_material"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"scene\.toml"):  # there is none
        experiment.run(LADDER[0], 0)
    assert not (tmp_path / "ran").exists()


def test_a_run_is_kept_and_not_made_again(experiment, monkeypatch):
    made: list[tuple[str, int]] = []

    def fresh(self, rung, seed):
        made.append((rung.name, seed))
        return run(rung.name, seed)

    monkeypatch.setattr(Experiment, "_fresh", fresh)
    rung = LADDER[0]
    first = [experiment.run(rung, seed) for seed in (0, 1, 0, 1)]
    assert made == [("viewer", 0), ("viewer", 1)]
    assert first[0] == first[2]
    changed = Experiment(experiment.scene, (InputFile(path="a", sha256="1" * 64),), (), experiment.folder)
    changed.run(rung, 0)
    Experiment(experiment.scene, experiment.inputs, ("--type", "metal"), experiment.folder).run(rung, 0)
    monkeypatch.setattr(frontier_runs, "versions", lambda: {"fit-material": "999"})
    experiment.run(rung, 0)
    monkeypatch.setattr(frontier_runs, "code_digest", lambda: "changed")
    experiment.run(rung, 0)
    assert len(made) == 6


@pytest.mark.parametrize("damage", [b"{", b"", b"\xff", b"[]", b'{"format": 2}', b"[" * 200_000])
def test_a_damaged_run_is_made_again(experiment, monkeypatch, damage):
    monkeypatch.setattr(Experiment, "_fresh", lambda self, rung, seed: run(rung.name, seed))
    first = experiment.run(LADDER[0], 0)
    (kept,) = experiment.folder.iterdir()
    whole = kept.read_bytes()
    kept.write_bytes(damage)
    assert experiment.run(LADDER[0], 0) == first
    assert kept.read_bytes() == whole


def test_a_failed_run_is_not_kept(experiment, monkeypatch):
    failed = run(status="failed", message="gone", time=None, materials=(), picture=None)
    monkeypatch.setattr(Experiment, "_fresh", lambda self, rung, seed: failed)
    assert experiment.run(LADDER[0], 0) == failed
    assert not list(experiment.folder.iterdir())


def test_a_process_is_measured(tmp_path):
    """It holds 300 MiB of its own; Python itself takes some 10, and what this test process held counts, too."""
    import resource

    busy = "while time.process_time() < 0.5: pass"
    code = f"import sys, time; x = b'x' * (300 * {MIB})\n{busy}\nprint('last', file=sys.stderr); sys.exit(3)"
    ended = measured([sys.executable, "-c", code], tmp_path / "errors.txt")
    assert (ended.code, ended.last_words) == (3, "last")
    assert ended.seconds > 0.5  # one thread: its CPU time is part of it
    assert 0.5 <= ended.cpu <= 1.1 * ended.seconds
    here = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * frontier_runs.KIBIBYTE
    assert 300 * MIB <= ended.peak < max(here, 400 * MIB) * 1.1


def test_an_interrupt_leaves_no_process_behind(tmp_path, monkeypatch):
    started: list[subprocess.Popen[bytes]] = []
    popen = subprocess.Popen

    def noted(*arguments, **options):
        started.append(popen(*arguments, **options))
        return started[-1]

    def interrupted(pid, options):
        raise KeyboardInterrupt

    monkeypatch.setattr(frontier_runs.subprocess, "Popen", noted)
    monkeypatch.setattr(frontier_runs.os, "wait4", interrupted)
    with pytest.raises(KeyboardInterrupt):
        measured([sys.executable, "-c", "import time; time.sleep(60)"], Path(tmp_path) / "errors.txt")
    assert started[0].returncode == -9
