#version 300 es
// A Gaussian as a parallelogram around its ellipse: EWA splatting with the blur and the cut-offs of rig.
precision highp float;
precision highp sampler2D;
precision highp int;
precision highp usampler2D;

uniform usampler2D codes, rest;  // four texels of a Gaussian, and two of each three of its harmonics
uniform sampler2D book;  // what the bytes of the harmonics mean
uniform vec4 low[4], grain[4];  // value = low + grain * code
uniform mat3 turn;  // from the world to the camera: x right, y down, z ahead
uniform vec3 centre;
uniform vec2 focal, principal, size;  // px
uniform vec4 bounds;  // tangents at which the projection is taken at most: least u, v, largest u, v
uniform float nearest, blur, dimmest, cut, faint;
uniform int degree;

in uint index;
flat out vec3 light;
flat out vec2 middle;  // px
flat out vec3 root;  // of the covariance: px of one standard deviation along x, of y along that, and of y beside it
flat out float opacity, reach;

const float C1 = 0.4886025119029199;
const vec4 C2 = vec4(1.0925484305920792, -1.0925484305920792, 0.31539156525252005, 0.5462742152960396);
const vec4 NOWHERE = vec4(2.0, 2.0, 2.0, 1.0);

ivec2 texel(int first) {
  return ivec2(4 * (int(index) & 511) + first, int(index) >> 9);
}

mat3 rotation(vec4 q) {  // wxyz
  float w = q.x, x = q.y, y = q.z, z = q.w;
  return mat3(
    1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
    2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
    2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}

vec3 byDirection(vec3 d) {
  uint bytes[24];
  for (int i = 0; i < 6; i++) {
    uvec4 four = texelFetch(rest, ivec2(8 * (int(index) & 255) + i, int(index) >> 8), 0);
    for (int k = 0; k < 4; k++) bytes[4 * i + k] = four[k];
  }
  float basis[8] = float[8](
    -C1 * d.y, C1 * d.z, -C1 * d.x,
    C2.x * d.x * d.y, C2.y * d.y * d.z, C2.z * (2.0 * d.z * d.z - d.x * d.x - d.y * d.y),
    C2.y * d.x * d.z, C2.w * (d.x * d.x - d.y * d.y));
  vec3 sum = vec3(0.0);
  for (int k = 0; k < (degree > 1 ? 8 : 3); k++) {
    for (int c = 0; c < 3; c++) {
      sum[c] += basis[k] * texelFetch(book, ivec2(int(bytes[3 * k + c]), 0), 0).r;
    }
  }
  return sum;
}

void main() {
  gl_Position = NOWHERE;
  uvec4 codes3 = texelFetch(codes, texel(3), 0);
  uvec4 codes0 = texelFetch(codes, texel(0), 0);
  // Places have five bits more, which stand beside the colour.
  vec3 fine = vec3((codes3.www >> uvec3(10, 5, 0)) & 31u) / 32.0;
  vec4 first = low[0] + grain[0] * (vec4(codes0) + vec4(fine, 0.0));
  vec4 second = low[1] + grain[1] * vec4(texelFetch(codes, texel(1), 0));
  vec4 third = low[2] + grain[2] * vec4(texelFetch(codes, texel(2), 0));
  vec3 constant = low[3].xyz + grain[3].xyz * vec3(codes3.xyz);

  vec3 mean = sign(first.xyz) * (exp(abs(first.xyz)) - 1.0);
  vec3 away = mean - centre;
  vec3 point = turn * away;
  if (point.z < nearest) return;
  float range = length(away);
  light = faint * sinh(constant);
  if (degree > 0) light += byDirection(away / range);
  light = max(light, 0.0);
  opacity = 1.0 / (1.0 + exp(-first.w));
  vec3 scale = exp(second.xyz);
  vec4 quat = vec4(sqrt(max(0.0, 1.0 - dot(third.xyz, third.xyz))), third.xyz);
  mat3 own = rotation(quat);

  // Nearer than it was trained it takes its blur along, farther away it keeps its light.
  float cosine = clamp(point.z / range, 0.02, 1.0);
  float spacing = cosine * sqrt(cosine) * range / sqrt(focal.x * focal.y);
  float finer = max(exp(second.w) / spacing, 1.0);
  float coarser = min(exp(third.w) / spacing, 1.0);
  scale = sqrt(scale * scale + blur * (finer * finer - 1.0) * spacing * spacing);
  if (coarser < 1.0) {
    vec3 variance = scale * scale / (spacing * spacing);
    vec3 along = (away / range) * own;
    along *= along;
    float sharp = dot(variance.yzx * variance.zxy, along);
    float wide = dot(variance, max(1.0 - along, 0.0));
    float theirs = blur * coarser * coarser;
    opacity *= sqrt((sharp + theirs * (wide + theirs)) / (sharp + blur * (wide + blur)));
  }

  float brightest = max(light.r, max(light.g, light.b));
  float least = cut > 0.0 ? min(dimmest, cut / max(brightest, 1e-37)) : dimmest;
  least = max(least, exp2(-64.0));
  if (!(opacity >= least)) return;
  reach = 2.0 * log(opacity / least);

  vec2 tangents = point.xy / point.z;
  vec2 held = clamp(tangents, bounds.xy, bounds.zw);
  mat3 rows = transpose(turn * own);
  vec3 m = focal.x / point.z * (rows[0] - held.x * rows[2]) * scale;
  vec3 n = focal.y / point.z * (rows[1] - held.y * rows[2]) * scale;
  vec3 minors = cross(m, n);
  float a = dot(m, m) + blur, b = dot(m, n), c = dot(n, n) + blur;
  float determinant = dot(minors, minors) + blur * (dot(m, m) + dot(n, n)) + blur * blur;
  if (!(max(a, c) <= 1e18)) return;
  middle = focal * tangents + principal;
  root = vec3(a, b, sqrt(determinant)) / sqrt(a);
  vec2 corner = sqrt(reach) * (2.0 * vec2(gl_VertexID & 1, gl_VertexID >> 1) - 1.0);
  vec2 pixel = middle + vec2(root.x * corner.x, root.y * corner.x + root.z * corner.y);
  gl_Position = vec4(2.0 * pixel.x / size.x - 1.0, 1.0 - 2.0 * pixel.y / size.y, 0.0, 1.0);
}
