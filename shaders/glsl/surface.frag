// Radiance of a surface towards the viewer, and its coverage, 1; or, for captured neighbours, its depth.
#version 430 core

#include "fresnel.glsl"
#include "lobe.glsl"
#include "diffuse.glsl"
#include "shade.glsl"
#include "film.glsl"
#include "attributes.glsl"
#include "normal_map.glsl"

#ifdef NORMAL_MAP
uniform sampler2D normal_map;
#endif
#ifdef COLOR_MAP
uniform sampler2D color_map;
#endif
#ifdef AMBIENT_OCCLUSION
uniform sampler2D ambient_occlusion_map;
#endif
#ifdef DEPTH
uniform vec3 eye;
uniform float near;  // radius of the bounding sphere of the object whose neighbours these are
#endif
out vec4 radiance;

vec3 shading_normal(Attributes surface) {
#ifdef NORMAL_MAP
    return perturbed(surface.normal, surface.tangent.xyz, surface.tangent.w, texture(normal_map, surface.uv).rgb);
#else
    return normalize(surface.normal);
#endif
}

float openness(Attributes surface) {
#ifdef AMBIENT_OCCLUSION
    return texture(ambient_occlusion_map, surface.uv).r;
#else
    return 1.0;
#endif
}

vec3 tint(Attributes surface) {
#ifdef COLOR_MAP
    return texture(color_map, surface.uv).rgb;
#else
    return vec3(1.0);
#endif
}

// Coverage; or depth d = 1 - near/D in [0, 1), D the distance from the capturing object's centre. MODEL.md 3.3;
// `depth` in renderer/neighbours.py.
float alpha(Attributes surface) {
#ifdef DEPTH
    return clamp(1.0 - near / distance(surface.position, eye), 0.0, 1.0 - 1.0 / 16777216.0);
#else
    return 1.0;
#endif
}

void main() {
    Attributes surface = attributes();
    Point point = Point(shading_normal(surface), -ray_direction(), openness(surface), tint(surface));
    radiance = vec4(shade(point), alpha(surface));
}
