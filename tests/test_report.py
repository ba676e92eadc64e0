import base64
import io
import re
from html.parser import HTMLParser

import imageio.v3 as iio
import numpy as np
import pytest
from test_result import gold, result

from fitter.catalogue import metal
from fitter.curves import index_draws, reflectance_curve
from fitter.pictures import LONGEST_SIDE, comparison_png, tiles
from fitter.report import ViewPictures, render_report
from fitter.result import FittedMaterial, Nearest, StandardErrors
from shaders.fresnel import conductor

VOID = {"meta", "img", "path", "use", "br"}


def view(name="a.exr", height=24, width=32, error=0.05):
    photograph = np.random.default_rng(0).random((height, width, 3)).astype(np.float32) + 0.1
    mask = np.zeros((height, width), dtype=bool)
    mask[2:-2, 2:-2] = True
    return ViewPictures(name, photograph * mask[..., None], photograph * np.float32(1 + error), mask)


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
    html = render_report(result(), [view(), view("b.exr", 30, 16)], command="fit-material fit a.toml")
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
    ids = re.findall(r' id="([^"]*)"', render_report(two, []))
    assert len(set(ids)) == len(ids)


def test_strings_of_the_user_are_escaped():
    evil = "<b>&\"'</b>"
    named = gold(name=evil, nearest=(Nearest(name=evil, distance=1),))
    page = Page(render_report(result(materials=(named,), message=evil), [view(evil)], command=evil))
    assert "b" in page.tags  # the page's own, in the table
    assert evil not in render_report(result(materials=(named,), message=evil), [view(evil)], command=evil)
    assert "".join(page.text).count(evil) >= 5


def test_numbers_are_said_in_words():
    text = "".join(Page(render_report(result(), [])).text)
    assert "ball: a metal, nearest to gold (0.8 σ); alpha 0.2000 ± 0.0010 (0.5 %)." in text
    assert "0.150 ± 0.020 (13 %)" in text
    assert "0.110 … 0.190" in text
    assert text.count("not determined") == 1
    assert "2 %" in text
    assert "41 dB" in text


@pytest.mark.parametrize(("status", "words"), [("stopped", "stopped before"), ("not_determined", "do not determine")])
def test_status_in_plain_words(status, words):
    assert words in render_report(result(status=status), [])


def test_materials_without_n_and_k_have_a_curve_and_a_table():
    matte = FittedMaterial(name="wall", type="matte", color=(0.5, 0.5, 0.5), reflectance=(0.04, 0.04, 0.04))
    text = "".join(Page(render_report(result(materials=(matte,)), [])).text)
    assert "wall: matte." in text
    assert "diffuse colour" in text


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


def with_errors_of(n, k, covariance) -> FittedMaterial:
    """A metal whose three standard errors follow from a covariance of n and k, alike in all channels."""
    denominator = ((n + 1) ** 2 + k**2) ** 2  # of F0; its slopes are 4(n²-k²-1)/… and 8nk/…
    slope = np.array([4 * (n**2 - k**2 - 1), 8 * n * k]) / denominator
    f0 = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
    sigma = [*np.sqrt(np.diag(covariance)), np.sqrt(slope @ covariance @ slope)]
    errors = StandardErrors(**{key: (s,) * 3 for key, s in zip(("n", "k", "f0"), sigma, strict=True)})
    return FittedMaterial(name="m", type="metal", n=(n,) * 3, k=(k,) * 3, f0=(f0,) * 3, stderr=errors)


@pytest.mark.parametrize("correlation", [-0.9, 0.0, 0.95])
def test_band_is_that_of_the_whole_covariance(correlation):
    import torch

    n, k, sigma_n, sigma_k = 2.9, 3.1, 0.02, 0.03  # iron
    c = correlation * sigma_n * sigma_k
    covariance = np.array([[sigma_n**2, c], [c, sigma_k**2]])
    curve = reflectance_curve(with_errors_of(n, k, covariance), "conductor")
    draws = torch.from_numpy(np.random.default_rng(1).multivariate_normal([n, k], covariance, 20000))
    for degrees in (0, 60, 80):
        cos_d = torch.tensor(np.cos(np.radians(degrees)))
        spread = 1.96 * conductor(cos_d, draws[:, 0], draws[:, 1]).std()
        half = (curve.high - curve.low)[degrees] / 2
        assert half == pytest.approx(float(spread), rel=0.2)  # 400 draws know a 97.5 % quantile to 8 %


def test_without_errors_of_n_every_n_of_this_f0_is_drawn():
    gold_ = metal("Au")
    fitted = gold(n=gold_.n, k=gold_.k, stderr=StandardErrors(f0=(0.0, 0.0, 0.0)))
    r, n = index_draws(fitted, np.random.default_rng(0))
    assert np.ptp(r, axis=0).max() == 0
    limit = (1 + np.sqrt(r[0])) / (1 - np.sqrt(r[0]))
    assert (n.min(axis=0) < 1.2 / limit + 0.02 * limit).all()
    assert (n.max(axis=0) > 0.97 * limit).all()


def test_schlick_form_knows_f0_only():
    curve = reflectance_curve(gold(), "lazanyi")
    f0 = np.array(gold().f0)
    assert curve.value[0] == pytest.approx(f0)
    assert curve.value[60] == pytest.approx(f0 + (1 - f0) / 32)
    assert curve.value[90] == pytest.approx(1)
    assert (curve.high - curve.low)[0] == pytest.approx(2 * 1.96 * 0.002, rel=0.2)
