// Radiance of a surface towards the viewer, and its coverage, 1; or, for captured neighbours, its depth.
#version 430 core

#include "fresnel.glsl"
#include "lobe.glsl"
#include "diffuse.glsl"
#include "shade.glsl"
#include "film.glsl"
#include "normal_map.glsl"

in vec3 surface_position, surface_normal;
#ifdef TEXTURED
in vec2 surface_uv;
#endif
#ifdef NORMAL_MAP
in vec4 surface_tangent;
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

vec3 shading_normal() {
#ifdef NORMAL_MAP
    return perturbed(surface_normal, surface_tangent.xyz, surface_tangent.w, texture(normal_map, surface_uv).rgb);
#else
    return normalize(surface_normal);
#endif
}

float openness() {
#ifdef AMBIENT_OCCLUSION
    return texture(ambient_occlusion_map, surface_uv).r;
#else
    return 1.0;
#endif
}

vec3 tint() {
#ifdef COLOR_MAP
    return texture(color_map, surface_uv).rgb;
#else
    return vec3(1.0);
#endif
}

// Coverage; or depth d = 1 - near/D in [0, 1), D the distance from the capturing object's centre. MODEL.md 3.3.
float alpha() {
#ifdef DEPTH
    return clamp(1.0 - near / distance(surface_position, eye), 0.0, 1.0 - 1.0 / 16777216.0);
#else
    return 1.0;
#endif
}

void main() {
    radiance = vec4(shade(Point(shading_normal(), -ray_direction(), openness(), tint())), alpha());
}
