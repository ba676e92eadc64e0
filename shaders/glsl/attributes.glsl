// What the triangle is like where the pixel's ray meets it: by the rasteriser's interpolation; or, where EXACT is
// defined, by the ray itself in double precision, since at grazing angles the rasteriser's float32 shows in mirrors.
// Needs film.glsl before it.

struct Attributes {
    vec3 position, normal;
    vec2 uv;
    vec4 tangent;
};

#ifdef EXACT

layout(std430, binding = 0) readonly buffer Positions {
    double positions[];
};
layout(std430, binding = 1) readonly buffer Vertices {
    float vertices[];  // as renderer/viewer/geometry.py lays them out
};
layout(std430, binding = 2) readonly buffer Indices {
    uint indices[];
};
const uint STRIDE = 12, NORMAL = 3, UV = 6, TANGENT = 8;

uvec3 corners() {
    uint first = 3 * gl_PrimitiveID;
    return uvec3(indices[first], indices[first + 1], indices[first + 2]);
}

dvec3 position_of(uint vertex) {
    return dvec3(positions[3 * vertex], positions[3 * vertex + 1], positions[3 * vertex + 2]);
}

// Weights of the corners where the pixel's ray meets their plane; the centroid's for a ray inside the plane.
// Möller & Trumbore 1997, eq. 6; `barycentric` in renderer/raycast.py.
dvec3 weights(uvec3 corner) {
    dvec3 pixel = dvec3(gl_FragCoord.xy, 1.0);
    dvec3 direction = film_direction * pixel;
    dvec3 first = position_of(corner.y) - position_of(corner.x), second = position_of(corner.z) - position_of(corner.x);
    dvec3 across = cross(direction, second), offset = film_origin * pixel - position_of(corner.x);
    double determinant = dot(across, first);
    double u = dot(across, offset), v = dot(cross(offset, first), direction);
    return determinant == 0.0 ? dvec3(1.0 / 3.0) : dvec3(determinant - u - v, u, v) / determinant;
}

double mixed(uvec3 corner, dvec3 weight, uint place) {
    uvec3 at = STRIDE * corner + place;
    return dot(weight, dvec3(vertices[at.x], vertices[at.y], vertices[at.z]));
}

vec3 mixed3(uvec3 corner, dvec3 weight, uint place) {
    return vec3(mixed(corner, weight, place), mixed(corner, weight, place + 1), mixed(corner, weight, place + 2));
}

Attributes attributes() {
    uvec3 corner = corners();
    dvec3 weight = weights(corner);
    dvec3 position = dmat3(position_of(corner.x), position_of(corner.y), position_of(corner.z)) * weight;
    vec2 uv = vec2(mixed(corner, weight, UV), mixed(corner, weight, UV + 1));
    vec4 tangent = vec4(mixed3(corner, weight, TANGENT), mixed(corner, weight, TANGENT + 3));
    return Attributes(vec3(position), mixed3(corner, weight, NORMAL), uv, tangent);
}

#else

in vec3 surface_position, surface_normal;
in vec2 surface_uv;
in vec4 surface_tangent;

Attributes attributes() {
    return Attributes(surface_position, surface_normal, surface_uv, surface_tangent);
}

#endif
