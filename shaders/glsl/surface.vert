// Places a triangle's corners; everything is told from the model's centre, which keeps float32's digits.
#version 430 core

in vec3 position, normal;
uniform mat4 to_clip;
out vec3 surface_position, surface_normal;
invariant gl_Position;  // the same in both passes
#ifdef TEXTURED
in vec2 uv;
out vec2 surface_uv;
#endif
#ifdef NORMAL_MAP
in vec4 tangent;
out vec4 surface_tangent;
#endif

void main() {
    surface_position = position;
    surface_normal = normal;
#ifdef TEXTURED
    surface_uv = uv;
#endif
#ifdef NORMAL_MAP
    surface_tangent = tangent;
#endif
    gl_Position = to_clip * vec4(position, 1.0);
}
