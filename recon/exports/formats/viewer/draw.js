// The picture: Gaussians blended in linear light into floats, then shown at an exposure.
"use strict";

function refuse(words) {
  const said = document.getElementById("refusal");
  said.textContent = words;
  said.hidden = false;
  throw new Error(words);
}

const element = (name) => document.getElementById(name);
const canvas = element("canvas");
const facts = JSON.parse(element("facts").textContent);
const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, powerPreference: "high-performance" });
if (!gl) {
  refuse("This browser has no WebGL 2, which draws the scene: switch on its hardware acceleration, or open "
    + "the page in a newer one.");
}
if (!gl.getExtension("EXT_color_buffer_float")) {
  refuse("This graphics card cannot draw into floating-point pictures (EXT_color_buffer_float), which hold "
    + "the light of the scene: open the page on another machine.");
}
// Without it floats of 32 bits cannot be blended, and those of 16 end at 65504 and have 11 bits.
const whole = gl.getExtension("EXT_float_blend") !== null;

function compiled(vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, name] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, element(name).textContent.trim());
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    const why = gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader)).join(" ");
    refuse(`This graphics card does not take the page's programs: ${gl.getProgramInfoLog(program)} ${why}`);
  }
  const places = {};
  for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
    const name = gl.getActiveUniform(program, i).name.replace("[0]", "");
    places[name] = gl.getUniformLocation(program, name);
  }
  return { program, places };
}

/** A texture of rows of 2048, filled up with zeros, or of a given width, that is read texel by texel. */
function texture(internal, format, type, data, channels, width = 2048) {
  const rows = Math.max(1, Math.ceil(data.length / channels / width));
  if (rows > gl.getParameter(gl.MAX_TEXTURE_SIZE)) {
    refuse(`This graphics card holds too few of the ${facts.count} Gaussians: open the page on another one.`);
  }
  let filled = data;
  if (data.length !== rows * width * channels) {
    filled = new data.constructor(rows * width * channels);
    filled.set(data);
  }
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  gl.texImage2D(gl.TEXTURE_2D, 0, internal, width, rows, 0, format, type, filled);
  return made;
}

function bound(places, textures) {
  Object.entries(textures).forEach(([name, made], unit) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, made);
    gl.uniform1i(places[name], unit);
  });
}

const splatting = compiled("splat.vert", "splat.frag");
const skying = compiled("whole.vert", "sky.frag");
const toning = compiled("whole.vert", "tones.frag");
const nothing = gl.createVertexArray();
const corners = gl.createVertexArray();
const order = gl.createBuffer();
const target = gl.createFramebuffer();
let textures, sky, picture, drawn = 0;

/** Hand the numbers of the scene to the graphics card. */
function load(data) {
  textures = {
    codes: texture(gl.RGBA16UI, gl.RGBA_INTEGER, gl.UNSIGNED_SHORT, data.codes, 4),
    rest: texture(gl.RGBA8UI, gl.RGBA_INTEGER, gl.UNSIGNED_BYTE, data.rest, 4),
    book: texture(gl.R32F, gl.RED, gl.FLOAT, new Float32Array(facts.book), 1, 256),
  };
  if (facts.sky) sky = texture(gl.RGB32F, gl.RGB, gl.FLOAT, data.sky, 3, 2 * facts.sky.rows);
  gl.bindVertexArray(corners);
  gl.bindBuffer(gl.ARRAY_BUFFER, order);
  const index = gl.getAttribLocation(splatting.program, "index");
  gl.enableVertexAttribArray(index);
  gl.vertexAttribIPointer(index, 1, gl.UNSIGNED_INT, 0, 0);
  gl.vertexAttribDivisor(index, 1);
}

/** Take a new order of the Gaussians, the farthest first. */
function reorder(indices) {
  gl.bindBuffer(gl.ARRAY_BUFFER, order);
  gl.bufferData(gl.ARRAY_BUFFER, indices, gl.DYNAMIC_DRAW);
  drawn = indices.length;
}

