"""A batch on a Dask cluster: as docs/many-scenes.md describes it, by TLS, and what is refused."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from fit_material.fitter.batch.workers import cluster
from fit_material.fitter.batch.workers.scheduler import Certificates, Scheduler, scheduler_of
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.materials.ground_truth import TrueMatte
from fit_material.renderer.synthesis.synthesise import SynthOptions, synthesise
from tests.fitter.batch.test_batch import FILES, QUICK, run
from tests.support.paths import ROOT, SOURCE

DOCUMENTED = re.findall(r"```sh\n(.*?)\n```", (ROOT / "docs" / "many-scenes.md").read_text("utf-8"), re.DOTALL)
MAKE, SCHEDULE, WORK, BATCH = map(shlex.split, DOCUMENTED)
PROGRAMS = {
    "dask": [sys.executable, "-m", "dask"],
    "fit-material": [sys.executable, "-m", "fit_material"],
}
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(SOURCE)}

needs_openssl = pytest.mark.skipif(shutil.which("openssl") is None, reason="certificates are made by openssl")


@pytest.fixture(scope="module")
def certificate(tmp_path_factory) -> Path:
    """Folder with a certificate and its key, made as the documentation has it."""
    folder = tmp_path_factory.mktemp("certificate")
    subprocess.run(MAKE, cwd=folder, check=True, capture_output=True)
    return folder


@pytest.fixture(scope="module")
def scenes(tmp_path_factory) -> Path:
    """Folder of two scenes of a matte ball."""
    folder = tmp_path_factory.mktemp("scenes")
    options = SynthOptions(TrueMatte((0.5, 0.3, 0.2)), size=32, spp=4096, views=2)
    first = synthesise(options, folder / "first").parent
    shutil.copytree(first, folder / "second")
    return folder


def here(command: list[str], port: int) -> list[str]:
    """A documented command for this machine, which may have a single core."""
    changed = {"10.0.0.1": "127.0.0.1", "8786": str(port), "4": "1"}
    words = [re.sub(r"[.\d]*\d", lambda found: changed.get(found[0], found[0]), word) for word in command]
    return [*PROGRAMS[words[0]], *words[1:]]


def security(folder: Path):
    """Of all sides, as Dask has it, with the certificate in that folder."""
    from distributed import Security

    cert, key = str(folder / "cert.pem"), str(folder / "key.pem")
    roles = ("client", "scheduler", "worker")
    of_all = {f"tls_{role}_{what}": path for role in roles for what, path in (("cert", cert), ("key", key))}
    return Security(tls_ca_file=cert, require_encryption=True, **of_all)


def options(folder: Path) -> list[str]:
    """Of the command, with the certificate in that folder."""
    cert, key = str(folder / "cert.pem"), str(folder / "key.pem")
    return ["--tls-ca-file", cert, "--tls-cert", cert, "--tls-key", key]


@pytest.fixture(scope="module")
def by_tls(certificate) -> Iterator[str]:
    """Address of a cluster of two workers."""
    from distributed import LocalCluster

    how = {"n_workers": 2, "threads_per_worker": 1, "processes": False, "dashboard_address": "127.0.0.1:0"}
    with LocalCluster(**how, protocol="tls://", security=security(certificate)) as local:
        yield local.scheduler_address


@needs_openssl
def test_two_workers_fit_by_tls(by_tls, scenes, certificate, tmp_path, monkeypatch, capsys):
    arguments = ("batch", scenes, "-o", tmp_path, "--scheduler", by_tls, *options(certificate), "--type", "matte")
    assert run(monkeypatch, *arguments, *QUICK) == 0
    said = capsys.readouterr()
    assert "2 scenes: 2 converged. " in said.out
    assert said.err == ""
    assert_fitted_by_two(tmp_path)


def assert_fitted_by_two(out: Path) -> None:
    """Each scene by another worker, with all files of a fit."""
    found = json.loads((out / "summary.json").read_text())["scenes"]
    assert [each["status"] for each in found] == ["converged", "converged"]
    assert len({each["worker"] for each in found}) == 2
    for each in found:
        assert each["worker"].startswith("tls://")
        assert {path.name for path in (out / each["name"]).iterdir()} == FILES | {"batch.json"}


@needs_openssl
@pytest.mark.slow  # three processes begin one after the other
def test_the_documentation_s_commands_work(scenes, certificate):
    """As they stand, but for the address and the number of threads."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    (certificate / "list.txt").write_text(f"{scenes / 'first'} --type matte\n{scenes / 'second'} --type matte\n")
    with ExitStack() as stack:
        log = stack.enter_context(open(certificate / "log.txt", "wb"))
        for command in (SCHEDULE, WORK, WORK):
            begun = subprocess.Popen(here(command, port), cwd=certificate, env=ENVIRONMENT, stdout=log, stderr=log)
            stack.callback(begun.wait)
            stack.callback(begun.terminate)
        wait_for_workers(f"tls://127.0.0.1:{port}", certificate)
        command = [*here(BATCH, port), *QUICK]
        ended = subprocess.run(command, cwd=certificate, env=ENVIRONMENT, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, ""), ended.stdout
    assert_fitted_by_two(certificate / "results")


