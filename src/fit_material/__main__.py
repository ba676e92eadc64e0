"""The program `fit-material`: Ctrl-C is quiet from the start, while the commands are being imported."""

from __future__ import annotations

import os
import signal
from typing import NoReturn


def program() -> NoReturn:
    """See `fitter.commands.app.program`."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # `nohup` and shells' background ignore it
        signal.signal(signal.SIGINT, lambda *_: os._exit(128 + signal.SIGINT))
    from fit_material.fitter.commands import app

    app.program()


if __name__ == "__main__":
    program()
