"""The maps of an MTL's materials, each file read once; one that cannot be used is left out with a remark."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import torch

from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.images.textures import Texture, read_texture
from fit_material.renderer.materials.mtl_syntax import Block, found_file, texture_file, texture_options
from fit_material.renderer.materials.textured_material import Maps

Keys = Mapping[str, tuple[str, ...]]

THESIS_KEYS: Keys = MappingProxyType(
    {"color": ("map_Kd",), "normal": ("norm", "map_bump", "bump"), "ambient_occlusion": ("map_Ka",)}
)
"""For each of `Maps` the keys that name it, the first that is there counts [thesis, table 3.2; MODEL.md 5]."""

ORDINARY_KEYS: Keys = MappingProxyType({**THESIS_KEYS, "ambient_occlusion": ()})
"""As `THESIS_KEYS`; `map_Ka` colours ambient light there, and mostly repeats `map_Kd`."""


@dataclass
class MapReader:
    """Reads maps.

    Attributes:
        tree: the folder in or below which textures have to be; None for anywhere.
        remarks: a sentence about everything that is not drawn as in the file.
        files: what was read.
    """

    tree: Path | None = None
    remarks: list[str] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)
    _textures: dict[tuple[Path, bool], Texture | None] = field(default_factory=dict)

    def maps(self, block: Block, keys: Keys) -> Maps:
        """The maps that a material names."""
        occlusion = self._texture(block, keys["ambient_occlusion"])
        return Maps(
            color=self._texture(block, keys["color"], color=True),
            normal=self._normal_map(block, keys["normal"]),
            ambient_occlusion=None if occlusion is None else Texture(occlusion.texels[..., :1]),
        )

    def _normal_map(self, block: Block, keys: tuple[str, ...]) -> Texture | None:
        """The normal map, unless it is a picture without colour: such a one holds heights."""
        texture = self._texture(block, keys)
        if texture is not None and torch.equal(texture.texels, texture.texels[..., :1].expand_as(texture.texels)):
            self._remark(block, _first(block, keys), "a normal map in colours, not a grey height map; drawn without it")
            return None
        return texture

    def _texture(self, block: Block, keys: tuple[str, ...], color: bool = False) -> Texture | None:
        key = _first(block, keys)
        if not key:
            return None
        name = texture_file(block.values[key.lower()])
        file = found_file(name, block.file.parent, self.tree)
        if file is None:
            self._remark(block, key, self._missing(name, block.file.parent))
            return None
        if options := texture_options(block.values[key.lower()]):
            self.remarks.append(block.remark(f"{key}: {' '.join(options)}"))
        return self._read(file, color)

    def _missing(self, name: str, folder: Path) -> str:
        """A stranger's MTL file does not choose which of our files is read."""
        if found_file(name, folder) is None:
            return "a texture file that exists; drawn without it"
        return f"a texture in the folder {self.tree} or below it, or --outside; drawn without it"

    def _read(self, file: Path, color: bool) -> Texture | None:
        if (file, color) not in self._textures:
            self.files.append(file)
            try:
                self._textures[file, color] = read_texture(file, color=color)
            except InputError as error:
                self._textures[file, color] = None
                self.remarks.append(f"{error}; drawn without it")
        return self._textures[file, color]

    def _remark(self, block: Block, key: str, expected: str) -> None:
        self.remarks.append(str(block.error(key, block.values[key.lower()], expected)))


def _first(block: Block, keys: tuple[str, ...]) -> str:
    return next((key for key in keys if block.values.get(key.lower())), "")
