"""The result of a fit, as `result.json` holds it: strict JSON, full precision, format 1.

A number that does not exist is null: a matte material has no `n`, a parameter that the photographs do not
determine may have no standard error. NaN and Infinity are refused on the way out and on the way in.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import AfterValidator, ConfigDict, Field, model_validator

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.errors.printable import unicode_text
from fit_material.renderer.files.atomic import write_text_atomically
from fit_material.renderer.files.regular_files import read_text
from fit_material.renderer.files.validation import Checked, check, known_name, require_plain, unexpected
from fit_material.shaders.materials.kinds import KINDS, MaterialType

FORMAT = 1
CHANNELS = ("red", "green", "blue")
Status = Literal["converged", "not_determined", "stopped"]

T = TypeVar("T")


def _in_order(interval: tuple[float, float]) -> tuple[float, float]:
    low, high = interval
    if low > high:
        raise unexpected("an interval [low, high] with low ≤ high")
    return interval


NonNegative = Annotated[float, Field(ge=0)]
Interval = Annotated[tuple[float, float], AfterValidator(_in_order)]


class Record(Checked):
    """A part of the result: cannot be changed, knows its keys, holds finite numbers only."""

    model_config = ConfigDict(strict=False)  # JSON and numpy have lists where we have tuples

    @model_validator(mode="before")
    @classmethod
    def _in_unicode(cls, data: Any) -> Any:
        """Names of files may hold what JSON in UTF-8 cannot."""
        if not isinstance(data, dict):
            return data
        return {key: unicode_text(value) if isinstance(value, str) else value for key, value in data.items()}


class PerParameter(Record, Generic[T]):
    """One T for each number of a material, under the parameter's name; None where it has none.

    Attributes:
        n, k: refractive index n + ik relative to air at the three channels, unitless; metals only.
        f0: reflectance at normal incidence per channel, in [0, 1]; metals and glossy materials.
        alpha: microfacet width, Mitsuba's; 0 is a mirror.
        roughness: ρ, the thesis's blur radius, the viewer's number; 0 is a mirror.
        color: diffuse colour, linear Rec. 709, in [0, 1]; glossy and matte materials.
        reflectance: f of `schlick` per channel, in [0, 1]; glossy and matte materials.
    """

    n: tuple[T, T, T] | None = None
    k: tuple[T, T, T] | None = None
    f0: tuple[T, T, T] | None = None
    alpha: T | None = None
    roughness: T | None = None
    color: tuple[T, T, T] | None = None
    reflectance: tuple[T, T, T] | None = None


StandardErrors = PerParameter[NonNegative | None]
Intervals = PerParameter[Interval | None]
Determined = PerParameter[bool | None]


class Nearest(Record):
    """A known material, and how far from it the fit is, in standard errors σ of the fit."""

    name: str
    distance: NonNegative


class Share(Record):
    """A known material, and its share of what was taken from known ones."""

    name: str
    share: Annotated[float, Field(ge=0, le=1)]


class FromPrior(Record):
    """Which numbers come from known metals and not from the photographs.

    Attributes:
        n, k: per channel; unmarked ones are the photographs' own.
        metals: those they come from, the greatest share first; metals unknown to the catalogue have the rest.
        photographs95: intervals of n and k by the photographs alone.
    """

    n: tuple[bool, bool, bool]
    k: tuple[bool, bool, bool]
    metals: tuple[Share, ...]
    photographs95: Intervals = Intervals()


Coefficient = Annotated[float, Field(ge=-1, le=1)]


class Correlation(Record):
    """How the errors of a material's numbers go together, to first order.

    Attributes:
        numbers: those that have standard errors, such as "n of red".
        coefficients: of each with each, in [-1, 1]; symmetric, 1 on the diagonal.
    """

    numbers: tuple[str, ...]
    coefficients: tuple[tuple[Coefficient, ...], ...]

    @model_validator(mode="after")
    def _is_square(self) -> Correlation:
        count = len(self.numbers)
        if [len(row) for row in self.coefficients] != [count] * count:
            raise unexpected("as many rows and columns of coefficients as numbers")
        return self


def _png_beside(name: str) -> str:
    if not re.fullmatch(r"[^/\\.][^/\\]*\.png", name):
        raise unexpected("the name of a .png file, without folders in it")
    return name


PngBeside = Annotated[str, AfterValidator(_png_beside)]


class Maps(Record):
    """Texture files of a material, in the folder of `result.json`.

    Attributes:
        color: the body's colour, sRGB; multiplies nothing: where there is one, `color` is its mean.
        color_seen: how many photographs see each of its texels; 0 where it was filled.
    """

    color: PngBeside
    color_seen: PngBeside


KnownType = Annotated[MaterialType, known_name(lambda: KINDS)]
"""Name of a type of material."""


class _Named(Record):
    name: str
    type: KnownType


class FittedMaterial(PerParameter[float], _Named):
    """One material as fitted: its numbers, their 1 σ standard errors and 95 % intervals.

    Attributes:
        name: as the mesh's file calls it.
        type: which of the model's materials (MODEL.md, 4).
        determined: whether the photographs determine the number.
        nearest: known materials, nearest first.
        from_prior: the numbers that known metals stand in for; None where all are the photographs'. Their errors and
            intervals are the prior's, too; `determined` remains the photographs' verdict.
        correlation: of the photographs' own errors; None where fewer than two numbers have them.
        maps: texture files that were made; None, and not in the file, where there are none.
    """

    stderr: StandardErrors = StandardErrors()
    interval95: Intervals = Intervals()
    determined: Determined = Determined()
    nearest: tuple[Nearest, ...] = ()
    from_prior: FromPrior | None = None
    correlation: Correlation | None = None
    maps: Maps | None = None


class PictureQuality(Record):
    """How alike photograph and fit are (`fitter.report.image_quality` defines the three); None where not computable.

    Attributes:
        rms_relative: root mean square difference over root mean square radiance, unitless.
        psnr: peak signal-to-noise ratio of the tone-mapped pictures, dB.
        ssim: structural similarity of the tone-mapped pictures, in [-1, 1].
    """

    rms_relative: NonNegative | None
    psnr: float | None
    ssim: float | None


class PhotographQuality(PictureQuality):
    """The quality of one photograph, by its `name`."""

    name: str


class Quality(Record):
    """Quality per photograph, and of all together."""

    overall: PictureQuality
    photographs: tuple[PhotographQuality, ...] = ()


class Model(Record):
    """What was computed: the fidelity and what it stood for (MODEL.md, 6).

    Attributes:
        reflectance: Fresnel form, such as "conductor" or "schlick".
        lobe: such as "ggx", "beckmann", "gaussian", "taps".
        samples: directions per pixel and roughness.
        pixels: how many pixels, of all photographs together, were fitted.
        dtype: of the light tables, "float32" or "float64".
        levels: of roughness in the last table; None in results that older versions wrote.
        environment_size: columns of the environment map that light was integrated from; None as above.
    """

    fidelity: str
    reflectance: str
    lobe: str
    samples: Annotated[int, Field(ge=0)]
    pixels: Annotated[int, Field(ge=0)]
    dtype: str
    levels: Annotated[int, Field(ge=1)] | None = None
    environment_size: Annotated[int, Field(ge=1)] | None = None


class Effect(Record):
    """One of DESIGN.md's effects: whether it was simulated, and the measured reason."""

    name: str
    on: bool
    why: str


