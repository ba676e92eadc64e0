"""Which effects a drawing calls for, as the definitions that its shader is compiled with; no others are in it."""

from __future__ import annotations

from fit_material.renderer.viewer_model.model import Appearance
from fit_material.shaders.materials.widths import rho_of
from fit_material.shaders.optics.microfacets import MIRROR

Definitions = frozenset[tuple[str, int]]


def definitions(
    appearance: Appearance, *, lights: int, uv: bool, tangents: bool, neighbours: bool, depth: bool, exact: bool
) -> Definitions:
    """The definitions of shaders/glsl/surface.frag.

    Args:
        appearance: material and maps.
        lights: number of directional lights.
        uv: the mesh has texture coordinates, without which there are no maps.
        tangents: it has tangents, without which there is no normal map.
        neighbours: a cubemap of the object's surroundings was captured.
        depth: the picture is such a capture, which holds depth in place of coverage.
        exact: rays meet triangles in double precision.
    """
    material, maps = appearance.material, appearance.maps
    wanted = {
        material.type.upper(): 1,
        "LIGHTS": lights,
        "BLUR": int(material.width is not None and float(rho_of(material.width)) > MIRROR),
        "NEIGHBOURS": int(material.mirrors and neighbours),
        "COLOR_MAP": int(material.has_body and uv and maps.color is not None),
        "NORMAL_MAP": int(uv and tangents and maps.normal is not None),
        "AMBIENT_OCCLUSION": int(uv and maps.ambient_occlusion is not None),
        "DEPTH": int(depth),
        "EXACT": int(exact),
    }
    # zeros stay undefined, but for the number of lights, which the shader compares
    return frozenset((name, value) for name, value in wanted.items() if value or name == "LIGHTS")
