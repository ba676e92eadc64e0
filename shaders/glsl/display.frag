// What a display shows of a picture in linear radiance, of a photograph, or of both. renderer/viewer/display.py.
#version 430 core

#include "tone_mapping.glsl"

const int PICTURE = 0, PHOTOGRAPH = 1, SWIPE = 2, DIFFERENCE = 3;
const float DIFFERENCE_RANGE = 0.25;  // renderer/viewer/compare.py

uniform sampler2D picture;     // sum over samples of linear radiance and coverage
uniform sampler2D photograph;  // linear radiance times its exposure, and where to compare it, in [0, 1]
uniform float samples;
uniform float photograph_factor;  // from the photograph's values to radiance
uniform int content;
uniform float edge;  // of the swipe, a share of the width
uniform vec2 corner, size;  // of the area that is filled, in pixels
uniform float exposure;  // in stops
uniform int curve;
out vec4 color;

void main() {
    vec2 place = (gl_FragCoord.xy - corner) / size;
    vec3 rendered = textureLod(picture, place, 0.0).rgb / samples;
    vec4 seen = texture(photograph, place) * vec4(vec3(photograph_factor), 1.0);
    if (content == DIFFERENCE) {
        vec3 difference = (rendered - seen.rgb) * exp2(exposure) * seen.a;
        color = vec4(0.5 + 0.5 * clamp(difference / DIFFERENCE_RANGE, -1.0, 1.0), 1.0);
        return;
    }
    bool left = content == PHOTOGRAPH || (content == SWIPE && place.x < edge);
    color = vec4(tone_mapped(max(left ? seen.rgb : rendered, 0.0), exposure, curve), 1.0);
    if (content == SWIPE && abs(place.x - edge) * size.x < 1.0) color = vec4(1.0, 0.6, 0.1, 1.0);
}
