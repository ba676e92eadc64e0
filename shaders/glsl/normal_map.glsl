// Tangent-space normal maps. Twin of shaders/normal_map.py; tests/shaders/test_glsl_parity.py keeps the two equal.

// x / max(|x|, 1e-12): what has no direction stays 0 rather than NaN.
vec3 direction_of(vec3 x) {
    return x / max(length(x), 1e-12);
}

// The surface's normal, turned as the map's texel m = 2·rgb - 1 says: normalise(m_x t + m_y b + m_z n). `perturbed`.
vec3 perturbed(vec3 normal, vec3 tangent, float handedness, vec3 texel) {
    vec3 n = direction_of(normal);
    vec3 t = direction_of(tangent - dot(n, tangent) * n);
    vec3 b = handedness * cross(n, t);
    vec3 m = 2.0 * texel - 1.0;
    vec3 turned = m.x * t + m.y * b + m.z * n;
    return direction_of(turned == vec3(0.0) ? n : turned);
}
