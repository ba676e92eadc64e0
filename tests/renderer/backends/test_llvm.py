"""Which LLVM is taken: proved by running it, whatever else lies about, and told in one sentence where none serves."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fit_material.renderer.backends import llvm
from fit_material.renderer.backends.llvm import Choice, Verdict

pytestmark = pytest.mark.dr_jit

NOT_A_LIBRARY = "not a library"
FOUND = llvm.candidates()
USABLE = [path for path in FOUND if llvm.verdict_on(str(path)).usable]
OLD = [path for path in FOUND if 0 < llvm.major_version(path) < 17]

needs_llvm = pytest.mark.skipif(not USABLE, reason="no LLVM that serves is here")


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch) -> Path:
    """A cache of this test's own, where verdicts are kept."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "fit-material" / "llvm.json"


@pytest.fixture
def broken(tmp_path) -> Path:
    path = tmp_path / "libLLVM-19.so"
    path.write_text(NOT_A_LIBRARY)
    return path


def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """In a fresh interpreter, in which nothing is decided yet."""
    undecided = {name: value for name, value in os.environ.items() if name not in (llvm.LIBRARY, llvm.SWITCH)}
    return subprocess.run(
        [sys.executable, "-c", code], env=undecided | environment, capture_output=True, text=True, check=False
    )


PREPARED = "import fit_material.renderer, drjit as dr\n"
LLVM = "from fit_material.renderer.backends import llvm\n"
COMPILED = PREPARED + "from drjit.llvm import Float; print(dr.minimum(Float(1, 3), 2)[1])"


@needs_llvm
def test_whoever_imports_dr_jit_gets_a_library_that_compiles_minimum():
    done = run(COMPILED)
    assert (done.returncode, done.stdout, done.stderr) == (0, "2.0\n", "")


@needs_llvm
@pytest.mark.parametrize("first", ["mitsuba", "drjit.llvm"])
def test_the_choice_is_made_whichever_module_brings_dr_jit(first):
    done = run(f"import os, renderer, {first}; print(os.environ['DRJIT_LIBLLVM_PATH'])")
    assert done.stdout.strip() in map(str, USABLE)


@needs_llvm
def test_a_path_that_is_no_library_is_named_and_ignored(broken):
    done = run(COMPILED, DRJIT_LIBLLVM_PATH=str(broken))
    assert (done.returncode, done.stdout) == (0, "2.0\n")
    assert done.stderr == (
        f"fit-material: DRJIT_LIBLLVM_PATH: is {broken}, expected an LLVM library that compiles our kernels "
        "(file too short); it is ignored\n"
    )


@needs_llvm
def test_a_library_that_the_user_names_is_taken_before_others(tmp_path):
    own = tmp_path / "mine.so"
    own.symlink_to(USABLE[0])
    done = run("import os, renderer, drjit; print(os.environ['DRJIT_LIBLLVM_PATH'])", DRJIT_LIBLLVM_PATH=str(own))
    assert (done.stdout.strip(), done.stderr) == (str(own), "")


@pytest.mark.skipif(not OLD, reason="no LLVM older than 17 is here")
def test_a_library_that_ends_the_process_is_refused_and_this_process_lives():
    refused = [llvm.verdict_on(str(path)) for path in OLD]
    assert not any(each.usable for each in refused)
    assert all(("SIGABRT: Cannot select" in each.reason) != ("too old" in each.reason) for each in refused)


def test_without_a_library_one_sentence_names_the_package(broken):
    code = f"from pathlib import Path; llvm.candidates = lambda: [Path({str(broken)!r})]\n"
    done = run(LLVM + code + "import drjit as dr; print(dr.has_backend(dr.JitBackend.LLVM))")
    assert (done.returncode, done.stdout.strip()) == (0, "0")
    assert done.stderr == (
        f"fit-material: none of the LLVM libraries here serves ({broken}: file too short); "
        "path tracing and light tables take several times as long without: sudo apt-get install libllvm19\n"
    )


def test_processes_that_are_started_later_repeat_no_sentence(broken):
    code = (
        "import subprocess, sys; llvm.candidates = lambda: []; import fit_material.renderer, drjit\n"
        "sys.exit(subprocess.run([sys.executable, '-c', 'import fit_material.renderer, drjit']).returncode)"
    )
    done = run(LLVM + code)
    assert done.returncode == 0
    assert done.stderr.count("\n") == 1
    assert "no LLVM library was found; path tracing" in done.stderr


