"""Standard streams led elsewhere: of the process, of the library's own code, and back again whatever happens."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from fit_material.renderer.compute.silence import redirected


def test_what_is_written_past_python_goes_to_the_target_and_later_to_the_stream_again(capfd, tmp_path):
    with (tmp_path / "target").open("wb") as target, redirected((1, 2), target.fileno()):
        os.write(1, b"one ")
        os.write(2, b"two")
    os.write(1, b"out")
    os.write(2, b"error")
    assert (tmp_path / "target").read_bytes() == b"one two"
    assert tuple(capfd.readouterr()) == ("out", "error")


def test_an_exception_gives_the_streams_back(capfd, tmp_path):
    with (tmp_path / "target").open("wb") as target:
        with pytest.raises(KeyboardInterrupt), redirected((2,), target.fileno()):
            raise KeyboardInterrupt
        os.write(2, b"error")
    assert capfd.readouterr().err == "error"


def test_no_descriptor_stays_open(tmp_path):
    with (tmp_path / "target").open("wb") as target:
        before = os.dup(1)
        os.close(before)
        with redirected((1, 2), target.fileno()):
            pass
        after = os.dup(1)
        os.close(after)
    assert after == before


def test_threads_whose_blocks_overlap_leave_the_streams_as_they_were(tmp_path):
    """The first to enter leaves first, while the second still waits or is inside."""
    before, entered = os.fstat(2), threading.Event()

    def second() -> None:
        with (tmp_path / "b").open("wb") as target, redirected((2,), target.fileno()):
            entered.set()
            left.wait(10)

    left, thread = threading.Event(), threading.Thread(target=second)
    with (tmp_path / "a").open("wb") as target, redirected((2,), target.fileno()):
        thread.start()
        entered.wait(0.2)
    left.set()
    thread.join()
    after = os.fstat(2)
    assert os.path.samestat(before, after)


IN_ONE = """
import os, tempfile
from fit_material.renderer.compute.silence import redirected
with tempfile.TemporaryFile() as target:
    with redirected((1, 2), target.fileno()):
        os.write(1, b"one ")
        os.write(2, b"two")
    target.seek(0)
    os.write({report}, target.read())
for stream in (1, 2):
    try:
        os.fstat(stream)
        os.write({report}, b" %d" % stream)
    except OSError:
        pass
"""


@pytest.mark.parametrize(("closed", "still_open"), [("", " 1 2"), ("2>&-", " 1"), (">&-", " 2"), (">&- 2>&-", "")])
def test_closed_streams_are_closed_again_though_the_target_took_their_place(closed, still_open):
    read, write = os.pipe()
    command = f'exec "$0" -c "$1" {closed}'
    subprocess.run(["sh", "-c", command, sys.executable, IN_ONE.format(report=write)], pass_fds=[write], check=True)
    os.close(write)
    with open(read, "rb") as report:
        assert report.read().decode() == f"one two{still_open}"


def test_dr_jit_is_imported_and_an_exr_read_where_standard_error_is_closed(tmp_path):
    code = (
        "import sys, numpy; import fit_material.renderer, drjit;"
        "from fit_material.renderer.images.image_file import write_exr, read_image;"
        "write_exr(sys.argv[1], numpy.ones((2, 3, 3), numpy.float32)); print(read_image(sys.argv[1]).radiance.shape)"
    )
    command = ["sh", "-c", 'exec "$0" -c "$1" "$2" 2>&-', sys.executable, code, tmp_path / "a.exr"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "(2, 3, 3)\n")
