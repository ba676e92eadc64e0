"""From radiance to the numbers of a photograph: exposure, response, clipping."""
