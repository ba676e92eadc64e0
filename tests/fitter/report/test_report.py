import base64
import io
import re
from html.parser import HTMLParser

import imageio.v3 as iio
import numpy as np
import pytest
import torch

from fit_material.fitter.least_squares.covariance import Covariance
from fit_material.fitter.materials.coordinates import WidthInterval
from fit_material.fitter.materials.metal import MetalCoordinates
from fit_material.fitter.report.outlier_map import OutlierMap
from fit_material.fitter.report.pictures import LONGEST_SIDE, comparison_png, tiles
from fit_material.fitter.report.reflectance_curve import Curve, reflectance_curve
from fit_material.fitter.report.report import ViewPictures, render_report
from fit_material.fitter.result.schema import Determined, FittedMaterial, FromPrior, Nearest, Nuisance, Quality, Share
from fit_material.renderer.materials.catalogue import metal
from fit_material.shaders.materials.fresnel_models import exact_reflectance, viewer_reflectance
from fit_material.shaders.materials.types import Metal
from fit_material.shaders.materials.widths import Microfacet
from fit_material.shaders.optics import fresnel
from tests.fitter.result.test_schema import gold, result

VOID = {"meta", "img", "path", "use", "br"}


def view(name="a.exr", height=24, width=32, error=0.05):
    photograph = np.random.default_rng(0).random((height, width, 3)).astype(np.float32) + 0.1
    mask = np.zeros((height, width), dtype=bool)
    mask[2:-2, 2:-2] = True
    return ViewPictures(name, photograph * mask[..., None], photograph * np.float32(1 + error), mask)


def flat_curve(value=0.5) -> Curve:
    theta = np.linspace(0, 90, 91)
    middle = np.full((91, 3), value)
    return Curve(theta, middle, middle - 0.1, middle + 0.1)


def page_of(result, views=(), *, command="") -> str:
    """The report with a curve for every material."""
    return render_report(result, views, [flat_curve()] * len(result.materials), command=command)


