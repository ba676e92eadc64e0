// The far environment behind everything: no coverage; or, for captured neighbours, depth 1. MODEL.md 3.3, 7.
#version 430 core

#include "film.glsl"

uniform samplerCube environment;
uniform mat3 into_environment;
uniform float alpha;
out vec4 radiance;

void main() {
    radiance = vec4(textureLod(environment, into_environment * ray_direction(), 0.0).rgb, alpha);
}
