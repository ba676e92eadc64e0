"""What the benchmarks compute themselves: their photographs' noise, and the bound that fits are held against."""

import json

import pytest

from renderer.synth import SynthOptions, synthesise
from renderer.truth import TrueMetal
from tests.bench import photographs

GOLD = TrueMetal((0.146, 0.425, 1.431), (3.578, 2.326, 1.85), alpha=0.2)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setattr(photographs, "CACHE", tmp_path / "cache")
    return tmp_path / "cache"


def test_noise_put_on_kept_photographs_is_what_synth_would_have_made(tmp_path, cache, monkeypatch):
    options = SynthOptions(GOLD, views=2, size=8, spp=4, noise=0.01, seed=7, variant="scalar_rgb")
    made = synthesise(options, tmp_path / "made").parent
    clean = photographs.photographed(SynthOptions(GOLD, views=2, size=8, spp=4, seed=7, variant="scalar_rgb"), "gold")
    monkeypatch.setattr(photographs, "synthesise", None)  # no path is traced again
    kept = photographs.photographed(options, "gold").parent
    names = sorted(path.name for path in made.iterdir())
    assert sorted(path.name for path in kept.iterdir()) == names
    for name in names:
        assert (kept / name).read_bytes() == (made / name).read_bytes(), name
    assert json.loads(clean.with_name("truth.json").read_text())["noise"] == 0
