// Fresnel reflectance. Twin of shaders/optics/fresnel.py; tests/shaders/test_glsl_parity.py keeps the two equal.

// (1-c)⁵, both formulas' dependence on the angle.
float grazing(float cos_d) {
    float a = 1.0 - cos_d, a2 = a * a;
    return a2 * a2 * a;
}

// Schlick's approximation; f0 is the reflectance at normal incidence. Schlick 1994, eq. 15; thesis 2.2.
vec3 schlick(float cos_d, vec3 f0) {
    return f0 + (1.0 - f0) * grazing(cos_d);
}

// Lazányi's reflectance of a metal, without its error compensation. Lazányi 2005, eq. 4; thesis 2.3.
vec3 lazanyi(float cos_d, vec3 n, vec3 k) {
    vec3 k2 = k * k;
    return ((n - 1.0) * (n - 1.0) + 4.0 * n * grazing(cos_d) + k2) / ((n + 1.0) * (n + 1.0) + k2);
}
