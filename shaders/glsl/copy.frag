// The texel of a picture of the same size, unchanged.
#version 430 core

uniform sampler2D picture;
out vec4 color;

void main() {
    color = texelFetch(picture, ivec2(gl_FragCoord.xy), 0);
}
