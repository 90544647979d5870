#version 300 es
// Light from far away: a map of latitude and longitude in the layout of OpenEXR, bilinear.
precision highp float;
precision highp sampler2D;
uniform sampler2D sky;
uniform mat3 turn, axes;  // from the world to the camera, and to the map
uniform vec2 focal, principal, size;
out vec4 light;

const float PI = 3.141592653589793;

vec3 at(ivec2 place, ivec2 shape) {
  ivec2 inside = ivec2((place.x + shape.x) % shape.x, clamp(place.y, 0, shape.y - 1));
  return texelFetch(sky, inside, 0).rgb;
}

void main() {
  vec2 pixel = vec2(gl_FragCoord.x, size.y - gl_FragCoord.y);
  vec3 d = axes * (vec3((pixel - principal) / focal, 1.0) * turn);
  ivec2 shape = textureSize(sky, 0);
  vec2 place = vec2(0.5 - atan(d.x, d.z) / (2.0 * PI), 0.5 - atan(d.y, length(d.xz)) / PI);
  place = place * vec2(shape) - 0.5;
  ivec2 first = ivec2(floor(place));
  vec2 part = place - vec2(first);
  vec3 above = mix(at(first, shape), at(first + ivec2(1, 0), shape), part.x);
  vec3 below = mix(at(first + ivec2(0, 1), shape), at(first + ivec2(1, 1), shape), part.x);
  light = vec4(mix(above, below, part.y), 1.0);
}