function resized() {
  const shape = canvas.getBoundingClientRect(), fine = Math.min(devicePixelRatio, 2);
  const width = Math.max(1, Math.round(shape.width * fine)), height = Math.max(1, Math.round(shape.height * fine));
  if (picture && canvas.width === width && canvas.height === height) return;
  [canvas.width, canvas.height] = [width, height];
  gl.deleteTexture(picture);
  picture = gl.createTexture();
  gl.activeTexture(gl.TEXTURE0);
  gl.bindTexture(gl.TEXTURE_2D, picture);
  gl.texStorage2D(gl.TEXTURE_2D, 1, whole ? gl.RGBA32F : gl.RGBA16F, width, height);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  gl.bindFramebuffer(gl.FRAMEBUFFER, target);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, picture, 0);
}

/** The lens of the camera in pixels of the canvas: the whole of its picture is seen, and what is beside it. */
function lensOf(camera) {
  const lens = camera.lens, [width, height] = [canvas.width, canvas.height];
  const grown = Math.min(width / lens.width, height / lens.height);
  return {
    focal: [lens.fx * grown, lens.fy * grown],
    principal: [width / 2 + (lens.cx - lens.width / 2) * grown, height / 2 + (lens.cy - lens.height / 2) * grown],
    size: [width, height],
  };
}

/** The light that a camera sees, into `picture`. */
function drawLight(camera) {
  resized();
  const { focal, principal, size } = lensOf(camera);
  const ends = [0, 1].map((axis) => [-principal[axis] / focal[axis], (size[axis] - principal[axis]) / focal[axis]]);
  const more = ends.map(([least, most]) => (facts.margin * (most - least)) / 2);
  // Its rows are the axes, and GL has matrices column by column.
  const turn = [0, 1, 2].flatMap((column) => camera.axes.map((axis) => axis[column]));
  gl.bindFramebuffer(gl.FRAMEBUFFER, target);
  gl.viewport(0, 0, ...size);
  gl.disable(gl.BLEND);
  gl.clearColor(0, 0, 0, 0);
  gl.clear(gl.COLOR_BUFFER_BIT);
  const shared = ({ program, places }) => {
    gl.useProgram(program);
    gl.uniformMatrix3fv(places.turn, false, turn);
    gl.uniform2fv(places.focal, focal);
    gl.uniform2fv(places.principal, principal);
    gl.uniform2fv(places.size, size);
    return places;
  };
  if (sky) {
    const places = shared(skying);
    gl.uniformMatrix3fv(places.axes, true, facts.sky.axes);
    bound(places, { sky });
    gl.bindVertexArray(nothing);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
  const places = shared(splatting);
  bound(places, textures);
  gl.uniform4fv(places.low, facts.low);
  gl.uniform4fv(places.grain, facts.grain);
  gl.uniform3fv(places.centre, camera.centre);
  gl.uniform4f(places.bounds, ends[0][0] - more[0], ends[1][0] - more[1], ends[0][1] + more[0], ends[1][1] + more[1]);
  for (const name of ["nearest", "blur", "dimmest", "cut", "faint"]) gl.uniform1f(places[name], facts[name]);
  gl.uniform1i(places.degree, facts.degree);
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  gl.bindVertexArray(corners);
  gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, drawn);
}

/** `picture` on the screen, so many stops brighter, by the number of a map of tones. */
function show(stops, tones) {
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.disable(gl.BLEND);
  gl.useProgram(toning.program);
  bound(toning.places, { picture });
  gl.uniform1f(toning.places.exposure, 2 ** stops);
  gl.uniform1i(toning.places.tones, tones);
  gl.bindVertexArray(nothing);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
}

/** The light of a rectangle of `picture`, of which row 0 is the lowest: R, G, B, alpha of each pixel. */
function lightAt(column, row, width, height) {
  const found = new Float32Array(4 * width * height);
  gl.bindFramebuffer(gl.FRAMEBUFFER, target);
  gl.readPixels(column, row, width, height, gl.RGBA, gl.FLOAT, found);
  return found;
}
