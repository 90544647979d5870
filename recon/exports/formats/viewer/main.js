// The page: what is chosen on it, and when it is drawn again.
"use strict";

const MIDDLE_GREY = 0.18;
const camera = new Camera();
const keys = new Set();
let sorter, sorting = false, stale = true, due = false, last = 0;

/** Bytes that stand plane by plane, [planes, count], Gaussian by Gaussian. */
function interleaved(bytes, planes) {
  const count = bytes.length / planes, found = new Uint8Array(bytes.length);
  for (let plane = 0; plane < planes; plane++) {
    for (let i = 0; i < count; i++) found[i * planes + plane] = bytes[plane * count + i];
  }
  return found;
}

async function unpacked(name) {
  const text = atob(element(name).textContent.trim());
  element(name).remove();
  const packed = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** The middles of the Gaussians, as the vertex shader has them. */
function meansOf(codes) {
  const means = new Float32Array(3 * facts.count);
  for (let i = 0; i < facts.count; i++) {
    for (let axis = 0; axis < 3; axis++) {
      const fine = ((codes[16 * i + 15] >> (10 - 5 * axis)) & 31) / 32;
      const bent = facts.low[axis] + facts.grain[axis] * (codes[16 * i + axis] + fine);
      means[3 * i + axis] = Math.sign(bent) * Math.expm1(Math.abs(bent));
    }
  }
  return means;
}

/** Harmonics of 24 bytes each as six texels, and two that are empty, so that none is cut by the end of a row. */
function spaced(rest) {
  const count = rest.length / 24, found = new Uint8Array(32 * count);
  for (let i = 0; i < count; i++) found.set(rest.subarray(24 * i, 24 * i + 24), 32 * i);
  return found;
}

function again() {
  if (!due) requestAnimationFrame(frame);
  due = true;
}

function moved() {
  stale = true;
  element("view").value = "";
  canvas.setAttribute("aria-busy", "true");
  again();
}

function frame(now) {
  due = false;
  if (!sorter) return; // the Gaussians are not there yet; start() comes back
  const passed = Math.min((now - last) / 1000, 0.1);
  last = now;
  if (keys.size) {
    for (const key of keys) HELD[key](camera, 0.8 * passed);
    moved();
  }
  if (stale && !sorting) {
    sorter.postMessage({ ahead: camera.axes[2], centre: camera.centre });
    [sorting, stale] = [true, false];
  }
  drawLight(camera);
  const stops = Number(element("stops").value), bright = element("tones").value === HDR;
  element("bright").hidden = !bright;
  if (bright) drawBright(stops);
  else show(stops, element("tones").selectedIndex);
  if (!sorting && !stale) canvas.setAttribute("aria-busy", "false");
}

function expose(stops) {
  const slider = element("stops");
  slider.value = stops;
  const value = Number(slider.value);
  element("told").textContent = `${value > 0 ? "+" : ""}${value.toFixed(1)} stops`;
  again();
}

function stand(number) {
  const count = facts.views.length, chosen = (number + count) % count;
  camera.standAt(facts.views[chosen]);
  moved();
  element("view").value = chosen;
  stand.at = chosen;
}

/** Three digits. */
const short = (value) => String(Number(value.toPrecision(3)));

/** Say what light is under the pointer. */
function measured(event) {
  const shape = canvas.getBoundingClientRect();
  const column = Math.floor(((event.clientX - shape.left) / shape.width) * canvas.width);
  const row = canvas.height - 1 - Math.floor(((event.clientY - shape.top) / shape.height) * canvas.height);
  const light = Array.from(lightAt(column, row, 1, 1)).slice(0, 3);
  const luminance = dot(light, [0.2126, 0.7152, 0.0722]);
  const stops = Math.log2(luminance / MIDDLE_GREY);
  const words = [
    luminance > 0 ? `${stops > 0 ? "+" : ""}${stops.toFixed(2)} stops from middle grey` : "no light",
    `R G B ${light.map((part) => short(part / facts.factor)).join(" ")}`,
  ];
  if (facts.luminance) words.push(`${short((luminance / facts.factor) * facts.luminance)} cd/m²`);
  element("spot").textContent = words.join(" · ");
}

function pressed(event) {
  const key = event.key.toLowerCase(), typing = event.target.matches("select, input:not([type=range])");
  if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target === element("stops") && key.startsWith("arrow")) return;
  const steps = { b: 1, v: -1 }, views = { n: 1, p: -1 };
  if (key in HELD) keys.add(key);
  else if (key in steps) expose(Number(element("stops").value) + steps[key]);
  else if (key in views) stand(stand.at + views[key]);
  else if (key === "h") stand(facts.home);
  else return;
  event.preventDefault();
  again();
}

async function start() {
  if (!("DecompressionStream" in window)) {
    refuse("This browser cannot unpack the scene (DecompressionStream): open the page in one of 2023 or later.");
  }
  const codes = new Uint16Array(interleaved(await unpacked("codes"), 32).buffer);
  const rest = facts.degree ? interleaved(await unpacked("rest"), 24) : new Uint8Array(0);
  const light = facts.sky ? new Float32Array((await unpacked("sky")).buffer) : null;
  load({ codes, rest: spaced(rest), sky: light });
  sorter = new Worker(URL.createObjectURL(new Blob([element("sort.js").textContent])));
  sorter.postMessage({ means: meansOf(codes) });
  sorter.onmessage = ({ data }) => {
    sorting = false;
    reorder(data);
    again();
  };
  facts.views.forEach((view, number) => element("view").add(new Option(view.name, number)));
  element("view").addEventListener("change", () => stand(Number(element("view").value)));
  element("stops").addEventListener("input", () => expose(element("stops").value));
  element("tones").addEventListener("change", again);
  element("home").addEventListener("click", () => stand(facts.home));
  addEventListener("keydown", pressed);
  addEventListener("keyup", (event) => keys.delete(event.key.toLowerCase()));
  addEventListener("blur", () => keys.clear());
  new ResizeObserver(again).observe(canvas);
  canvas.addEventListener("webglcontextlost", () => {
    refuse("The graphics card was taken away from the page: load it again.");
  });
  listen(camera, moved, measured);
  if (!whole) element("spot").textContent = "This machine blends in 16 bits: light above 65504 is cut off.";
  stand(facts.home);
  element("tones").value = facts.begins.tones;
  expose(facts.begins.stops);
  high.addEventListener("change", followScreen);
  await followScreen();
}

start().catch((error) => {
  if (element("refusal").hidden) refuse(`The page cannot show the scene: ${error.message}`);
});