class Page(HTMLParser):
    """What a browser would load, show and run."""

    def __init__(self, html: str):
        super().__init__()
        self.tags, self.images, self.references, self.text, self.open = [], [], [], [], []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        for key, value in attrs:
            if key in ("src", "href", "xlink:href", "action", "data", "srcset"):
                (self.images if tag == "img" else self.references).append(value)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.handle_endtag(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def decoded(uri):
    header, data = uri.split(",")
    assert header == "data:image/png;base64"
    return iio.imread(io.BytesIO(base64.b64decode(data)), extension=".png")


def test_page_loads_nothing_and_shows_every_picture():
    html = page_of(result(), [view(), view("b.exr", 30, 16)], command="fit-material fit a.toml")
    page = Page(html)
    assert page.open == []
    assert all(reference.startswith("#") for reference in page.references)
    assert not re.search(r"https?:|//\w+\.|@import|url\((?!#)", html)
    assert not {"script", "link", "iframe", "object"} & set(page.tags)
    sizes = [decoded(uri).shape for uri in page.images]
    assert sizes == [(24, 32, 4)] * 3 + [(30, 16, 4)] * 3
    assert page.tags.count("svg") == 1


def test_ids_in_the_page_are_used_once():
    two = result(materials=(gold(), gold(name="other", n=(1.0, 1.1, 1.2))))
    ids = re.findall(r' id="([^"]*)"', page_of(two))
    assert len(set(ids)) == len(ids)


def test_strings_of_the_user_are_escaped():
    evil = "<b>&\"'</b>"
    named = gold(name=evil, nearest=(Nearest(name=evil, distance=1),))
    page = Page(page_of(result(materials=(named,), message=evil), [view(evil)], command=evil))
    assert "b" in page.tags  # the page's own, in the table
    assert evil not in page_of(result(materials=(named,), message=evil), [view(evil)], command=evil)
    assert "".join(page.text).count(evil) >= 5


def test_numbers_are_said_in_words():
    text = "".join(Page(page_of(result())).text)
    assert "ball: a metal, nearest to gold (0.8 σ); alpha 0.2000 ± 0.0010 (0.5 %)." in text
    assert "0.150 ± 0.020 (13 %)" in text
    assert "0.110 … 0.190" in text
    assert text.count("not determined") == 1
    assert "2 %" in text
    assert "41 dB" in text


def test_the_time_is_told_for_what_it_is():
    """The page's own making, which `result.json` counts, is not in it."""
    html = page_of(result())
    assert "<dt>time until this page</dt><dd>10 s</dd>" in html
    assert "<h2>Where the time went, until this page</h2>" in html


@pytest.mark.parametrize("status", ["converged", "stopped", "not_determined"])
def test_the_verdict_is_the_message_in_the_colour_of_the_status(status):
    html = page_of(result(status=status, message="So it ended."))
    assert f'<p class="verdict {status}">So it ended.</p>' in html
    assert ".verdict.converged::before { background: var(--good)" in html  # any other keeps the warning colour


def test_materials_without_n_and_k_have_a_curve_and_a_table():
    matte = FittedMaterial(name="wall", type="matte", color=(0.5, 0.5, 0.5), reflectance=(0.04, 0.04, 0.04))
    text = "".join(Page(page_of(result(materials=(matte,)))).text)
    assert "wall: matte." in text
    assert "diffuse colour" in text


def test_dashed_curves_are_explained_where_there_are_some():
    alike = gold(nearest=(Nearest(name="Au", distance=1.0),))
    assert "Known metals are dashed." in page_of(result(materials=(alike,)))
    assert "Known metals are dashed." not in page_of(result(materials=(gold(nearest=()),)))


def test_large_photographs_are_averaged_down():
    (row,) = tiles([view(height=4, width=2 * LONGEST_SIDE + 1)])
    assert row.fit.shape == (1, (2 * LONGEST_SIDE + 1) // 3, 4)


def test_difference_is_signed_and_masked():
    brighter, equal, darker = (tiles([view(error=error)])[0].difference for error in (0.08, 0, -0.08))
    assert brighter[5, 5, 0] > brighter[5, 5, 2]  # red
    assert darker[5, 5, 0] < darker[5, 5, 2]  # blue
    assert np.ptp(equal[5, 5, :3].astype(int)) <= 1
    assert brighter[0, 0, 3] == 0


def test_comparison_is_one_png():
    picture = iio.imread(io.BytesIO(comparison_png([view(), view("b", 30, 16)], gap=4)), extension=".png")
    assert picture.shape == (24 + 4 + 30, 3 * 32 + 2 * 4, 4)


COORDINATES = MetalCoordinates(WidthInterval(0.1, 0.4, logarithmic=True))


def metal_of(name, roughness=0.2) -> Metal:
    known = metal(name)
    n, k, alpha = (torch.tensor(each, dtype=torch.float64) for each in (known.n, known.k, roughness))
    return Metal(n, k, Microfacet(alpha))


def some_covariance(size, scale) -> torch.Tensor:
    """A covariance with correlations of all signs, `scale` the standard deviation of its directions."""
    factor = torch.randn(size, size, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    return scale**2 / size * factor @ factor.T


@pytest.mark.parametrize("form", ["conductor", "lazanyi"])
@pytest.mark.parametrize("name", ["Au", "Fe"])
def test_band_holds_what_the_covariance_allows(name, form):
    """Where errors are small, the band of first order is that of draws of the free vector itself."""
    reflectance = getattr(fresnel, form)
    of_material = {"conductor": exact_reflectance, "lazanyi": viewer_reflectance}[form]
    x = COORDINATES.free(metal_of(name))
    covariance = some_covariance(len(x), scale=0.01)
    curve = reflectance_curve(of_material, COORDINATES, x, Covariance(covariance))
    count = 20000
    draws = torch.distributions.MultivariateNormal(x, covariance, validate_args=False)
    torch.manual_seed(0)
    n, k = torch.vmap(lambda free: (COORDINATES.material(free).n, COORDINATES.material(free).k))(draws.sample((count,)))
    for degrees in (0, 30, 60, 80, 88):
        cos_d = torch.cos(torch.deg2rad(torch.tensor(degrees, dtype=torch.float64)))
        drawn = reflectance(cos_d, n, k)
        half = (curve.high - curve.low)[degrees] / 2
        # a standard deviation of 20000 draws is known to 1/√(2·20000) = 0.5 %; 1 % of x bends the curves by as much
        np.testing.assert_allclose(half, 1.959964 * drawn.std(0), rtol=0.03)
        np.testing.assert_allclose(curve.value[degrees], drawn.median(0).values, atol=0.03 * half.max())


def test_band_stays_a_reflectance_where_nothing_is_determined():
    x = COORDINATES.free(metal_of("Ag"))
    curve = reflectance_curve(exact_reflectance, COORDINATES, x, Covariance(some_covariance(len(x), 1e3)))
    assert (curve.low >= 0).all()
    assert (curve.high <= 1).all()
    assert (curve.low <= curve.value).all()
    assert (curve.value <= curve.high).all()


@pytest.mark.parametrize("name", ["Au", "Al", "Fe"])
def test_curve_is_the_metals_own(name):
    x = COORDINATES.free(metal_of(name))
    curve = reflectance_curve(exact_reflectance, COORDINATES, x, Covariance(torch.zeros(len(x), len(x)).double()))
    n, k = (np.array(getattr(metal(name), key)) for key in ("n", "k"))
    np.testing.assert_allclose(curve.value[0], ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2), rtol=1e-9)
    np.testing.assert_allclose(curve.value[90], 1, atol=1e-9)
    assert curve.theta.tolist() == list(range(91))
    np.testing.assert_array_equal(curve.low, curve.high)


def test_two_photographs_of_one_name_keep_their_own_numbers():
    of = {"name": "a", "psnr": 40.0, "ssim": None}
    photographs = ({**of, "rms_relative": 0.0123}, {**of, "rms_relative": 0.0456})
    quality = {"overall": {"rms_relative": 0.02, "psnr": 41.0, "ssim": None}, "photographs": photographs}
    html = page_of(result(quality=Quality.model_validate(quality)), [view("a"), view("a")])
    first, second = html.split("<figcaption>")[1:3]
    assert "<b>1. a</b>" in first
    assert "1.23" in first
    assert "<b>2. a</b>" in second
    assert "4.56" in second.partition("</figcaption>")[0]


def test_numbers_of_the_catalogue_are_marked():
    taken = FromPrior(n=(False, False, True), k=(False,) * 3, metals=(Share(name="gold", share=1.0),))
    found = gold(n=(0.15, 0.43, 1.4), determined=Determined(n=(True, True, False)), from_prior=taken)
    html = page_of(result(materials=(found,)))
    assert html.count("from the catalogue") == 1
    assert html.index("1.4") < html.index("from the catalogue") < html.index("extinction coefficient")
    assert "from the catalogue" not in page_of(result())


def test_what_the_fit_does_not_explain_is_shown():
    """A spot in the middle: the fit darker by 20 σ, the blue end of the scale, and without weight."""
    seen = view()
    deviation, weight = np.zeros(seen.mask.shape), np.ones(seen.mask.shape)
    deviation[10:14, 10:14], weight[10:14, 10:14] = -20.0, 0.0
    spotted = OutlierMap("a.exr", seen.photograph, deviation, weight, seen.mask, 0.03)
    page = Page(render_report(result(), [], [flat_curve()], outliers=[spotted]))
    _, deviations, weights = (decoded(uri) for uri in page.images)
    assert deviations[12, 12, 2] > deviations[12, 12, 0] + 50
    assert np.ptp(deviations[5, 5, :3].astype(int)) < 10  # no deviation is white
    assert deviations[0, 0, 3] == 0  # nothing outside the mask
    assert weights[12, 12, :3].astype(int).sum() < weights[5, 5, :3].astype(int).sum() - 300
    assert "3 % beyond 6 σ" in "".join(page.text)


def test_what_was_fitted_beside_the_material_is_shown():
    record = Nuisance(
        name="white_balance",
        photograph="view_0",
        channel="red",
        value=1.41,
        stderr=0.02,
        interval95=(1.37, 1.45),
        determined=True,
        before95=(0.55, 1.8),
        by_surroundings=True,
    )
    text = " ".join("".join(Page(page_of(result(nuisances=(record,)))).text).split())
    assert "white balance, red view_0 1.41 ± 0.02 1.37 … 1.45 0.55 … 1.8, by what is seen behind the object" in text
    assert "Fitted beside the material" not in page_of(result())
