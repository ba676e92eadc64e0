"""What a fit says that it simulated, and why."""

import pytest

from fitter.effects import effects_of
from fitter.fidelity import preset


@pytest.mark.parametrize(
    ("types", "on", "why"),
    [
        (["metal"], True, "n and k differ in it alone"),
        (["glossy", "matte", "metal"], True, "n and k differ in it alone"),
        (["glossy"], True, "a dielectric's for glossy materials"),
        (["matte"], False, "the materials are matte, which mirror nothing"),
    ],
)
def test_exact_fresnel_is_on_where_something_mirrors(types, on, why):
    effect = _effects(types)["exact-fresnel"]
    assert (effect.on, effect.why) == (on, why)


def test_one_light_is_told_in_the_singular():
    assert _effects(["glossy"], lights=1)["light-reflection"].why == "1 directional light"
    assert _effects(["glossy"], lights=2)["light-reflection"].why == "2 directional lights"


def _effects(types, lights=0):
    return {effect.name: effect for effect in effects_of(preset("preview", "ggx"), types, lights, 0.0)}
