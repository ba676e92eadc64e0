// Where a pixel looks: the twin of Camera.rays in renderer/camera.py. The matrices' columns are what one pixel to the
// right, one pixel upwards, and the framebuffer's lower left corner add to the unnormalised direction, and to the
// origin, which is told from the model's centre.
#ifdef EXACT
uniform dmat3 film_direction, film_origin;
#else
uniform mat3 film_direction;
#endif

vec3 ray_direction() {
    return normalize(vec3(film_direction * vec3(gl_FragCoord.xy, 1.0)));
}
