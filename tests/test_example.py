"""The example beside the packages, which users copy."""

import runpy
from pathlib import Path

from test_result import gold, result

EXAMPLE = Path(__file__).parents[1] / "examples" / "read_result.py"


def test_numbers_without_an_interval_are_not_determined(tmp_path):
    material = gold()
    unknown = {"alpha": None}
    parts = {
        "stderr": material.stderr.model_copy(update=unknown),
        "interval95": material.interval95.model_copy(update=unknown),
        "determined": material.determined.model_copy(update={"alpha": False}),
    }
    path = tmp_path / "result.json"
    path.write_text(result(materials=(gold(**parts),)).model_dump_json(), encoding="utf-8")
    told = runpy.run_path(str(EXAMPLE))["report"](path)
    assert "∎" in told
    assert "  alpha is not determined" in told.splitlines()
    assert "None" not in told
