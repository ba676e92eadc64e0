"""The scene file: what was photographed, by which cameras, in which light. Checked on reading."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import torch
from jaxtyping import Float
from pydantic import (
    AfterValidator,
    Field,
    PlainSerializer,
    PlainValidator,
    PositiveFloat,
    Strict,
    model_validator,
)
from torch import Tensor

from fit_material.renderer.camera_files.importers import with_cameras
from fit_material.renderer.cameras.camera import Camera, look_at
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.errors.printable import is_unicode
from fit_material.renderer.files.toml import load_toml
from fit_material.renderer.files.validation import (
    UNSHOWN,
    Checked,
    ExistingFile,
    ExistingPath,
    PlainText,
    RigidMotion,
    Vector,
    check,
    existing_path,
    known_name,
    unexpected,
)
from fit_material.renderer.geometry.mesh import Shape, Sphere, read_mesh
from fit_material.renderer.images.image_file import ENCODING, ENCODING_HELP
from fit_material.renderer.scene.fittable_values import (
    FITTED,
    Exposure,
    WhiteBalance,
    exposure_or_word,
    fit_or_nothing,
    rotation_or_fit,
    scale_or_fit,
    turn_of,
    white_balance_or_fit,
)
from fit_material.renderer.scene.lens_spec import LensSpec
from fit_material.renderer.scene.lights import AnyLightSpec
from fit_material.shaders.materials.kinds import KINDS, MaterialType


class GeometrySpec(Checked):
    """`[geometry]`: either a mesh file or a shape known by formula."""

    mesh: ExistingFile | None = None
    shape: Literal["sphere"] | None = None
    smooth: bool = True

    @model_validator(mode="after")
    def _one_of_two(self) -> GeometrySpec:
        if (self.mesh is None) == (self.shape is None):
            raise unexpected('either mesh = "FILE" or shape = "sphere"', value=UNSHOWN)
        return self


class EnvironmentSpec(Checked):
    """`[environment]`: map file or folder of six faces, degrees about +Y, and a factor on the radiance.

    Either may be "fit"; "fit:90" seeks the rotation near 90 degrees.
    """

    map: ExistingPath
    rotation: Annotated[float | str, PlainValidator(rotation_or_fit)] = 0.0
    scale: Annotated[float | Literal["fit"], PlainValidator(scale_or_fit)] = 1.0

    @property
    def start(self) -> tuple[float, float]:
        """Rotation and scale, or where the fit of one that is not known begins."""
        return turn_of(self.rotation)[0], 1.0 if self.scale == FITTED else self.scale


class CameraSpec(Checked):
    """`[photographs.camera]`: a pose, as origin and target or as a matrix, and a projection."""

    origin: Vector | None = None
    target: Vector | None = None
    up: Vector = (0.0, 1.0, 0.0)
    matrix: RigidMotion | None = None
    fov: Annotated[float, Field(ge=0.01, le=179)] = 35.0
    projection: Literal["perspective", "orthographic"] = "perspective"
    scale: PositiveFloat = 1.0
    lens: LensSpec | None = None

    @model_validator(mode="after")
    def _one_lens(self) -> CameraSpec:
        if self.lens is not None and {"fov", "scale", "projection"} & self.model_fields_set:
            raise unexpected("no fov, scale or projection beside it", key="lens", value=UNSHOWN)
        return self

    @model_validator(mode="after")
    def _one_pose(self) -> CameraSpec:
        given = {"origin", "target", "matrix"} & {key for key, value in self if value is not None}
        if given not in ({"origin", "target"}, {"matrix"}):
            found = " and ".join(sorted(given)) or "without a pose"
            raise unexpected("either origin and target, or matrix", value=found)
        if "scale" in self.model_fields_set and self.projection == "perspective":
            raise unexpected('projection = "orthographic" beside it', key="scale", value=self.scale)
        if self.matrix is None and not any(self.up):
            raise unexpected("a direction, not 0", key="up", value=self.up)
        try:
            self.pose()
        except ValueError:
            message = "a point apart from origin, and not straight along up from it"
            raise unexpected(message, key="target", value=self.target) from None
        return self

    def pose(self) -> Float[Tensor, "4 4"]:
        """Camera-to-world matrix, float64."""
        if self.matrix is not None:
            return torch.tensor(self.matrix, dtype=torch.float64)
        origin, target, up = (torch.tensor(v, dtype=torch.float64) for v in (self.origin, self.target, self.up))
        return look_at(origin, target, up)


def _known_encoding(encoding: str) -> str:
    if encoding != FITTED and not ENCODING.fullmatch(encoding):
        raise unexpected(ENCODING_HELP)
    return encoding


AS_IT_IS = PlainSerializer(lambda value: value, return_type=Any)  # pydantic would warn of a tuple among other types


class PhotographSpec(Checked):
    """`[[photographs]]`: an image with its camera, and how its pixels became numbers.

    `images` in place of `image` are several exposures of one view; `image` then is the first of them, and `exposure` a
    number for each, or "exif", which is what it is if it is not given.
    """

    image: ExistingFile
    images: Annotated[tuple[ExistingFile, ...], Strict(False)] = ()
    mask: ExistingFile | None = None
    encoding: Annotated[str, AfterValidator(_known_encoding)] | None = None
    exposure: Annotated[Exposure, PlainValidator(exposure_or_word), AS_IT_IS] = 1.0
    white_balance: Annotated[WhiteBalance, PlainValidator(white_balance_or_fit), AS_IT_IS] = (1.0, 1.0, 1.0)
    camera: CameraSpec

    @model_validator(mode="before")
    @classmethod
    def _image_or_images(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "images" not in data:
            return data
        images = data["images"]
        if not isinstance(images, list | tuple):
            raise unexpected("a list", key="images", value=images)
        if "image" in data or not images:
            raise unexpected("either image, or images with at least one", key="images", value=UNSHOWN)
        return {"exposure": "exif", **data, "image": images[0]}

    @model_validator(mode="after")
    def _an_exposure_each(self) -> PhotographSpec:
        count = len(self.exposure) if isinstance(self.exposure, tuple) else None
        if self.images and self.exposure != "exif" and (count or 1) != len(self.images):
            raise unexpected(f'a list of {len(self.images)} numbers, or "exif"', key="exposure", value=self.exposure)
        if self.encoding == FITTED and len(self.images) < 2:
            raise unexpected("images of several exposures beside it, or a curve", key="encoding", value=FITTED)
        if count is not None and not self.images:
            raise unexpected("one number, or images with as many", key="exposure", value=self.exposure)
        return self

    @property
    def files(self) -> tuple[Path, ...]:
        """Image or images, and the mask if there is one."""
        return (*(self.images or (self.image,)), *([self.mask] if self.mask else []))


class MaterialSpec(Checked):
    """`[[materials]]`: what to take for given, by the mesh's material name; maps are laid over texture coordinates."""

    name: PlainText
    type: Annotated[MaterialType, known_name(lambda: ("auto", *KINDS))] = "auto"
    normal_map: ExistingFile | None = None
    ambient_occlusion_map: ExistingFile | None = None


