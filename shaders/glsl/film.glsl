// Where a pixel looks: the twin of Camera.rays in renderer/camera.py, for a pixel's centre (moved by an offset that is
// in `film_corner` already).
uniform vec3 film_corner, film_right, film_up;  // unnormalised direction at the lower left corner; its change per pixel

vec3 ray_direction() {
    return normalize(film_corner + gl_FragCoord.x * film_right + gl_FragCoord.y * film_up);
}
