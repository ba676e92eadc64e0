// From linear radiance to what a display shows: exposure, a curve for what is too bright, the sRGB code.
// Twin of shaders/tone_mapping.py.

const int CLAMP = 0, REINHARD = 1, ACES = 2;
const float BRIGHTEST = 1e6;  // white under every curve, and its square is finite
const float REINHARD_WHITE = 4.0;  // the exposed luminance that becomes 1

// Luminance compressed, hue kept. Reinhard 2002, eq. 4.
vec3 reinhard(vec3 radiance) {
    float luminance = dot(radiance, vec3(0.2126, 0.7152, 0.0722));
    return radiance * (1.0 + luminance / (REINHARD_WHITE * REINHARD_WHITE)) / (1.0 + luminance);
}

// The film-like curve of ACES, as a fit per channel. Narkowicz, ACES Filmic Tone Mapping Curve, 2015.
vec3 aces(vec3 radiance) {
    vec3 x = 0.6 * radiance;
    return x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14);
}

// The code of a linear value in [0, 1]. IEC 61966-2-1.
vec3 srgb(vec3 linear) {
    vec3 power = 1.055 * pow(max(linear, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055;
    return mix(power, 12.92 * linear, lessThanEqual(linear, vec3(0.0031308)));
}

// Radiance as a display's code values; exposure in stops.
vec3 tone_mapped(vec3 radiance, float exposure, int curve) {
    vec3 exposed = min(radiance * exp2(exposure), BRIGHTEST);
    if (curve == REINHARD) exposed = reinhard(exposed);
    if (curve == ACES) exposed = aces(exposed);
    return srgb(clamp(exposed, 0.0, 1.0));
}