class Scene(Checked):
    """A whole scene file. Every path is joined to the file's folder, and every photograph has its camera.

    `exposure` and `white_balance` are "fit" where one factor on all photographs is to be fitted, beside their own.
    """

    cameras: ExistingPath | None = None
    exposure: Annotated[Literal["fit"] | None, PlainValidator(fit_or_nothing)] = None
    white_balance: Annotated[Literal["fit"] | None, PlainValidator(fit_or_nothing)] = None
    geometry: GeometrySpec
    environment: EnvironmentSpec
    lights: Annotated[tuple[AnyLightSpec, ...], Strict(False)] = ()
    photographs: Annotated[tuple[PhotographSpec, ...], Strict(False), Field(min_length=1)]
    materials: Annotated[tuple[MaterialSpec, ...], Strict(False)] = ()

    @model_validator(mode="after")
    def _one_unknown_factor(self) -> Scene:
        for key in ("exposure", "white_balance"):
            if getattr(self, key) == FITTED and all(getattr(each, key) == FITTED for each in self.photographs):
                raise unexpected("it here or in each of the photographs, not both", key=key, value=FITTED)
        if self.environment.scale != FITTED:
            return self
        if self.exposure == FITTED or all(each.exposure == FITTED for each in self.photographs):
            raise unexpected(
                "a number: exposures are fitted, and twice the one is half the other",
                key="environment.scale",
                value=FITTED,
            )
        if self.lights:
            expected = 'a number, and exposure = "fit" at the top: the [[lights]] would stay as they are'
            raise unexpected(expected, key="environment.scale", value=FITTED)
        return self


def read_scene(path: str | Path) -> Scene:
    """Read and check `scene.toml`, and the file of cameras that it may name.

    Raises:
        InputError: about the first thing that is wrong: file, field, value and what was expected.
    """
    path = Path(path)
    if not is_unicode(str(path)):  # as our results are, and all that readers of pictures take
        raise InputError(path, expected="a path in UTF-8; rename its folder, or name the scene from within it")
    data = load_toml(path)
    cameras = data.get("cameras")
    found = existing_path(cameras, path.parent)
    if found is not None:
        data = {**data, "photographs": with_cameras(path, data.get("photographs"), found)}
    return check(Scene, data, path)


def camera_of(spec: CameraSpec, width: int, height: int) -> Camera:
    """The camera of a photograph of `width` × `height` pixels."""
    if spec.lens is None or spec.lens.is_pinhole:
        fov = spec.fov if spec.lens is None else spec.lens.fov
        return Camera(spec.pose(), width, height, spec.projection, fov, spec.scale)
    return Camera(spec.pose(), width, height, fov=spec.lens.fov, lens=spec.lens.lens(width, height))


def read_shape(spec: GeometrySpec) -> Shape:
    """The object's shape; reads its mesh file where it has one.

    Raises:
        InputError: as `read_mesh`.
    """
    return Sphere() if spec.mesh is None else read_mesh(spec.mesh, spec.smooth)
