// Points and meshes of PLY files in three.js, in the colours of their vertices, unlit.
import * as THREE from "three";
import { PLYLoader } from "three/addons/loaders/PLYLoader.js";

const WIDE = 7; // px of a point: more than their distance, so that no gaps are left

export async function viewer(canvas) {
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: false, preserveDrawingBuffer: true });
  renderer.setPixelRatio(1);
  renderer.setSize(canvas.width, canvas.height, false);
  return async function draw(file, stand) {
    const eye = new THREE.PerspectiveCamera(stand.fov, canvas.width / canvas.height, stand.near, stand.far);
    new THREE.Matrix4().fromArray(stand.matrix).decompose(eye.position, eye.quaternion, eye.scale);
    const geometry = await new PLYLoader().loadAsync(file);
    const scene = new THREE.Scene();
    scene.add(
      geometry.index
        ? new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ vertexColors: true }))
        : new THREE.Points(geometry, new THREE.PointsMaterial({ vertexColors: true, size: WIDE, sizeAttenuation: false })),
    );
    renderer.render(scene, eye);
    return canvas.toDataURL();
  };
}