def wait_for_workers(address: str, certificate: Path) -> None:
    from distributed import Client

    with Client(address, security=security(certificate), timeout=60, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)


def connected(scheduler: Scheduler, monkeypatch) -> str:
    """What is wrong with a scheduler once it is called; "" where it answers."""
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT", 3)
    try:
        list(cluster.cluster_fits(scheduler, []))
    except InputError as error:
        return str(error)
    return ""


@needs_openssl
def test_only_those_with_the_certificate_are_let_in(by_tls, certificate, tmp_path, monkeypatch):
    """And only a scheduler that has it is used."""
    subprocess.run(MAKE, cwd=tmp_path, check=True, capture_output=True)
    address, ours, other = by_tls, certificate / "cert.pem", tmp_path / "cert.pem"
    certificates = Certificates(ours, ours, certificate / "key.pem")
    assert connected(Scheduler(address, certificates), monkeypatch) == ""
    start = (
        f"--scheduler: is {address}, expected the address of a Dask scheduler that runs, such as tls://10.0.0.1:8786"
    )
    with_another = connected(Scheduler(address, Certificates(ours, other, tmp_path / "key.pem")), monkeypatch)
    assert with_another.startswith(start)
    of_another = connected(Scheduler(address, Certificates(other, ours, certificate / "key.pem")), monkeypatch)
    assert of_another.startswith(start)
    assert "certificate verify failed" in of_another
    plain = address.replace("tls", "tcp")
    assert connected(Scheduler(plain, None), monkeypatch).startswith(start.replace(address, plain))


def test_a_cluster_without_tls_fits_where_that_is_accepted(scenes, tmp_path, monkeypatch, capsys):
    from distributed import LocalCluster

    with LocalCluster(n_workers=1, processes=False, protocol="tcp://", dashboard_address="127.0.0.1:0") as local:
        arguments = ("batch", scenes / "first", "-o", tmp_path, "--scheduler", local.scheduler_address, "--insecure")
        assert run(monkeypatch, *arguments, "--type", "matte", *QUICK) == 0
    assert "1 scene: 1 converged. " in capsys.readouterr().out


# What is refused before anything else


@pytest.mark.parametrize(
    "address",
    ["tcp://10.0.0.1:8786", "10.0.0.1:8786", "ucx://a:1", "ws://a:1", "inproc://1", "TLS://a:1", "tls:/a:1", ""],
)
def test_an_address_without_tls_is_refused(scenes, tmp_path, monkeypatch, capsys, address):
    assert run(monkeypatch, "batch", scenes, "-o", tmp_path / "out", "--scheduler", address) == 2
    found = f" is {address}," if address else ""
    expected = (
        f"fit-material: --scheduler:{found} expected an address by TLS, such as tls://10.0.0.1:8786, or --insecure:"
        " without TLS whoever reaches the scheduler can run code as you, here and on all workers\n"
    )
    assert capsys.readouterr().err == expected
    assert not (tmp_path / "out").exists()


KEY = "a file with the private key of {1}, in PEM format, without a passphrase"


