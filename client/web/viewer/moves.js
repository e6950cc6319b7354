// SPDX-License-Identifier: Apache-2.0
// Moving the camera: orbit around a point, or walk. Pointer, touch, keys, and buttons for touch.
import * as THREE from "./three/build/three.module.js";
import { OrbitControls } from "./three/examples/jsm/controls/OrbitControls.js";

const KEYS = { KeyW: [0, 0, 1], ArrowUp: [0, 0, 1], KeyS: [0, 0, -1], ArrowDown: [0, 0, -1], KeyA: [-1, 0, 0],
  ArrowLeft: [-1, 0, 0], KeyD: [1, 0, 0], ArrowRight: [1, 0, 0], KeyQ: [0, -1, 0], KeyE: [0, 1, 0] };
const TURN_A_PIXEL = 0.004, TURN_A_SECOND = 1.2;

export class Moves {
  #camera;
  #controls;
  #size;
  #mode = "orbit";
  #held = new Set();
  #drag = null;

  /** size: length of the scene in metres. changed(): the camera moved. */
  constructor(camera, canvas, pad, { target, size, changed }) {
    this.#camera = camera;
    this.#size = size;
    this.#controls = new OrbitControls(camera, canvas);
    Object.assign(this.#controls, { enableKeys: false, maxPolarAngle: Math.PI * 0.499, screenSpacePanning: true });
    this.#controls.target.set(...target);
    this.#controls.update();
    this.#controls.addEventListener("change", changed);
    this.changed = changed;
    canvas.addEventListener("pointerdown", (event) => {
      this.#drag = this.#mode === "walk" ? [event.clientX, event.clientY] : null;
    });
    canvas.addEventListener("pointermove", (event) => this.#turnBy(event));
    for (const name of ["pointerup", "pointercancel", "pointerleave"]) {
      canvas.addEventListener(name, () => {
        this.#drag = null;
      });
    }
    addEventListener("keyup", ({ code }) => this.#held.delete(code));
    addEventListener("blur", () => this.#held.clear());
    pad.querySelectorAll("button").forEach((button) => {
      button.addEventListener("pointerdown", () => this.#held.add(button.dataset.key));
      button.addEventListener("click", ({ detail }) => detail === 0 && this.#step(KEYS[button.dataset.key], 0.3));
      for (const name of ["pointerup", "pointercancel", "pointerleave"]) {
        button.addEventListener(name, () => this.#held.delete(button.dataset.key));
      }
    });
  }

  get mode() {
    return this.#mode;
  }

  get target() {
    return this.#controls.target.toArray();
  }

  set mode(mode) {
    this.#mode = mode;
    this.#controls.enabled = mode === "orbit";
    if (mode === "orbit") { // Around a point ahead, so that the picture stays
      const ahead = this.#camera.getWorldDirection(new THREE.Vector3()).multiplyScalar(this.#size / 4);
      this.#controls.target.copy(this.#camera.position).add(ahead);
      this.#controls.update();
    }
  }

  /** Returns true if the key is one of the camera's. */
  press(code) {
    if (KEYS[code]) {
      this.#held.add(code);
    }
    return Boolean(KEYS[code]);
  }

  #turnBy(event) {
    if (this.#drag) {
      this.#turn((this.#drag[0] - event.clientX) * TURN_A_PIXEL, (this.#drag[1] - event.clientY) * TURN_A_PIXEL);
      this.#drag = [event.clientX, event.clientY];
    }
  }

  /** Turns the view. */
  #turn(yaw, pitch) {
    const { position, up } = this.#camera, direction = this.#camera.getWorldDirection(new THREE.Vector3());
    const angle = direction.angleTo(up), next = THREE.Math.clamp(angle - pitch, 0.05, Math.PI - 0.05);
    direction.applyAxisAngle(direction.clone().cross(up).normalize(), angle - next).applyAxisAngle(up, yaw);
    this.#camera.lookAt(position.clone().add(direction));
    this.changed();
  }

  /** Turns the camera around the target. */
  #orbit([x, y, z], seconds) {
    const { position, up } = this.#camera, { target } = this.#controls;
    const arm = position.clone().sub(target), angle = arm.angleTo(up);
    const next = THREE.Math.clamp(angle - y * TURN_A_SECOND * seconds, 0.02, this.#controls.maxPolarAngle);
    arm.applyAxisAngle(up.clone().cross(arm).normalize(), next - angle).applyAxisAngle(up, x * TURN_A_SECOND * seconds);
    arm.multiplyScalar(1 - z * seconds);
    position.copy(target).add(arm);
    this.#controls.update();
  }

  #walk([x, y, z], seconds) {
    const { position, up } = this.#camera, direction = this.#camera.getWorldDirection(new THREE.Vector3());
    const flat = direction.clone().addScaledVector(up, -direction.dot(up)).normalize();
    const right = flat.clone().cross(up), far = seconds * Math.max(this.#size / 40, 1.5);
    position.addScaledVector(flat, z * far).addScaledVector(right, x * far).addScaledVector(up, y * far);
    this.changed();
  }

  #step(move, seconds) {
    if (this.#mode === "walk") {
      this.#walk(move, seconds);
    } else {
      this.#orbit(move, seconds);
    }
  }

  /** Moves by the keys that are held; call it each frame. */
  frame(seconds) {
    const move = [0, 0, 0];
    this.#held.forEach((code) => KEYS[code].forEach((each, axis) => {
      move[axis] += each;
    }));
    if (move.some((each) => each !== 0)) {
      this.#step(move, Math.min(seconds, 0.2));
    }
  }
}
