// HDR screens: the light in half floats, unclipped, which browsers hand to such a screen from WebGPU alone.
"use strict";

const HDR = "HDR";
const high = matchMedia("(dynamic-range: high)");
let drawBright = null;

/** A function that shows `picture` so many stops brighter on the canvas for HDR; null where that is not possible. */
async function brightCanvas() {
  const device = await (await navigator.gpu?.requestAdapter())?.requestDevice();
  const surface = element("bright"), context = device && surface.getContext("webgpu"), format = "rgba16float";
  context?.configure({ device, format, alphaMode: "opaque", colorSpace: "srgb", toneMapping: { mode: "extended" } });
  if (context?.getConfiguration?.().toneMapping?.mode !== "extended") return null;
  const module = device.createShaderModule({ code: element("bright.wgsl").textContent });
  const stages = { vertex: { module }, fragment: { module, targets: [{ format }] } };
  const pipeline = device.createRenderPipeline({ layout: "auto", ...stages });
  const exposure = device.createBuffer({ size: 16, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
  device.lost.then(withoutHdr);
  let light, bindings;
  return (stops) => {
    const size = [canvas.width, canvas.height];
    if (!light || light.width !== size[0] || light.height !== size[1]) {
      light?.destroy();
      [surface.width, surface.height] = size;
      const usage = GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.COPY_DST;
      light = device.createTexture({ size, format: "rgba32float", usage });
      const entries = [{ binding: 0, resource: light.createView() }, { binding: 1, resource: { buffer: exposure } }];
      bindings = device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries });
    }
    device.queue.writeTexture({ texture: light }, lightAt(0, 0, ...size), { bytesPerRow: 16 * size[0] }, size);
    device.queue.writeBuffer(exposure, 0, new Float32Array([2 ** stops, 0, 0, 0]));
    const commands = device.createCommandEncoder();
    const view = context.getCurrentTexture().createView();
    const pass = commands.beginRenderPass({ colorAttachments: [{ view, loadOp: "clear", storeOp: "store" }] });
    pass.setPipeline(pipeline);
    pass.setBindGroup(0, bindings);
    pass.draw(3);
    pass.end();
    device.queue.submit([commands.finish()]);
  };
}

/** Offer HDR among the tones as long as the screen that shows the page has it, and begin with it in place of AgX. */
async function followScreen() {
  if (!high.matches) return withoutHdr();
  drawBright ??= await brightCanvas().catch(() => null);
  if (!drawBright || element("tones").namedItem(HDR)) return;
  const option = new Option(HDR);
  option.id = HDR;
  element("tones").add(option);
  if (facts.begins.tones === "AgX" && element("tones").value === "AgX") element("tones").value = HDR;
  again();
}

function withoutHdr() {
  if (element("tones").value === HDR) element("tones").value = "AgX";
  element(HDR)?.remove();
  again();
}
