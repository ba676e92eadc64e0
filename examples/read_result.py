"""Read a result.json: what is known of the materials, and what is not. Usage: read_result.py RESULT.json"""

import json
import sys
from pathlib import Path
from typing import Any

KEYS = ("f0", "n", "k", "color", "reflectance", "alpha", "roughness")  # null where a material has none


def report(path: Path) -> str:
    """A line per number: value ± error where the photographs determine it, else the interval it lies in."""
    result = json.loads(path.read_text(encoding="utf-8"))
    lines = [f"{result['status']}: {result['message']}"]
    for material in result["materials"]:
        like = [f", most like {metal['name']}, {metal['distance']:.1f} σ away" for metal in material["nearest"][:1]]
        lines.append("".join([f"{material['name']}: {material['type']}", *like]))
        for key in (key for key in KEYS if material[key] is not None):
            lines.extend(f"  {key} {text}" for text in _numbers(material, key))
    return "\n".join(lines)


def _numbers(material: dict, key: str) -> list[str]:
    def each(value: Any) -> list:
        if not isinstance(material[key], list):
            return [value]
        return value or [None] * len(material[key])

    parts = (material[key], material["stderr"][key], material["interval95"][key], material["determined"][key])
    rows = zip(*map(each, parts), strict=True)
    return [_told(*row) for row in rows]


def _told(value: float, error: float | None, interval: list[float] | None, known: bool | None) -> str:
    if known and error is not None:
        return f"= {value:.4g} ± {error:.4g}"
    return f"lies in {interval}" if interval else "is not determined"


if __name__ == "__main__":
    print(report(Path(sys.argv[1])))