class Rung(Record):
    """One of the efforts by which a fit climbed towards a tolerance.

    Attributes:
        pixels, samples, levels: fitted, per pixel and level, of roughness.
        movement: how far a determined number may still move, relative, the most of all; None where none is determined.
        of: that number.
        seconds: since the first effort began.
    """

    pixels: Annotated[int, Field(ge=0)]
    samples: Annotated[int, Field(ge=0)]
    levels: Annotated[int, Field(ge=0)]
    movement: NonNegative | None
    of: str | None
    seconds: NonNegative


class Tolerance(Record):
    """How one material's fit met the requested tolerance, or why it did not.

    Attributes:
        material: its name.
        asked: relative.
        reached: whether no determined number is expected to move by more.
        hopeless: numbers that no effort brings so far: the photographs' own noise leaves more.
        rungs: the efforts, the last one's numbers reported.
    """

    material: str
    asked: NonNegative
    reached: bool
    hopeless: tuple[str, ...]
    rungs: tuple[Rung, ...]


class Nuisance(Record):
    """A factor between radiance and photographs, or the environment's rotation, that was fitted beside the material.

    Attributes:
        name: the key of the scene file.
        photograph: its name; None of a factor of all photographs.
        channel: "red" or "blue" of a white balance, whose green is 1.
        value, stderr, interval95, determined: as of a material's numbers.
        before95: where 95 % of its prior lie, which is log-normal, and normal for the rotation.
        by_surroundings: whether the background determined it before the object's pixels were used.
    """

    name: Literal["exposure", "white_balance", "scale", "rotation"]
    photograph: str | None
    channel: Literal["red", "green", "blue"] | None
    value: float
    stderr: NonNegative
    interval95: Interval
    determined: bool
    before95: Interval
    by_surroundings: bool


