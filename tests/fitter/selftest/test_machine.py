"""What `doctor` finds, against what other programs say of this machine; and what it says where something is missing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.metadata import version

import pytest

from fit_material.fitter.commands import doctor as doctor_command
from fit_material.fitter.selftest import machine
from fit_material.fitter.selftest.machine import Check
from fit_material.renderer.backends import dr_jit, llvm
from fit_material.renderer.errors.input_error import InputError


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    undecided = {name: value for name, value in os.environ.items() if name not in (llvm.LIBRARY, llvm.SWITCH)}
    command = [sys.executable, "-m", "fit_material", "doctor", *arguments]
    return subprocess.run(command, env=undecided | environment, capture_output=True, text=True, check=False)


def test_this_machine_is_well_and_versions_are_those_that_are_installed():
    done = run("--json")
    found = json.loads(done.stdout)
    checks = {each["name"]: each for each in found["checks"]}
    assert (done.returncode, done.stderr, found["ok"]) == (0, "", True)
    assert all({"name", "ok", "found", "remedy"} <= set(each) for each in found["checks"])
    assert checks["torch"]["found"].startswith(version("torch"))
    assert checks["Dr.Jit"]["found"] == version("drjit")
    assert checks["Mitsuba, JAX"]["found"] == version("mitsuba")
    assert checks["Python"]["found"].startswith(".".join(map(str, sys.version_info[:3])))
    assert all(each["remedy"] for each in found["checks"] if not each["ok"])


def test_the_chosen_library_and_the_refused_ones_stand_with_their_reasons(tmp_path):
    broken = tmp_path / "libLLVM-19.so"
    broken.write_text("not a library")
    done = run("--json", DRJIT_LIBLLVM_PATH=str(broken), XDG_CACHE_HOME=str(tmp_path))
    (check,) = (each for each in json.loads(done.stdout)["checks"] if each["name"] == "LLVM")
    assert f"{broken} refused: file too short" in check["found"]
    assert check["ok"] == any(llvm.verdict_on(str(path)).usable for path in llvm.candidates())


@pytest.mark.slow
def test_doing_without_llvm_is_no_illness():
    done = run("--json", FIT_MATERIAL_LLVM="none")
    (check,) = (each for each in json.loads(done.stdout)["checks"] if each["name"] == "LLVM")
    assert (check["ok"], check["needed"], check["remedy"]) == (False, False, "unset FIT_MATERIAL_LLVM")
    assert done.returncode == 0


def printed(monkeypatch, capsys, *found: Check, as_json: bool = False) -> tuple[int, str]:
    monkeypatch.setattr(machine, "checks", lambda: iter(found))
    with pytest.raises(doctor_command.typer.Exit) as ended:
        doctor_command.doctor(as_json)
    return ended.value.exit_code, capsys.readouterr().out


def test_only_what_is_needed_makes_the_exit_code_1(monkeypatch, capsys):
    there, lacking = Check("a", True, "1"), Check("b", False, "nothing", "get b")
    without = Check("c", False, "nothing", "get c", needed=False)
    code, text = printed(monkeypatch, capsys, there, without)
    assert code == 0
    assert text.splitlines()[1].split() == ["without", "c", "nothing;", "remedy:", "get", "c"]
    code, text = printed(monkeypatch, capsys, there, lacking, as_json=True)
    assert (code, json.loads(text)["ok"]) == (1, False)


def test_a_library_that_crashes_is_found_and_does_not_end_the_doctor():
    check = machine.imported("a", "import os; os.abort()")
    assert (check.ok, check.remedy) == (False, "make install")
    check = machine.imported("b", "import no_such_module")
    assert check.found == "ModuleNotFoundError: No module named 'no_such_module'"


def test_a_missing_system_library_is_answered_with_the_line_to_type(monkeypatch):
    def absent() -> None:
        raise InputError("libatomic.so.1", expected="it")

    monkeypatch.setattr(dr_jit, "require_system_library", absent)
    assert machine.system_library() == Check("libatomic", False, "not found", "sudo apt-get install libatomic1")


def test_versions_other_than_the_required_ones_are_found(monkeypatch):
    monkeypatch.setattr(machine, "requires", lambda name: ["numpy>=99", "nothing-of-that-name", "torch; extra == 'x'"])
    check = machine.packages()
    assert (check.ok, check.found) == (False, "not as required: numpy>=99, nothing-of-that-name")


def test_a_system_without_an_llvm_is_told_the_package(monkeypatch):
    monkeypatch.delenv(llvm.SWITCH, raising=False)
    monkeypatch.delenv(llvm.LIBRARY, raising=False)
    monkeypatch.setattr(llvm, "candidates", list)
    check = machine.compiler()
    assert (check.ok, check.found, check.needed) == (False, "no library of LLVM", False)
    assert check.remedy == "sudo apt-get install libllvm19"


def test_full_disks_and_memory_are_found(monkeypatch):
    monkeypatch.setattr(machine, "DISK", 1 << 62)
    monkeypatch.setattr(machine, "MEMORY", 1 << 62)
    assert not machine.disk().ok
    assert not machine.memory().ok


def test_a_folder_that_is_gone_is_found(monkeypatch):
    def gone() -> str:
        raise FileNotFoundError(2, "No such file or directory")

    monkeypatch.setattr(machine.os, "getcwd", gone)
    check = machine.disk()
    assert (check.ok, check.found) == (False, "[Errno 2] No such file or directory")


def test_without_the_system_library_no_compiler_is_tried(monkeypatch):
    """Else every LLVM would be found guilty of what Dr.Jit lacks."""

    def absent() -> None:
        raise InputError("libatomic.so.1", expected="it")

    monkeypatch.delenv(llvm.SWITCH, raising=False)
    monkeypatch.setattr(dr_jit, "require_system_library", absent)
    monkeypatch.setattr(llvm, "verdict_on", lambda library: pytest.fail(f"{library} was tried"))
    assert machine.compiler().remedy == dr_jit.REMEDY