@pytest.fixture
def pem(tmp_path, request) -> Path:
    """Folder of a certificate, and of what could be taken for one."""
    folder = Path(shutil.copytree(request.getfixturevalue("certificate"), tmp_path / "pem", dirs_exist_ok=True))
    (folder / "folder").mkdir()
    (folder / "text").write_text("no certificate\n")
    (folder / "both").write_text((folder / "cert.pem").read_text() + (folder / "key.pem").read_text())
    (folder / "other").mkdir()
    subprocess.run(MAKE, cwd=folder / "other", check=True, capture_output=True)
    shutil.move(folder / "other" / "key.pem", folder / "key of another")
    command = ["openssl", "pkey", "-in", "key.pem", "-aes256", "-passout", "pass:secret", "-out", "encrypted"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return folder


@needs_openssl
@pytest.mark.parametrize(
    ("files", "sentence"),
    [
        ((None, None, None), "--tls-ca-file: expected the certificates by which a scheduler at tls:// is recognised"),
        (
            ("cert.pem", None, None),
            "--tls-cert: expected the certificate by which a scheduler at tls:// recognises who calls",
        ),
        (
            ("none", "cert.pem", "key.pem"),
            "--tls-ca-file: is {0}, expected a file that can be read (No such file or directory)",
        ),
        (
            ("cert.pem", "cert.pem/none", "key.pem"),
            "--tls-cert: is {1}, expected a file that can be read (Not a directory)",
        ),
        (("cert.pem", "folder", "key.pem"), "--tls-cert: is {1}, expected a regular file"),
        (("text", "cert.pem", "key.pem"), "--tls-ca-file: is {0}, expected a file with certificates, in PEM format"),
        (("key.pem", "cert.pem", "key.pem"), "--tls-ca-file: is {0}, expected a file with certificates, in PEM format"),
        (("cert.pem", "text", "key.pem"), "--tls-cert: is {1}, expected a file with certificates, in PEM format"),
        (("cert.pem", "cert.pem", None), f"--tls-key: expected {KEY}"),
        (("cert.pem", "cert.pem", "text"), f"--tls-key: is {{2}}, expected {KEY}"),
        (("cert.pem", "cert.pem", "key of another"), f"--tls-key: is {{2}}, expected {KEY}"),
        (("cert.pem", "cert.pem", "encrypted"), f"--tls-key: is {{2}}, expected {KEY}"),
    ],
)
def test_what_is_wrong_with_certificates_is_one_sentence(pem, scenes, monkeypatch, capsys, files, sentence):
    paths = [None if name is None else pem / name for name in files]
    options = zip(("--tls-ca-file", "--tls-cert", "--tls-key"), paths, strict=True)
    given = [word for option, path in options if path is not None for word in (option, path)]
    arguments = ("batch", scenes, "-o", pem / "out", "--scheduler", "tls://127.0.0.1:9", *given)
    assert run(monkeypatch, *arguments) == 2
    assert capsys.readouterr().err == f"fit-material: {sentence.format(*paths)}\n"
    assert not (pem / "out").exists()


@needs_openssl
def test_a_file_that_may_not_be_read(pem, monkeypatch):
    def refuse(path, *arguments):
        raise PermissionError(13, "Permission denied")

    cert = pem / "cert.pem"
    monkeypatch.setattr(Path, "open", refuse)  # root may read all
    with pytest.raises(InputError) as refused:
        scheduler_of("tls://a:1", cert, cert, None, False)
    assert str(refused.value) == f"--tls-ca-file: is {cert}, expected a file that can be read (Permission denied)"


@needs_openssl
def test_certificate_and_key_may_be_one_file(pem):
    both = pem / "both"
    assert scheduler_of("tls://a:1", both, both, None, False) == Scheduler("tls://a:1", Certificates(both, both, None))


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ("--tls-cert", "c.pem"),
            "--tls-cert: is c.pem, expected --scheduler and an address by TLS beside it, such as tls://10.0.0.1:8786",
        ),
        (
            ("--scheduler", "tcp://a:1", "--insecure", "--tls-key", "k.pem"),
            "--tls-key: is k.pem, expected --scheduler and an address by TLS beside it, such as tls://10.0.0.1:8786",
        ),
        (("--insecure",), "--insecure: expected --scheduler beside it; the processes of this machine are safe"),
    ],
)
def test_options_of_a_cluster_need_one(scenes, tmp_path, monkeypatch, capsys, arguments, sentence):
    assert run(monkeypatch, "batch", scenes, "-o", tmp_path / "out", *arguments) == 2
    assert capsys.readouterr().err == f"fit-material: {sentence}\n"


def test_no_scheduler_there(scenes, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT", 0.2)
    arguments = ("batch", scenes, "-o", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9", "--insecure")
    assert run(monkeypatch, *arguments) == 2
    said = capsys.readouterr().err
    assert said.startswith("fit-material: --scheduler: is tcp://127.0.0.1:9, expected the address of a Dask scheduler")
    assert not (tmp_path / "out").exists()
