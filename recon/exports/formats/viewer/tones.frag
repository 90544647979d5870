#version 300 es
// From linear light to the codes of an sRGB screen, as rig view does.
precision highp float;
precision highp sampler2D;
uniform sampler2D picture;
uniform float exposure;  // a factor
uniform int tones;
out vec4 shown;

vec3 encoded(vec3 light) {  // IEC 61966-2-1
  light = clamp(light, 0.0, 1.0);
  return mix(12.92 * light, 1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, light));
}

// AgX is Troy Sobotka's, by the fit of its curve that three.js and Filament draw with (B. Wrensch, Minimal AgX
// Implementation, 2023).
const mat3 REC2020 = mat3(0.6274, 0.0691, 0.0164, 0.3293, 0.9195, 0.0880, 0.0433, 0.0113, 0.8956);
const mat3 INTO = mat3(
  0.856627153315983, 0.137318972929847, 0.11189821299995,
  0.0951212405381588, 0.761241990602591, 0.0767994186031903,
  0.0482516061458583, 0.101439036467562, 0.811302368396859);
const mat3 OUT_OF = mat3(
  1.1271005818144368, -0.1413297634984383, -0.14132976349843826,
  -0.11060664309660323, 1.157823702216272, -0.11060664309660294,
  -0.016493938717834573, -0.016493938717834257, 1.2519364065950405);
const vec2 STOPS = vec2(-12.47393, 4.026069);

vec3 agx(vec3 light) {
  vec3 inside = INTO * (REC2020 * min(light, exp2(STOPS.y + 8.0)));
  vec3 x = clamp((log2(max(inside, exp2(-24.0))) - STOPS.x) / (STOPS.y - STOPS.x), 0.0, 1.0);
  vec3 curve =
    ((((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x) - 0.00232;
  return encoded(inverse(REC2020) * pow(max(OUT_OF * curve, 0.0), vec3(2.2)));
}

// Filmic is John Hable's curve (Uncharted 2: HDR Lighting, GDC 2010).
vec3 hable(vec3 x) {
  return (x * (0.22 * x + 0.03) + 0.002) / (x * (0.22 * x + 0.3) + 0.06) - 0.01 / 0.3;
}

void main() {
  vec3 light = exposure * texelFetch(picture, ivec2(gl_FragCoord.xy), 0).rgb;
  vec3 codes = encoded(light);
  if (tones == 1) codes = agx(light);
  if (tones == 2) codes = encoded(hable(2.0 * min(light, 1e4)) / hable(vec3(11.2)));
  shown = vec4(codes, 1.0);
}
