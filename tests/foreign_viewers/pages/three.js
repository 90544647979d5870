// Splats of three.js's own, on WebGL. Tones `none` is the renderer as it is without settings, which takes colours for
// light; `codes` hands them to the screen as they are.
import { LinearSRGBColorSpace, Matrix4, PerspectiveCamera, Scene, SRGBColorSpace, WebGPURenderer } from "three/webgpu";
import { GaussianSplatPLYLoader } from "three/addons/loaders/GaussianSplatPLYLoader.js";
import { GLTFGaussianSplatLoaderExtension } from "three/addons/loaders/GLTFGaussianSplatLoaderExtension.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { SPZLoader } from "three/addons/loaders/SPZLoader.js";
import { GaussianSplat } from "three/addons/objects/GaussianSplat.js";

async function splatsOf(file) {
  if (file.endsWith(".ply")) return new GaussianSplat(await new GaussianSplatPLYLoader().loadAsync(file));
  if (file.endsWith(".spz")) return new GaussianSplat(await new SPZLoader().loadAsync(file));
  const loader = new GLTFLoader().register((parser) => new GLTFGaussianSplatLoaderExtension(parser));
  return (await loader.loadAsync(file)).scene;
}

export async function viewer(canvas) {
  const renderer = new WebGPURenderer({ canvas, antialias: false, forceWebGL: true });
  renderer.setPixelRatio(1);
  renderer.setSize(canvas.width, canvas.height, false);
  await renderer.init();
  return async function draw(file, stand, tones) {
    renderer.outputColorSpace = tones === "codes" ? LinearSRGBColorSpace : SRGBColorSpace;
    const eye = new PerspectiveCamera(stand.fov, canvas.width / canvas.height, stand.near, stand.far);
    new Matrix4().fromArray(stand.matrix).decompose(eye.position, eye.quaternion, eye.scale);
    const scene = new Scene();
    scene.add(await splatsOf(file));
    renderer.render(scene, eye);
    renderer.render(scene, eye);
    return canvas.toDataURL(); // of the frame that was drawn in this very task
  };
}
