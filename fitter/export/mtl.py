"""Writing materials as MTL: the thesis's dialect for our viewer, and the ordinary one for everybody else.

Both are text; numbers are printed `%.9g`, which gives every float32 back exactly. MODEL.md, 5, defines which
readers stumble over what; the order of keys and the spelling of texture lines here follow from that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from fit_material.fitter.export.format import Export, Files
from fit_material.fitter.export.values import front_color, given, number, numbers, scattering_type
from fit_material.fitter.result.schema import FittedMaterial
from fit_material.renderer.files.atomic import in_utf8
from fit_material.renderer.materials.mtl_syntax import written_names
from fit_material.shaders.materials.kinds import Kind, type_codes

Lines = Iterator[str]


@dataclass(frozen=True)
class Maps:
    """Texture files of a material, as written into the MTL: relative to it, None where there is none.

    Attributes:
        color: multiplies the material's colour.
        normal: tangent-space normal map.
        ambient_occlusion: 1 where open, 0 where closed.
    """

    color: str | None = None
    normal: str | None = None
    ambient_occlusion: str | None = None


NO_MAPS: Mapping[str, Maps] = MappingProxyType({})


def thesis_files(export: Export) -> Files:
    """`thesis_mtl` and the colour maps that it names."""
    return {export.file: in_utf8(thesis_mtl(export.materials)), **_color_maps(export)}


def ordinary_files(export: Export) -> Files:
    """`ordinary_mtl` and the colour maps that it names."""
    return {export.file: in_utf8(ordinary_mtl(export.materials)), **_color_maps(export)}


def _color_maps(export: Export) -> Files:
    names = [material.maps.color for material in export.materials if material.maps is not None]
    return {name: export.textures[name] for name in names}


def thesis_mtl(
    materials: Sequence[FittedMaterial],
    codes: Mapping[str, int] | None = None,
    maps: Mapping[str, Maps] = NO_MAPS,
) -> str:
    """Materials in the thesis's dialect [thesis, table 3.2; MODEL.md, 5].

        key   metal         glossy        matte
        Ns    type code     type code     type code
        Ka    k             reflectance   reflectance
        Kd    n             color         color
        Ks    ρ ρ ρ         ρ ρ ρ         0 0 0

    Of a material with a colour map of its own, which holds the whole colour, `Kd` is white.

    Args:
        codes: `Ns` of each type, the thesis's where left out; readers such as Assimp 3.2 need other numbers.
        maps: texture files by the material's name, in place of its own.

    Raises:
        ValueError: a number that the table needs is missing, not finite, or beyond float32.
    """
    type_code = type_codes() if codes is None else codes

    def body(material: FittedMaterial, files: Maps) -> Lines:
        kind = scattering_type(material)
        by_key = {quantity.mtl: quantity.name for quantity in kind.quantities}
        yield f"Ns {_code(type_code, material)}"
        yield _triple("Ka", given(material, by_key["Ka"]))
        yield _triple("Kd", given(material, by_key["Kd"]))
        yield _triple("Ks", [given(material, by_key["Ks"]) if kind.mirrors else 0.0] * 3)
        if files.ambient_occlusion:  # before map_Kd: F3D takes whichever comes last for the colour
            yield _texture("map_Ka", files.ambient_occlusion)
        if files.color:
            yield _texture("map_Kd", files.color)
        if files.normal:
            yield _texture("bump", files.normal)

    return _file(materials, maps, body)


def ordinary_mtl(materials: Sequence[FittedMaterial], maps: Mapping[str, Maps] = NO_MAPS) -> str:
    """Materials for the rest of the world, which takes `Kd` for a colour.

        key     metal      glossy        matte
        Kd      F0         color         color · reflectance, its look from the front
        Ks      F0         reflectance   0 0 0
        Ns      2/alpha² - 2, at most 1000: Blinn's exponent [Walter 2007, §5.2]; 0 for matte
        Pr      √alpha     √alpha        1
        Pm      1          0             0
        illum   3          2             1

    `Ka` is left out: older Blenders take it for the metalness of an `illum 3` material, newer ones read
    `Pm`, and both show a metal. So is the ambient occlusion, which F3D would draw as the colour.

    Args:
        maps: texture files by the material's name, in place of its own.

    Raises:
        ValueError: a number that the table needs is missing, not finite, or beyond float32.
    """

    def body(material: FittedMaterial, files: Maps) -> Lines:
        kind = scattering_type(material)
        highlight = given(material, "reflectance" if kind.has_body else "f0") if kind.mirrors else [0.0] * 3
        front = front_color(material)
        alpha = given(material, "alpha") if kind.mirrors else 1.0
        yield _triple("Kd", front)
        yield _triple("Ks", highlight)
        yield f"Ns {number(_blinn_exponent(alpha))}"
        yield f"Pr {number(math.sqrt(alpha))}"
        yield f"Pm {0 if kind.has_body else 1}"
        yield f"illum {_illumination_model(kind)}"
        if files.color:
            yield _texture("map_Kd", files.color)
        if files.normal:  # Blender gives a bump without -bm the strength 0
            yield _texture("bump -bm 1.0", files.normal)

    return _file(materials, maps, body)


def _code(codes: Mapping[str, int], material: FittedMaterial) -> int:
    if material.type not in codes:
        raise ValueError(f"{material.type} {material.name!r} has no type code, which its file needs")
    return codes[material.type]


def _illumination_model(kind: Kind) -> int:
    """The ordinary `illum`: 1 diffuse, 2 with highlight, 3 with reflection."""
    if not kind.has_body:
        return 3
    return 2 if kind.mirrors else 1


def _blinn_exponent(alpha: float) -> float:
    """Exponent s of Blinn's cosine lobe as wide as a microfacet one, s = 2/alpha² - 2, kept in [0, 1000]."""
    return min(max(2 / max(alpha, 1e-3) ** 2 - 2, 0.0), 1000.0)


def _file(
    materials: Sequence[FittedMaterial],
    maps: Mapping[str, Maps],
    body: Callable[[FittedMaterial, Maps], Lines],
) -> str:
    """The whole file: one `newmtl` block each, an empty line between them, a line break at the end."""
    names = written_names(material.name for material in materials)
    blocks = (
        "\n".join([f"newmtl {name}", *body(*_with_maps(material, maps))])
        for name, material in zip(names, materials, strict=True)
    )
    return "\n\n".join(blocks) + "\n"


def _with_maps(material: FittedMaterial, maps: Mapping[str, Maps]) -> tuple[FittedMaterial, Maps]:
    """A material and its texture files; what has a colour map of its own is white below it."""
    if material.name in maps or material.maps is None:
        return material, maps.get(material.name, Maps())
    return material.model_copy(update={"color": (1.0, 1.0, 1.0)}), Maps(color=material.maps.color)


def _texture(key: str, file: str) -> str:
    """A texture line; whatever stands behind the name would become part of it, so nothing does."""
    if not file.strip() or file != file.strip() or "#" in file or not file.isprintable():
        raise ValueError(f"{key}: {file!r} cannot be a texture's name in an MTL; rename the file")
    return f"{key} {file}"


def _triple(key: str, values: Sequence[float]) -> str:
    """A colour line. Always three numbers: trimesh drops every material of a file where one has fewer."""
    red, green, blue = values
    return f"{key} {numbers((red, green, blue))}"
