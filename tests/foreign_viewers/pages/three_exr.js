// The first part of an EXR as three.js decodes it, by code of its own, over the whole canvas.
import * as THREE from "three";
import { EXRLoader } from "three/addons/loaders/EXRLoader.js";

export async function viewer(canvas) {
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: false, preserveDrawingBuffer: true });
  renderer.setPixelRatio(1);
  renderer.setSize(canvas.width, canvas.height, false);
  return async function draw(file) {
    const map = await new EXRLoader().loadAsync(file);
    map.minFilter = map.magFilter = THREE.NearestFilter;
    const scene = new THREE.Scene();
    scene.add(new THREE.Mesh(new THREE.PlaneGeometry(2, 2), new THREE.MeshBasicMaterial({ map })));
    renderer.render(scene, new THREE.OrthographicCamera(-1, 1, 1, -1, -1, 1));
    return canvas.toDataURL();
  };
}