class Time(Record):
    """Wall-clock seconds of each part; `total` holds start-up and the rest as well."""

    load: NonNegative
    prepare: NonNegative
    solve: NonNegative
    report: NonNegative
    total: NonNegative


class RefinedCamera(Record):
    """A camera that `--refine-pose` moved.

    Attributes:
        name: of the photograph.
        degrees, percent: by how much it was rotated, and shifted, of its distance from the object's middle.
        stderr_degrees, stderr_percent: remaining standard errors.
        matrix: camera to world, as `scene.toml` has it.
    """

    name: str
    degrees: NonNegative
    percent: NonNegative
    stderr_degrees: NonNegative
    stderr_percent: NonNegative
    matrix: tuple[tuple[float, float, float, float], ...]


class InputFile(Record):
    """A file that was read, and the SHA-256 of its bytes in lower-case hexadecimal."""

    path: str
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class OutputFile(Record):
    """A file that was written, relative to the folder of `result.json`, and the SHA-256 that it then had."""

    path: str
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class Result(Record):
    """All that a fit found, and what it was found from; the content of `result.json`.

    Attributes:
        message: one sentence for a person, with the reason for the status.
        exposure: pixel value per radiance, one for each photograph.
        tolerance: of each material; None, and not in the file, where none was requested.
        nuisances: parameters fitted beside the material; None, and not in the file, where there were none.
        cameras: of each photograph, as they were moved; None, and not in the file, where that was not requested.
        outputs: the files written beside `result.json`; None in results that older versions wrote.
        earlier_outputs: those of earlier fits into the same folder that are still as they were; None, and not in the
            file, where there are none.
    """

    format: Literal[1] = FORMAT
    status: Status
    message: str
    materials: tuple[FittedMaterial, ...]
    quality: Quality
    exposure: tuple[NonNegative, ...]
    model: Model
    effects: tuple[Effect, ...]
    time: Time
    inputs: tuple[InputFile, ...]
    tolerance: tuple[Tolerance, ...] | None = None
    nuisances: tuple[Nuisance, ...] | None = None
    cameras: tuple[RefinedCamera, ...] | None = None
    outputs: tuple[OutputFile, ...] | None = None
    earlier_outputs: tuple[OutputFile, ...] | None = None


def write_result(result: Result, path: str | Path) -> None:
    """Write `result` as strict JSON, whole or not at all; `read_result` gives it back exactly.

    Raises:
        InputError: the file cannot be written.
    """
    optional = ("tolerance", "nuisances", "cameras", "outputs", "earlier_outputs")
    absent = {key for key in optional if getattr(result, key) is None}
    data = result.model_dump(mode="json", exclude=absent)
    for material in data["materials"]:
        if material["maps"] is None:
            del material["maps"]
    text = json.dumps(data, allow_nan=False, ensure_ascii=False, indent=2)
    write_text_atomically(path, _short_lists_on_one_line(text) + "\n")


def read_result(path: str | Path) -> Result:
    """Read a `result.json` of format 1.

    Raises:
        InputError: the file is missing or no text, is not JSON, or a field in it is wrong or has control characters.
    """
    try:
        data = json.loads(read_text(Path(path), "utf-8"))
    except OSError as error:
        raise InputError(path, expected=f"a result.json that can be read ({error.strerror})") from error
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(path, expected=f"strict JSON in UTF-8 ({error})") from error
    except ValueError:  # Python reads no int of more than 4300 digits
        raise InputError(path, expected="strict JSON without numbers of thousands of digits") from None
    except RecursionError:
        raise InputError(path, expected="JSON without hundreds of lists inside each other") from None
    result = check(Result, data, Path(path))
    told = {key: value for key, value in data.items() if key != "message"}  # that may have lines
    require_plain(told, Path(path))  # names go into scripts and scenes, where a line break ends them
    return result


def _short_lists_on_one_line(text: str) -> str:
    """Put lists without text or objects in them on one line; a raw line break is never inside a string."""
    return re.sub(r"\[\n[^\[\]{}\"]*\]", lambda match: " ".join(match[0].split()), text)
