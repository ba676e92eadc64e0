"""Python in a process of its own, for what may end a process: with the modules of this one, in an empty folder."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping


def run_python(*arguments: str, timeout: float, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run to its end what `python` takes for arguments.

    Args:
        timeout: seconds, after which it is killed.
        environment: variables beside those of this process.

    Raises:
        OSError: no process can be started, or there is no folder for temporary files.
        subprocess.TimeoutExpired: it did not end.
    """
    modules = os.pathsep.join(path for path in sys.path if os.path.isabs(path))
    variables: Mapping[str, str] = {**os.environ, "PYTHONPATH": modules, **environment}
    with tempfile.TemporaryDirectory(prefix="fit-material-") as folder:  # where a core dump would be written, too
        return subprocess.run(
            [sys.executable, "-P", *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout,
            check=False,
            env={**variables, "DRJIT_CACHE_DIR": folder},  # no kernels of another compiler
            cwd=folder,
        )
