"""Reading materials from MTL files, of the thesis's dialect and of everybody else's [MODEL.md 5]."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.renderer.files.regular_files import require_file
from fit_material.renderer.materials.mtl_maps import ORDINARY_KEYS, THESIS_KEYS, Keys, MapReader
from fit_material.renderer.materials.mtl_syntax import Block, Triple, read_blocks
from fit_material.renderer.materials.textured_material import Appearance
from fit_material.shaders.materials.kinds import KINDS, type_codes
from fit_material.shaders.materials.quantities import COLOR, REFLECTANCE, ROUGHNESS, K, N, Quantity
from fit_material.shaders.materials.types import Glossy, Material, Matte, Metal, made_of
from fit_material.shaders.materials.widths import RHO_PER_ALPHA, Blur
from fit_material.shaders.optics import fresnel

Dialect = Literal["auto", "thesis", "ordinary"]

DEFAULT_TYPE = Matte.name  # of a code that is missing or unknown
DEFAULT_COLOR = 0.6  # what Assimp, and so the thesis's viewer, takes for a missing Kd

LARGEST = 1e6  # of n, k and ρ: far beyond any material, and its square still a float32
_TINY = 2.0**-149  # the smallest float32 above 0
_ONLY_THESIS = {"ns", "ka", "kd", "ks", "map_ka", "map_kd", "bump", "map_bump", "norm"}
_NOT_DRAWN = {"disp", "decal", "refl", "map_ks", "map_ns", "map_d", "map_ke", "map_pr", "map_pm", "map_ps"}


@dataclass(frozen=True)
class Library:
    """What MTL files hold.

    Attributes:
        appearances: by the material's name, in the file's order.
        remarks: a sentence about everything that is not drawn as in the file.
        files: all that were read, textures too.
    """

    appearances: dict[str, Appearance]
    remarks: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()


def default_appearance() -> Appearance:
    """The default material of a surface."""
    return Appearance(Matte(torch.full((3,), DEFAULT_COLOR), torch.ones(3)))


def read_mtl(
    path: str | Path,
    codes: Mapping[str, int] | None = None,
    dialect: Dialect = "auto",
    tree: Path | None = None,
    outside: bool = False,
) -> Library:
    """Read an MTL file with its textures.

    The thesis's dialect [thesis, table 3.2; MODEL.md 5]:

        Ns   type code; another one, or none, is matte
        Kd   n of a metal, else color         Ka   k of a metal, else reflectance         Ks   ρ ρ ρ
        map_Kd color map, bump / map_bump / norm normal map, map_Ka ambient occlusion

    A matte material may leave out Kd (0.6) and Ka (1), as Assimp lets it. All others are required, within their range.
    The ordinary dialect becomes the nearest of our three; its numbers are clamped into their range:

        metal    Pm >= 0.5, F0 = Kd; without Pm: illum 3 with Kd <= 0.2 and a Ks >= 0.4, F0 = Ks
        glossy   else, where Ks > 0 and illum is not 0 or 1: color Kd, reflectance Ks, or ((Ni-1)/(Ni+1))² for Ni > 1
        matte    else: color Kd, reflectance 1
        ρ        2√2·alpha, alpha = Pr², else √(2/(Ns+2)) from Blinn's exponent [Walter 2007, §5.2]
        map_Kd color map, norm / map_bump / bump normal map where it has colours

    A missing Kd is 0.6, or white under a `map_Kd`; a colour of one number is grey.

    Args:
        path: UTF-8, UTF-16 with byte-order mark, or Latin-1.
        codes: values of `Ns` for each type of material; the thesis's numbers where left out.
        dialect: "auto" takes for the thesis's dialect a file called `*.thesis.mtl`, and one that has no keys but
            those above, in which every material has a known code for Ns, Ka, Kd, and Ks of three equal numbers.
        tree: the folder in or below which textures are read; the file's own where it is left out.
        outside: read textures from anywhere.

    Raises:
        InputError: the file is missing, or a value that counts is no number, not finite, or out of the thesis's
            ranges. A texture that cannot be used is no error but a remark.
    """
    path = Path(path)
    codes = type_codes() if codes is None else codes
    require_file(path, "an MTL file")
    blocks, reader = read_blocks(path), MapReader(None if outside else tree or path.parent)
    if dialect == "thesis" or (dialect == "auto" and _is_thesis(path, blocks, codes)):
        types = {float(code): kind for kind, code in codes.items()}
        appearances = {block.name: _thesis_appearance(block, types, reader) for block in blocks}
    else:
        appearances = {block.name: _ordinary_appearance(block, reader) for block in blocks}
    return Library(appearances, tuple(reader.remarks), (path, *reader.files))


def _thesis_appearance(block: Block, types: Mapping[float, str], reader: MapReader) -> Appearance:
    return _mapped(block, _thesis_material(block, types), THESIS_KEYS, reader)


def _ordinary_appearance(block: Block, reader: MapReader) -> Appearance:
    found = _mapped(block, _ordinary_material(block), ORDINARY_KEYS, reader)
    reader.remarks += _not_drawn(block)
    return found


def _mapped(block: Block, material: Material, keys: Keys, reader: MapReader) -> Appearance:
    """The material with its maps, of which a metal uses no colour."""
    maps = reader.maps(block, keys)
    if maps.color is not None and not material.has_body:
        reader.remarks.append(block.remark("map_Kd", "not drawn, for a metal has no colour"))
        maps = replace(maps, color=None)
    return Appearance(material, maps)


def _is_thesis(path: Path, blocks: list[Block], codes: Mapping[str, int]) -> bool:
    if path.name.lower().endswith(".thesis.mtl"):
        return True
    if any(block.values.keys() - _ONLY_THESIS for block in blocks):
        return False
    return bool(blocks) and all(_is_thesis_block(block, codes) for block in blocks)


def _is_thesis_block(block: Block, codes: Mapping[str, int]) -> bool:
    ks = block.triple("Ks")
    coded = block.number("Ns") in codes.values()
    return coded and ks is not None and len({*ks}) == 1 and None not in (block.triple("Ka"), block.triple("Kd"))


def _thesis_material(block: Block, types: Mapping[float, str]) -> Material:
    code = block.number("Ns")
    kind = types.get(code, DEFAULT_TYPE) if code is not None else DEFAULT_TYPE
    color, reflectance = (None, None) if KINDS[kind].mirrors else (DEFAULT_COLOR, 1.0)
    ranges: Mapping[Quantity, tuple[str, float, float, float | None]] = {
        N: ("the metal's n", _TINY, LARGEST, None),
        K: ("the metal's k", 0, LARGEST, None),
        COLOR: ("the color", 0, 1, color),
        REFLECTANCE: ("the reflectance", 0, 1, reflectance),
    }
    return made_of(kind, lambda quantity: _ranged(block, quantity, *ranges[quantity]), lambda: Blur(_rho(block)))


def _rho(block: Block) -> Float[Tensor, ""]:
    """ρ of the thesis's dialect."""
    rho = _ranged(block, ROUGHNESS, "the roughness", 0, LARGEST)
    if len({*rho.tolist()}) != 1:
        raise block.error("Ks", rho.tolist(), "the roughness, one number thrice")
    return rho[0]


