"""Where the project lies."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "src"  # for PYTHONPATH
SHARED = ROOT.parent / "shared" / "data"  # real input beside the project; absent where it was cloned alone
