"""The effects that a picture may need, one list: what each adds, when it is called for, its cost, where its code is.

A further effect is an entry here, one in `fitter.effects.plan_rules`, and its two implementations; that of the fit may
be an entry of `fitter.forward.pixel_effects`. Those that the viewer does not draw have none in GLSL; those that are
always in its shader have no definition that brings them in.
"""

from __future__ import annotations

from dataclasses import dataclass

from fit_material.shaders.registry.registry import Registry


@dataclass(frozen=True)
class Effect:
    """One effect.

    Attributes:
        name: as files, options and reports have it.
        adds: what a picture has by it.
        called_for: when it can be seen.
        cost: time that it takes for some pixels at the standard fidelity, over that of the light through their lobe,
            "blur"; measured by `python -m tests.bench plan`.
        torch: the function that computes it, "module.function".
        glsl: its twin, "file: function"; None for what the viewer does not draw.
        definition: with which the viewer's shader is compiled where it is on; None where it is always in it.
    """

    name: str
    adds: str
    called_for: str
    cost: float
    torch: str
    glsl: str | None = None
    definition: str | None = None


EFFECTS = Registry(
    Effect(
        "reflection",
        "the surroundings, mirrored",
        "a material is metal or glossy",
        0.4,
        "fit_material.shaders.shade.reflection",
        "shade.glsl: reflection",
    ),
    Effect(
        "blur",
        "the mirrored surroundings out of focus, by the roughness",
        "a lobe of the roughness differs from a mirror",
        1.0,
        "fit_material.shaders.optics.blur.blur",
        "lobe.glsl: blur",
        "BLUR",
    ),
    Effect(
        "horizon",
        "the surface's own horizon, below which its lobe gathers no light",
        "the lobe is one of microfacets",
        0.0,
        "fit_material.shaders.optics.microfacets.reflected",
    ),
    Effect(
        "light-reflection",
        "highlights of directional lights",
        "there are such lights, and something that mirrors them",
        0.03,
        "fit_material.shaders.optics.blur.light_reflection",
        "lobe.glsl: light_reflection",
        "LIGHTS",
    ),
    Effect(
        "diffuse-irradiance",
        "light that a diffuse body scatters",
        "a material is glossy or matte",
        3.0,
        "fit_material.shaders.shade.scattered",
        "shade.glsl: scattered",
    ),
    Effect(
        "energy-guard",
        "a glossy body darkened so that it sends out no more than it receives",
        "colour and reflection of the thesis's glossy material exceed 1 together",
        0.0,
        "fit_material.shaders.optics.diffuse.energy_guard",
        "diffuse.glsl: energy_guard",
    ),
    Effect(
        "normal-map",
        "relief finer than the mesh",
        "a normal map is given",
        0.0,
        "fit_material.shaders.normal_map.perturbed",
        "normal_map.glsl: perturbed",
        "NORMAL_MAP",
    ),
    Effect(
        "color-map",
        "colours that vary over the surface",
        "a colour map is given",
        0.0,
        "fit_material.renderer.images.textures.lookup",
        "surface.frag: tint",
        "COLOR_MAP",
    ),
    Effect(
        "ambient-occlusion",
        "surroundings that the object hides from its own diffuse body",
        "a map of it is given, or the object is not convex and has a diffuse body",
        7.0,
        "fit_material.renderer.light_tables.irradiance_table.diffuse_table",
        "surface.frag: openness",
        "AMBIENT_OCCLUSION",
    ),
    Effect(
        "double-bounce",
        "metal in creases darker and more saturated, in the thesis's way",
        "an ambient-occlusion map is given, in the thesis's model",
        0.0,
        "fit_material.shaders.shade.double_bounce",
        "shade.glsl: double_bounce",
        "AMBIENT_OCCLUSION",
    ),
    Effect(
        "captured-neighbours",
        "other objects in the mirrored surroundings, seen from the object's centre",
        "several objects, in the thesis's model",
        0.5,
        "fit_material.renderer.viewer_model.captured_neighbours.capture",
        "shade.glsl: blurred_environment",
        "NEIGHBOURS",
    ),
    Effect(
        "depth-scaled-blur",
        "near things less blurred than far ones",
        "neighbours are captured, and the material is rough",
        0.0,
        "fit_material.renderer.viewer_model.captured_neighbours.depth",
        "shade.glsl: blurred_environment",
        "NEIGHBOURS",
    ),
    Effect(
        "self-visibility",
        "surroundings and lights that the object, or its neighbour, hides from its own mirroring surface",
        "the object is not convex",
        0.6,
        "fit_material.renderer.rays.occlusion.occluder",
    ),
    Effect(
        "interreflection",
        "light that comes from the object itself, or from its neighbour",
        "the object is not convex",
        300.0,
        "fit_material.renderer.path_tracing.differentiable_scene.DifferentiableScene",
    ),
    Effect(
        "exact-fresnel",
        "reflectance by Fresnel's own equations, which alone separate n from k",
        "it differs from its approximation by the angles that are seen",
        0.0,
        "fit_material.shaders.optics.fresnel.conductor",
    ),
    Effect(
        "pixel-footprint",
        "what varies inside of a pixel",
        "a pixel sees more than its middle ray",
        0.6,
        "fit_material.renderer.rays.pixel_footprint.filled",
    ),
)
"""All effects, in the order of plans."""
