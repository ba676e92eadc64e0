"""The log of a batch, `fits.jsonl`: lines are appended to a batch's own alone, and no pipe is waited for."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from fit_material.fitter.batch.batch import alone_in
from fit_material.fitter.batch.fits_log import append_to_log
from fit_material.fitter.batch.workers.record import Fitted
from fit_material.renderer.errors.input_error import InputError

RECORD = Fitted(scene="/scenes/a/scene.toml", key="0123", files={}, worker="process 1 of here", starts=2)
LINE = '{"name": "a", "scene": "/scenes/a/scene.toml", "key": "0123"}\n'


@pytest.mark.parametrize(
    "put",
    [
        lambda log: log.write_text("mine\n"),
        lambda log: log.write_bytes(b"\xff\n"),
        lambda log: log.write_text('{"name": "a", "scene": "b"}\n' + LINE),
        lambda log: log.write_text('["name", "scene", "key"]\n'),
        lambda log: log.write_text("[" * 60_000),
        lambda log: log.write_text("\n" + LINE),
        lambda log: log.symlink_to(log.with_name("nothing")),
        lambda log: (log.with_name("other").write_text(LINE), log.symlink_to(log.with_name("other"))),
        lambda log: os.mkfifo(log),
        lambda log: log.mkdir(),
    ],
    ids=["text", "bytes", "keys", "a list", "nested", "blank line", "dead link", "link", "pipe", "folder"],
)
def test_what_is_no_log_of_a_batch_is_refused_before_anything_is_fitted(put, tmp_path):
    put(tmp_path / "fits.jsonl")
    with pytest.raises(InputError) as refused, alone_in(tmp_path):
        pytest.fail("the batch must not begin")
    expected = "expected no file of that name, or one of an earlier batch; move it, or name another place"
    assert str(refused.value) == f"-o: is {tmp_path / 'fits.jsonl'}, {expected}"


@pytest.mark.parametrize("earlier", [None, "", LINE])
def test_lines_are_appended_to_a_new_log_an_empty_one_and_an_earlier_batch_s(earlier, tmp_path):
    log = tmp_path / "fits.jsonl"
    if earlier is not None:
        log.write_text(earlier)
    with alone_in(tmp_path):
        append_to_log(tmp_path, "ü", RECORD)
    with alone_in(tmp_path):
        append_to_log(tmp_path, "b", RECORD)
    text = log.read_text("utf-8")
    assert text.startswith(earlier or '{"time": ')
    lines = [json.loads(line) for line in text.removeprefix(earlier or "").splitlines()]
    known = {"scene": "/scenes/a/scene.toml", "worker": "process 1 of here", "starts": 2, "key": "0123"}
    assert [{key: line[key] for key in line if key != "time"} for line in lines] == [
        {"name": "ü", **known},
        {"name": "b", **known},
    ]


def test_a_link_or_a_pipe_that_has_come_to_the_log_s_place_meanwhile_is_not_written_to(tmp_path):
    log, other = tmp_path / "fits.jsonl", tmp_path / "other"
    other.write_text("mine\n")
    log.symlink_to(other)
    assert refusal(tmp_path) == f"-o: is {log}, {NOT_WRITTEN} (Too many levels of symbolic links)"
    assert other.read_text() == "mine\n"
    log.unlink()
    os.mkfifo(log)
    assert refusal(tmp_path) == f"-o: is {log}, {NOT_WRITTEN} (No such device or address)"
    reader = os.open(log, os.O_RDONLY | os.O_NONBLOCK)
    assert refusal(tmp_path) == f"-o: is {log}, {NOT_WRITTEN} (it is none)"
    assert os.read(reader, 1) == b""
    os.close(reader)


NOT_WRITTEN = "expected a regular file that can be written"


def refusal(out: Path) -> str:
    """How a line is refused; a thread of its own, since one that waits for a pipe waits for ever."""
    said: list[str] = []
    thread = threading.Thread(target=note_refusal, args=(lambda: append_to_log(out, "a", RECORD), said), daemon=True)
    thread.start()
    thread.join(10)
    assert not thread.is_alive()
    return said[0]


def note_refusal(act: Callable[[], None], said: list[str]) -> None:
    try:
        act()
    except InputError as error:
        said.append(str(error))
