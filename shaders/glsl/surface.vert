// Places a triangle's corners; everything is told from the model's centre, which keeps float32's digits.
#version 430 core

in vec3 position, normal;
in vec2 uv;
in vec4 tangent;
uniform mat4 to_clip;
out vec3 surface_position, surface_normal;
out vec2 surface_uv;
out vec4 surface_tangent;
invariant gl_Position;  // the same in the pass for depth and in that for light

void main() {
    surface_position = position;
    surface_normal = normal;
    surface_uv = uv;
    surface_tangent = tangent;
    gl_Position = to_clip * vec4(position, 1.0);
}
