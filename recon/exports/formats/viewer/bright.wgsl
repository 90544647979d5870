// Light as sRGB that goes on above white, for a screen that shows it.
@group(0) @binding(0) var picture: texture_2d<f32>;  // row 0 is the lowest
@group(0) @binding(1) var<uniform> exposure: vec4f;  // a factor in x

@vertex fn whole(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
  return vec4f(select(-1.0, 3.0, index == 1u), select(-1.0, 3.0, index == 2u), 0.0, 1.0);
}

@fragment fn shown(@builtin(position) place: vec4f) -> @location(0) vec4f {
  let row = textureDimensions(picture).y - 1u - u32(place.y);
  let light = exposure.x * textureLoad(picture, vec2u(u32(place.x), row), 0).rgb;
  let held = clamp(light, vec3f(0.0), vec3f(1e6));  // half floats end soon after
  let codes = 1.055 * pow(held, vec3f(1.0 / 2.4)) - 0.055;  // IEC 61966-2-1
  return vec4f(select(codes, 12.92 * held, held <= vec3f(0.0031308)), 1.0);
}