def _ranged(
    block: Block, quantity: Quantity, what: str, low: float, high: float, default: float | None = None
) -> Float[Tensor, "3"]:
    """Three numbers of the thesis's dialect, in [low, high], by the quantity's key."""
    key = quantity.mtl
    assert key is not None
    interval = f"in [0, {high:g}]" if low == 0 else f"above 0 and at most {high:g}"
    values = block.triple(key)
    if values is None:
        if default is None:
            raise block.error(key, "", f"{what}, three numbers {interval}, but there are none")
        return torch.full((3,), default)
    found = _tensor(values)
    if not ((found >= low) & (found <= high)).all():
        raise block.error(key, " ".join(f"{value:g}" for value in values), f"{what}, {interval}")
    return found


def _ordinary_material(block: Block) -> Material:
    kd, ks = _clamped(block, "Kd", 1.0 if "map_kd" in block.values else DEFAULT_COLOR), _clamped(block, "Ks", 0.0)
    rho = Blur(torch.tensor(RHO_PER_ALPHA * _alpha(block)))
    illum = block.number("illum")
    f0 = _metal_f0(block, kd, ks, illum)
    if f0 is not None:
        return Metal(*_index_of(f0), rho)
    if max(ks) > 0 and illum not in (0, 1):
        return Glossy(_tensor(kd), _tensor(_dielectric_f0(block, ks)), rho)
    return Matte(_tensor(kd), torch.ones(3))


def _metal_f0(block: Block, kd: Triple, ks: Triple, illum: float | None) -> Triple | None:
    """F0 of an ordinary material that is a metal; None for the others."""
    metalness = block.number("Pm")
    if metalness is not None:
        return kd if metalness >= 0.5 else None
    return ks if illum == 3 and max(kd) <= 0.2 and max(ks) >= 0.4 else None


def _dielectric_f0(block: Block, ks: Triple) -> Triple:
    """Reflectance of an ordinary glossy material: by the index of refraction, where it has one of a dielectric."""
    ior = block.number("Ni")
    if ior is None or ior <= 1:
        return ks
    f0 = ((ior - 1) / (ior + 1)) ** 2
    return f0, f0, f0


def _index_of(f0: Triple) -> tuple[Float[Tensor, "3"], Float[Tensor, "3"]]:
    """n and k of a metal that has this F0.

    Of all that have, those of edge tint 1, whose exact reflectance dips least before grazing angles: it is the
    nearest to Schlick's, which other programs draw.
    """
    r = torch.tensor(f0, dtype=torch.float64).clamp_max(1 - 2.0**-24)  # n > 0
    n, k = fresnel.from_edge_tint(r, torch.ones_like(r))
    return n.float(), k.float()


def _alpha(block: Block) -> float:
    """Microfacet width of an ordinary material, from `Pr` or else the highlight's exponent."""
    perceptual = block.number("Pr")
    if perceptual is not None:
        return min(max(perceptual, 0.0), 1.0) ** 2
    return math.sqrt(2 / (max(block.number("Ns") or 0.0, 0.0) + 2))


def _clamped(block: Block, key: str, default: float) -> Triple:
    red, green, blue = (min(max(value, 0.0), 1.0) for value in block.triple(key) or (default,) * 3)
    return red, green, blue


def _not_drawn(block: Block) -> list[str]:
    """A remark about what an ordinary material has and ours have not, if there is any."""
    opacity, emission = block.number("d"), block.triple("Ke")
    keys = sorted(block.values.keys() & _NOT_DRAWN)
    keys += ["d"] if opacity is not None and opacity < 1 else []
    keys += ["Ke"] if emission is not None and max(emission) > 0 else []
    return [block.remark(", ".join(keys))] if keys else []


def _tensor(values: Triple) -> Float[Tensor, "3"]:
    return torch.tensor(values, dtype=torch.float32)
