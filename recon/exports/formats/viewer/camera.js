// The camera: where it stands, and how mouse, fingers and keys move it.
"use strict";

const plus = (a, b, factor = 1) => a.map((part, i) => part + factor * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** A vector turned about a unit one (Rodrigues). */
function turned(vector, about, angle) {
  const along = dot(about, vector) * (1 - Math.cos(angle)), side = cross(about, vector);
  return vector.map((part, i) => part * Math.cos(angle) + side[i] * Math.sin(angle) + about[i] * along);
}

class Camera {
  /** Stand where a view of the scene does. axes: to the right, down and ahead, in the world. */
  standAt(view) {
    this.axes = [0, 1, 2].map((row) => view.turn.slice(3 * row, 3 * row + 3));
    this.centre = view.centre;
    this.lens = view;
    this.away = 1;  // of what it is turned about: what views look at is about that far in scene coordinates
  }

  turn(about, angle) {
    this.axes = this.axes.map((axis) => turned(axis, about, angle));
  }

  orbit(right, down) {
    const middle = plus(this.centre, this.axes[2], this.away);
    this.look(right, down);
    this.centre = plus(middle, this.axes[2], -this.away);
  }

  look(right, down) {
    this.turn(facts.up, -right);
    this.turn(this.axes[0], -down);
  }

  /** Move by shares of the distance. */
  shift(right, down, ahead) {
    const [x, y, z] = this.axes;
    this.centre = plus(plus(plus(this.centre, x, right * this.away), y, down * this.away), z, ahead * this.away);
  }

  nearer(factor) {
    const next = Math.min(Math.max(this.away / factor, 0.02), 100);
    this.centre = plus(this.centre, this.axes[2], this.away - next);
    this.away = next;
  }
}

/** Let mouse and fingers move the camera; `moved` is called after each step, `measured` where one was put. */
function listen(camera, moved, measured) {
  const fingers = new Map();
  let path = 0;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    path = fingers.size > 1 ? Infinity : 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = fingers.get(event.pointerId);
    if (!last) return;
    const now = [event.clientX, event.clientY], step = [now[0] - last[0], now[1] - last[1]];
    path += Math.hypot(...step);
    if (path < 4) return;
    const focal = lensOf(camera).focal[0] * (canvas.clientWidth / canvas.width);
    if (fingers.size === 1 && event.buttons === 1 && !event.shiftKey) {
      camera.orbit(step[0] / 200, step[1] / 200);
    } else {
      const other = [...fingers].find(([id]) => id !== event.pointerId);
      camera.shift(-step[0] / focal / fingers.size, -step[1] / focal / fingers.size, 0);
      if (other) {
        const span = (place) => Math.hypot(place[0] - other[1][0], place[1] - other[1][1]) || 1;
        camera.nearer(span(now) / span(last));
      }
    }
    fingers.set(event.pointerId, now);
    moved();
  });
  const lifted = (event) => {
    if (fingers.delete(event.pointerId) && event.type === "pointerup" && path < 4) measured(event);
  };
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, lifted);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    camera.nearer(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)));
    moved();
  }, { passive: false });
}

const HELD = {
  w: (camera, by) => camera.shift(0, 0, by),
  s: (camera, by) => camera.shift(0, 0, -by),
  a: (camera, by) => camera.shift(-by, 0, 0),
  d: (camera, by) => camera.shift(by, 0, 0),
  q: (camera, by) => camera.shift(0, by, 0),
  e: (camera, by) => camera.shift(0, -by, 0),
  arrowleft: (camera, by) => camera.look(by, 0),
  arrowright: (camera, by) => camera.look(-by, 0),
  arrowup: (camera, by) => camera.look(0, by),
  arrowdown: (camera, by) => camera.look(0, -by),
};
