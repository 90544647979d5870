// PlayCanvas's engine, of which SuperSplat is made, as it is without settings.
import * as pc from "playcanvas";

const TONES = { none: pc.TONEMAP_NONE, aces: pc.TONEMAP_ACES };

export async function viewer(canvas) {
  const app = new pc.Application(canvas, {
    graphicsDeviceOptions: { antialias: false, preserveDrawingBuffer: true, deviceTypes: ["webgl2"] },
  });
  app.setCanvasFillMode(pc.FILLMODE_NONE, canvas.width, canvas.height);
  app.setCanvasResolution(pc.RESOLUTION_FIXED, canvas.width, canvas.height);
  const eye = new pc.Entity("camera");
  eye.addComponent("camera", { clearColor: new pc.Color(0, 0, 0, 1), gammaCorrection: pc.GAMMA_SRGB });
  app.root.addChild(eye);
  app.start();
  const ready = () =>
    new Promise((resolve) => {
      app.systems.gsplat.on("frame:ready", function look(camera, layer, sorted, loading) {
        if (sorted && !loading) {
          app.systems.gsplat.off("frame:ready", look);
          app.once("frameend", resolve);
        }
      });
    });
  return async function draw(file, stand, tones) {
    const asset = new pc.Asset("splats", file.endsWith(".glb") ? "container" : "gsplat", { url: file });
    await new Promise((resolve, reject) => {
      asset.on("load", resolve);
      asset.on("error", (error) => reject(new Error(error)));
      app.assets.add(asset);
      app.assets.load(asset);
    });
    let splats = new pc.Entity("splats");
    if (file.endsWith(".glb")) splats = asset.resource.instantiateRenderEntity();
    else splats.addComponent("gsplat", { asset });
    app.root.addChild(splats);
    Object.assign(eye.camera, {
      fov: stand.fov,
      nearClip: stand.near,
      farClip: stand.far,
      toneMapping: TONES[tones],
    });
    const place = new pc.Mat4();
    place.data.set(stand.matrix);
    eye.setLocalPosition(place.getTranslation());
    eye.setLocalRotation(new pc.Quat().setFromMat4(place));
    await ready();
    const picture = canvas.toDataURL();
    splats.destroy();
    return picture;
  };
}
