"""What the benchmark of many scenes makes of a log, and its ratios."""

import json
from collections import Counter

from fit_material.fitter.result.schema import write_result
from tests.bench import batch
from tests.bench.batch import Batched
from tests.fitter.result.test_schema import result


def test_a_log_is_counted(tmp_path):
    """Three in 20 s are two from the first to the last: 360 an hour; one was taken over twice, one cannot be read."""
    lines = [("scene-000", 0, 1), ("scene-001", 10, 2), ("scene-000", 20, 1)]
    with open(tmp_path / "fits.jsonl", "w") as log:
        for name, second, starts in lines:
            told = {"time": f"2026-01-01T00:00:{second:02}.000+00:00", "name": name, "starts": starts}
            log.write(json.dumps(told) + "\n")
    for name, _, _ in lines:
        (tmp_path / name).mkdir(exist_ok=True)
        (tmp_path / name / "result.json").write_text("{")
    write_result(result(), tmp_path / "scene-001" / "result.json")
    found = batch._batched(1, 40.0, "scene-001", tmp_path)
    assert (found.rate, found.taken, found.whole) == (360.0, Counter({"scene-000": 2, "scene-001": 1}), 1)
    assert found.starts == {"scene-000": 1, "scene-001": 2}
    assert list(batch._killed(found, 3))[2] == "| 3 | 1 | 1 | 1 | 1 | 40 s |"


def test_ratios_are_of_the_same_scenes():
    """By hand: 2 and 1.5 times one worker's rate in two rounds; commands of half and of 0.8 of its seconds."""
    starts = {"a": 1, "b": 1}
    made = [[(100.0, 72.0), (200.0, 36.0), (100.0, 72.0)], [(200.0, 36.0), (300.0, 28.8), (200.0, 36.0)]]
    rounds = [[Batched(0, seconds, rate, "", Counter(starts), starts, 2) for rate, seconds in each] for each in made]
    *_, two, _ = batch._throughput(rounds)
    assert two == "| 2 of 1 core | 250 (200 … 300) | 1.75 (1.5 … 2) | 225 (200 … 250) | 1.62 (1.25 … 2) |"
