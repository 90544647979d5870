// Babylon.js as it is without settings, but for the libraries of its loaders, which it would fetch from the web.
import * as fflate from "fflate";
import { FreeCamera } from "@babylonjs/core/Cameras/freeCamera.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import { ImportMeshAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import { Color4 } from "@babylonjs/core/Maths/math.color.js";
import { Matrix, Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { Scene } from "@babylonjs/core/scene.js";
import "@babylonjs/loaders/glTF/2.0/index.js";
import "@babylonjs/loaders/SPLAT/splatFileLoader.js";

const SPLAT = { fflate, spzLibraryUrl: import.meta.resolve("@adobe/spz") };

export async function viewer(canvas) {
  const engine = new Engine(canvas, false, { preserveDrawingBuffer: true });
  engine.setSize(canvas.width, canvas.height);
  return async function draw(file, stand) {
    const scene = new Scene(engine);
    scene.useRightHandedSystem = true;
    scene.clearColor = new Color4(0, 0, 0, 1);
    const place = Matrix.FromArray(stand.matrix);
    const eye = new FreeCamera("eye", Vector3.TransformCoordinates(Vector3.Zero(), place), scene);
    eye.upVector = Vector3.TransformNormal(Vector3.Up(), place);
    eye.setTarget(Vector3.TransformCoordinates(new Vector3(0, 0, -1), place));
    eye.fov = (stand.fov * Math.PI) / 180;
    eye.minZ = stand.near;
    eye.maxZ = stand.far;
    const { meshes } = await ImportMeshAsync(file, scene, { pluginOptions: { splat: SPLAT } });
    for (const mesh of file.endsWith(".glb") ? [] : meshes) {
      mesh.scaling.set(1, 1, 1); // Babylon turns what is not glTF: the axes of the file instead
      mesh.rotation.set(0, 0, 0);
    }
    await scene.whenReadyAsync(); // a worker sorts splats before any is drawn, however long it takes
    let picture = "";
    for (let same = 0; same < 3; ) {
      for (let frame = 0; frame < 4; frame++) {
        scene.render();
        await new Promise((resolve) => setTimeout(resolve, 50));
      }
      const now = canvas.toDataURL();
      same = now === picture ? same + 1 : 0;
      picture = now;
    }
    scene.dispose();
    return picture;
  };
}
