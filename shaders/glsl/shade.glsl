// The thesis's model, put together: a material under the light of one object. Twin of shaders/shade.py;
// tests/shaders/test_glsl_parity.py keeps the two equal. What renderer/opengl/effects.py does not define is not in the program.
// Needs fresnel.glsl, lobe.glsl and diffuse.glsl before it.

// A point of a surface, as in torch: openness is 1 and tint is white where there is no such map.
struct Point {
    vec3 normal;
    vec3 view;
    float openness;
    vec3 tint;
};

uniform vec3 n, k, color, reflectance;
uniform float roughness;
uniform samplerCube environment;  // the far one
uniform mat3 into_environment;  // from world axes to those of the environment, which may be turned about +Y
uniform vec3 ambient_coefficients[9];
#ifdef NEIGHBOURS
uniform samplerCube neighbours;  // radiance of what is around the object, and its depth 1 - near/D
#endif
#if LIGHTS
uniform vec3 light_towards[LIGHTS], light_radiance[LIGHTS];
#endif

float n_dot_v(Point point) {
    return clamp(dot(point.normal, point.view), 0.0, 1.0);
}

// r = 2(n·v)n - v, the mirrored view.
vec3 reflected(Point point) {
    return 2.0 * dot(point.normal, point.view) * point.normal - point.view;
}

// The environment around r, blurred with the radius ρ, which shrinks for what is near. MODEL.md 3.1, 3.3; `blurred`.
vec3 blurred_environment(vec3 r) {
#if defined(NEIGHBOURS) && defined(BLUR)
    return blur(neighbours, r, roughness * textureLod(neighbours, r, 0.0).a);
#elif defined(NEIGHBOURS)
    return textureLod(neighbours, r, 0.0).rgb;
#elif defined(BLUR)
    return blur(environment, into_environment * r, roughness);
#else
    return textureLod(environment, into_environment * r, 0.0).rgb;
#endif
}

// F ← ao·F + (1-ao)·F²: in a crease light is reflected twice. Thesis 4.3.2; `double_bounce`.
vec3 double_bounce(vec3 f, float openness) {
    return f * (openness + (1.0 - openness) * f);
}

// What the surface mirrors, blurred: environment and lights under the reflectance F. MODEL.md 3, 4; `reflection`.
vec3 reflection(vec3 f, Point point) {
    vec3 r = reflected(point);
    vec3 arriving = blurred_environment(r);
#if LIGHTS && defined(BLUR)  // a mirror shows no point light
    for (int i = 0; i < LIGHTS; ++i)
        arriving += light_radiance[i] * light_reflection(r, light_towards[i], roughness);
#endif
#ifdef AMBIENT_OCCLUSION
    f = double_bounce(f, point.openness);
#endif
    return f * arriving;
}

// What a white Lambertian surface sends out: Σ E max(0, n·l) + ambient · ao. MODEL.md 4; `scattered`.
vec3 scattered(Point point) {
    vec3 arriving = ambient(ambient_coefficients, into_environment * point.normal) * point.openness;
#if LIGHTS
    for (int i = 0; i < LIGHTS; ++i)
        arriving += light_radiance[i] * max(dot(point.normal, light_towards[i]), 0.0);
#endif
    return arriving;
}

// Radiance towards the viewer, linear Rec. 709. MODEL.md 4; `shade`.
vec3 shade(Point point) {
#if defined(METAL)
    return reflection(lazanyi(n_dot_v(point), n, k), point);
#elif defined(GLOSSY)
    vec3 f = schlick(n_dot_v(point), reflectance);
    return energy_guard(color * point.tint, f) * scattered(point) + reflection(f, point);
#elif defined(MATTE)
    return color * point.tint * schlick(n_dot_v(point), reflectance) * scattered(point);
#else
#error "a type of material without a drawing"
#endif
}
