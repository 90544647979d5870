#version 300 es
precision highp float;
uniform vec2 size;
flat in vec3 light, root;
flat in vec2 middle;
flat in float opacity, reach;
out vec4 blended;

void main() {
  // From the pixel itself: corners are moved to a fraction of a pixel, and what is between them with them.
  vec2 off = vec2(gl_FragCoord.x, size.y - gl_FragCoord.y) - middle;
  float first = off.x / root.x, second = (off.y - root.y * first) / root.z;
  float square = first * first + second * second;
  if (square > reach) discard;
  float alpha = opacity * exp(-0.5 * square);
  blended = vec4(light * alpha, alpha);
}