def test_the_switch_goes_without_in_silence():
    done = run(PREPARED + "print(dr.has_backend(dr.JitBackend.LLVM))", FIT_MATERIAL_LLVM="none")
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "0", "")


def test_a_misspelt_switch_is_named_and_ignored():
    done = run(LLVM + "llvm.candidates = lambda: []; llvm.prepare()", FIT_MATERIAL_LLVM="off")
    first, _ = done.stderr.splitlines()
    assert first == "fit-material: FIT_MATERIAL_LLVM: is off, expected none, or no such variable; it is ignored"


def test_a_library_of_two_names_is_proved_once(broken, tmp_path):
    (tmp_path / "other").symlink_to(broken)
    refused = llvm.choose(str(tmp_path / "other"), [broken]).refused
    assert [each.library for each in refused] == [str(tmp_path / "other")]


def test_remarks_of_others_survive_the_import():
    """While Dr.Jit is imported its C++ code is not heard; everything else that is printed meanwhile is."""
    code = (
        "import os, types; from fit_material.renderer.backends import dr_jit\n"
        "def execute(module):\n"
        "    os.write(2, b'jit_llvm_init(): gone\\nstays\\n')\n"
        "dr_jit._execute(execute, types.SimpleNamespace(set_log_level=print, LogLevel=types.SimpleNamespace(Error=1)))"
    )
    assert run(code).stderr == "stays\n"


@pytest.mark.parametrize(
    ("path", "version"),
    [
        ("/usr/lib/x86_64-linux-gnu/libLLVM-15.so.1", 15),
        ("/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1", 19),
        ("/usr/lib/x86_64-linux-gnu/libLLVM-14.0.6.so.1", 14),
        ("/usr/lib/llvm-16/lib/libLLVM.so", 16),
        ("/opt/homebrew/opt/llvm@18/lib/libLLVM.dylib", 18),
        ("/somewhere/libLLVM.so", 0),
    ],
)
def test_versions_are_read_off_names(path, version):
    assert llvm.major_version(Path(path)) == version


def test_tested_versions_come_first_and_newer_before_older(tmp_path, monkeypatch):
    names = ["libLLVM-15.so.1", "libLLVM.so.19.1", "libLLVM.so.23.1", "libLLVM.so.20.1", "libLLVM-14.so.1"]
    for name in names:
        (tmp_path / name).touch()
    (tmp_path / "libLLVM.so").symlink_to("libLLVM.so.20.1")  # the same library once more
    monkeypatch.setattr(llvm, "FOLDERS", (str(tmp_path),))
    monkeypatch.setattr(llvm, "_known_to_loader", list)
    found = [llvm.major_version(path) for path in llvm.candidates()]
    assert found == [20, 19, 23, 15, 14]


@pytest.mark.parametrize("entries", ["", ":", ".", "relative/lib:"])
def test_the_working_folder_is_never_searched(tmp_path, monkeypatch, entries):
    (tmp_path / "relative" / "lib").mkdir(parents=True)
    for folder in (tmp_path, tmp_path / "relative" / "lib"):
        (folder / "libLLVM.so.22.1").touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("LD_LIBRARY_PATH", entries)
    monkeypatch.delenv("CONDA_PREFIX", raising=False)
    assert not [path for path in llvm.candidates() if tmp_path in path.resolve().parents]


def counting(monkeypatch, verdict: Verdict, lasting: bool = True) -> list[str]:
    """Replaces the proof; the list holds what was proved."""
    proved: list[str] = []

    def prove(library: str) -> tuple[Verdict, bool]:
        proved.append(library)
        return verdict, lasting

    monkeypatch.setattr(llvm, "_prove", prove)
    return proved


def test_a_verdict_is_kept_until_the_library_changes(broken, monkeypatch):
    refused = Verdict(str(broken), False, reason="no")
    proved = counting(monkeypatch, refused)
    assert llvm.verdict_on(str(broken)) == llvm.verdict_on(str(broken)) == refused
    assert len(proved) == 1
    broken.write_text(NOT_A_LIBRARY + "!")
    llvm.verdict_on(str(broken))
    assert len(proved) == 2
    os.utime(broken, (0, 0))
    llvm.verdict_on(str(broken))
    assert len(proved) == 3


