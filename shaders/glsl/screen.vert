// One triangle that covers the whole framebuffer; three vertices without attributes.
#version 430 core

void main() {
    gl_Position = vec4(4.0 * vec2(gl_VertexID % 2, gl_VertexID / 2) - 1.0, 0.0, 1.0);
}
