// Spark, splats for three.js, as it is without settings.
import * as THREE from "three";
import { SparkRenderer, SplatMesh } from "@sparkjsdev/spark";

const TONES = { none: THREE.NoToneMapping, aces: THREE.ACESFilmicToneMapping };

export async function viewer(canvas) {
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: false, preserveDrawingBuffer: true });
  renderer.setPixelRatio(1);
  renderer.setSize(canvas.width, canvas.height, false);
  const spark = new SparkRenderer({ renderer });
  const scene = new THREE.Scene();
  scene.add(spark);
  return async function draw(file, stand, tones) {
    renderer.toneMapping = TONES[tones];
    const eye = new THREE.PerspectiveCamera(stand.fov, canvas.width / canvas.height, stand.near, stand.far);
    new THREE.Matrix4().fromArray(stand.matrix).decompose(eye.position, eye.quaternion, eye.scale);
    scene.add(eye);
    eye.updateMatrixWorld(true);
    const splats = new SplatMesh({ url: file });
    await splats.initialized;
    scene.add(splats);
    let picture = "";
    for (let same = 0; same < 3; ) {
      for (let frame = 0; frame < 4; frame++) {
        renderer.render(scene, eye);
        await new Promise((resolve) => setTimeout(resolve, 50));
      }
      const now = canvas.toDataURL();
      const sorted = spark.activeSplats > 0 && !spark.sorting && !spark.sortDirty; // by a worker
      same = sorted && now === picture ? same + 1 : 0;
      picture = now;
    }
    scene.remove(splats, eye);
    splats.dispose();
    return picture;
  };
}