@pytest.mark.parametrize("package", ["drjit"])
def test_a_verdict_is_not_kept_for_other_versions(broken, monkeypatch, package):
    proved = counting(monkeypatch, Verdict(str(broken), True, "19"))
    llvm.verdict_on(str(broken))
    monkeypatch.setattr(llvm, "version", {package: "99"}.__getitem__)
    llvm.verdict_on(str(broken))
    assert len(proved) == 2


def test_a_proof_that_did_not_end_is_tried_again(broken, monkeypatch):
    proved = counting(monkeypatch, Verdict(str(broken), False, reason="no answer"), lasting=False)
    llvm.verdict_on(str(broken))
    llvm.verdict_on(str(broken))
    assert len(proved) == 2


@pytest.mark.parametrize("damage", ["", "[]", "{", '{"a": 3}', '{"a": {"usable": true}}', "\0"])
def test_a_damaged_file_of_verdicts_is_replaced(broken, own_cache, damage):
    own_cache.parent.mkdir(parents=True)
    own_cache.write_text(damage)
    assert "file too short" in llvm.verdict_on(str(broken)).reason
    assert [each["library"] for each in json.loads(own_cache.read_text()).values()] == [str(broken)]


def test_a_cache_that_cannot_be_written_is_done_without(broken, tmp_path, monkeypatch):
    (tmp_path / "cache").write_text("a file")
    assert not llvm.verdict_on(str(broken)).usable


def test_a_library_that_does_not_answer_is_refused(tmp_path, monkeypatch):
    slow = tmp_path / "slow.py"
    slow.write_text("import time; time.sleep(60)")
    monkeypatch.setattr(llvm, "PROOF", slow)
    monkeypatch.setattr(llvm, "PATIENCE", 0.2)
    verdict, lasting = llvm._prove("libLLVM.so")
    assert not verdict.usable
    assert not lasting
    assert "timed out after 0.2 seconds" in verdict.reason


@needs_llvm
def test_the_proof_finds_wrong_numbers(tmp_path, monkeypatch):
    """A compiler that does not crash, and errs: here the reference is what is wrong."""
    text = llvm.PROOF.read_text("utf-8")
    wrong = tmp_path / "wrong.py"
    wrong.write_text(text.replace("math.exp(_x(i))", "math.exp(_x(i)) + 1e-3"))
    assert wrong.read_text() != text
    monkeypatch.setattr(llvm, "PROOF", wrong)
    verdict, lasting = llvm._prove(str(USABLE[0]))
    assert not verdict.usable
    assert lasting
    assert verdict.reason.startswith("exp, log: computed ")


def test_complaints_name_each_library_once():
    mine, other = Verdict("/mine.so", False, reason="a"), Verdict("/other.so", False, reason="b")
    assert llvm.complaints(Choice(Verdict("/good.so", True, "19"), (other,)), None) == []
    both = llvm.complaints(Choice(None, (mine, other)), "/mine.so")
    assert [sentence.count("/mine.so") for sentence in both] == [1, 0]
    assert [sentence.count("/other.so") for sentence in both] == [0, 1]


@pytest.mark.skipif(shutil.which("unshare") is None or os.geteuid() != 0, reason="needs root, to hide a library")
def test_a_missing_system_library_is_named_before_anything_is_read():
    hidden = "/lib/x86_64-linux-gnu/libatomic.so.1"
    if not Path(hidden).exists():
        pytest.skip("libatomic lies elsewhere")
    script = (
        f"mount --bind /dev/null {os.path.realpath(hidden)} || exit 77; "
        f"exec {sys.executable} -m fit_material check nowhere.toml"
    )
    done = subprocess.run(["unshare", "-m", "sh", "-c", script], capture_output=True, text=True, check=False)
    if done.returncode == 77 or done.stderr.startswith("unshare: "):
        pytest.skip("this machine lets nobody hide a library")
    assert done.returncode == 2
    assert done.stderr == (
        "fit-material: libatomic.so.1: expected this library, which Dr.Jit needs: sudo apt-get install libatomic1\n"
    )


def test_a_dr_jit_that_cannot_be_imported_refuses_no_library_for_good(broken, tmp_path, monkeypatch, own_cache):
    """As on a machine without libatomic, which may be installed later."""
    (tmp_path / "drjit.py").write_text("raise ImportError('libatomic.so.1: cannot open shared object file')")
    monkeypatch.syspath_prepend(str(tmp_path))
    verdict = llvm.verdict_on(str(broken))
    assert (verdict.usable, verdict.reason) == (
        False,
        "ImportError: libatomic.so.1: cannot open shared object file",
    )
    assert not own_cache.exists()
