"""A limit on address space that the libraries do not fit in: one sentence, where they would abort."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest

TOO_LITTLE = 2_000_000 << 10  # `ulimit -v 2000000`
SENTENCE = (
    r"fit-material: ulimit -v: is 2\.0 GB, expected at least \d+\.\d GB of address space on this machine: "
    r"`ulimit -v unlimited`\n"
)
COMMANDS = [
    ["demo", "-o", "out"],
    ["selftest"],
    ["check", "scene.toml", "--json"],
    ["fit", "scene.toml", "-o", "out"],
    ["plan", "scene.toml"],
    ["frontier", "scene.toml", "-o", "out"],
    ["batch", "list.txt", "-o", "out"],
    ["synth", "--metal", "Au", "-o", "out"],
    ["view", "a.obj"],
    ["probe", "ball.exr", "-o", "out"],
    ["advise", "scene.toml"],
]


def run(*arguments: str, limit: int, folder) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["sh", "-c", f'ulimit -v {limit >> 10}; exec "$@"', "sh", sys.executable, "-m", "fit_material", *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        cwd=folder,
    )


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[0])
def test_every_command_says_that_it_is_too_little(command, tmp_path):
    done = run(*command, limit=TOO_LITTLE, folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(SENTENCE, done.stderr)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("arguments", [["--help"], ["fit", "--help"], ["--version"]], ids=" ".join)
def test_help_and_version_need_none_of_it(arguments, tmp_path):
    done = run(*arguments, limit=TOO_LITTLE, folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
def test_the_doctor_finds_it(tmp_path):
    done = run("doctor", "--json", limit=TOO_LITTLE, folder=tmp_path)
    (check,) = (each for each in json.loads(done.stdout)["checks"] if each["name"] == "memory")
    assert (done.returncode, check["ok"], check["remedy"]) == (1, False, "ulimit -v unlimited")


@pytest.mark.slow
def test_with_as_much_as_is_asked_for_the_demo_runs(tmp_path):
    refusal = run("demo", "-o", "out", limit=TOO_LITTLE, folder=tmp_path).stderr
    needed = re.search(r"at least (\d+\.\d) GB", refusal)
    assert needed is not None
    done = run("demo", "-o", "out", limit=int((float(needed[1]) + 0.05) * 1e9), folder=tmp_path)
    assert done.returncode == 0, done.stderr
