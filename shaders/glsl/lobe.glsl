// The thesis's blur and its lights' reflections. Twin of shaders/optics/blur.py; tests/shaders/test_glsl_parity.py keeps the two equal.

// ∝ exp(-½(i/1.5)²) for i = -3 … 3, summing to one: `tap_weights`. MODEL.md 3.1.
const float TAP_WEIGHTS[7] = float[](
    0.0366328454, 0.111280758, 0.216745321, 0.270682149, 0.216745321, 0.111280758, 0.0366328454
);
const float PI = 3.14159265358979;

// K_H, perpendicular to r and parallel to the XZ plane, (1, 0, 0) where r is parallel to ±Y. Thesis 3.1.3; `tap_axes`.
vec3 horizontal_axis(vec3 r) {
    return dot(r.xz, r.xz) < 1e-24 ? vec3(1.0, 0.0, 0.0) : normalize(vec3(r.z, 0.0, -r.x));
}

// What a cubemap holds around r: the 49 taps normalise(r + (i/3)ρK_H + (j/3)ρK_V) in two passes, over j, then over i.
// Thesis 3.1.3; `blur`. The cubemap itself normalises the taps.
vec3 blur(samplerCube radiance, vec3 r, float rho) {
    vec3 k_h = horizontal_axis(r);
    vec3 step_h = rho / 3.0 * k_h, step_v = rho / 3.0 * cross(k_h, r);
    vec3 blurred = vec3(0.0);
    for (int i = -3; i <= 3; ++i) {
        vec3 column = vec3(0.0);
        for (int j = -3; j <= 3; ++j)
            column += TAP_WEIGHTS[j + 3] * textureLod(radiance, r + i * step_h + j * step_v, 0.0).rgb;
        blurred += TAP_WEIGHTS[i + 3] * column;
    }
    return blurred;
}

// A directional light's reflection per radiance of the light, G(|r - l|; ρ/2), of a surface that is not a mirror.
// Thesis 3.1; `light_reflection`.
float light_reflection(vec3 r, vec3 towards, float rho) {
    float sigma = rho / 2.0;
    vec3 apart = (r - towards) / sigma;  // before the square, which would underflow for a small σ
    return exp(-0.5 * dot(apart, apart)) / (sqrt(2.0 * PI) * sigma);
}
