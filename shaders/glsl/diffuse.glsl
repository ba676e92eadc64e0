// Light that a surface scatters. Twin of shaders/optics/diffuse.py; tests/shaders/test_glsl_parity.py keeps the two equal.

// The environment's cosine-weighted irradiance over π. Ramamoorthi & Hanrahan 2001, eq. 10; `ambient`.
vec3 ambient(vec3 coefficients[9], vec3 normal) {
    float x = normal.x, y = normal.y, z = normal.z;
    float harmonics[9] = float[](1.0, y, z, x, x * y, y * z, x * z, 3.0 * z * z - 1.0, x * x - y * y);
    vec3 sum = vec3(0.0);
    for (int i = 0; i < 9; ++i)
        sum += harmonics[i] * coefficients[i];
    return max(sum, 0.0);  // the harmonics overshoot below 0 opposite a small bright lamp
}

// A colour that with the reflection above it returns no more than arrives. MODEL.md 4; `energy_guard`.
vec3 energy_guard(vec3 color, vec3 reflectance) {
    bvec3 too_much = greaterThan(color + reflectance, vec3(1.0));
    vec3 share = mix(vec3(1.0), (1.0 - reflectance) / mix(vec3(1.0), color, too_much), too_much);
    return color * min(share.r, min(share.g, share.b));
}
