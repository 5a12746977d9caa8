import { THREE } from "nicegui-scene";

// Points as marks of constant size on the screen: one shape for all, a colour for each.

const SIDE = 64;
const PATHS = {
  disc: (c) => c.arc(32, 32, 22, 0, 2 * Math.PI),
  diamond: (c) => [[32, 5], [59, 32], [32, 59], [5, 32]].forEach(([x, y]) => c.lineTo(x, y)),
  triangle: (c) => [[32, 6], [58, 54], [6, 54]].forEach(([x, y]) => c.lineTo(x, y)),
  square: (c) => c.rect(12, 12, 40, 40),
};

function texture(shape, hollow) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = SIDE;
  const c = canvas.getContext("2d");
  c.beginPath();
  PATHS[shape](c);
  c.closePath();
  c.lineJoin = "round";
  if (!hollow) {
    c.fillStyle = "#fff";
    c.fill();
  }
  c.lineWidth = hollow ? 8 : 5;
  c.strokeStyle = hollow ? "#fff" : "rgba(20, 26, 33, 0.85)"; // white takes the point's own colour
  c.stroke();
  const result = new THREE.CanvasTexture(canvas);
  result.colorSpace = THREE.SRGBColorSpace;
  return result;
}

function linear(r, g, b) {
  const colour = new THREE.Color().setRGB(r, g, b, THREE.SRGBColorSpace);
  return [colour.r, colour.g, colour.b];
}

export default class Marks {
  create_mesh(shape, hollow, size, length, values) {
    const material = new THREE.PointsMaterial({
      size,
      sizeAttenuation: false,
      map: texture(shape, hollow),
      vertexColors: true,
      transparent: true,
      alphaTest: 0.3,
    });
    material.onBeforeCompile = (shader) => {
      // smaller from afar, larger when near, never too small to see;
      // and 5 mm towards the camera: a touch by the nominal robot may lie inside its sphere
      const scaled = `gl_PointSize = size * clamp(2.4 / -mvPosition.z, 0.55, 1.4);
        gl_Position = projectionMatrix * vec4(mvPosition.xy, mvPosition.z + 0.005, 1.0);`;
      shader.vertexShader = shader.vertexShader.replace("gl_PointSize = size;", scaled);
    };
    this.mesh = new THREE.Points(new THREE.BufferGeometry(), material);
    this.mesh.frustumCulled = false;
    this.mesh.raycast = () => {};
    this.room = 0;
    const places = Array.from({ length }, (_, place) => place);
    this.set_marks(length, places, values);
    return this.mesh;
  }

  // values: x, y, z, red, green, blue of each place
  set_marks(length, places, values) {
    if (length > this.room) this.grow(length);
    const { position, color } = this.mesh.geometry.attributes;
    places.forEach((place, index) => {
      const [x, y, z, r, g, b] = values.slice(6 * index, 6 * index + 6);
      position.setXYZ(place, x, y, z);
      color.setXYZ(place, ...linear(r, g, b));
    });
    if (this.room) position.needsUpdate = color.needsUpdate = true;
    this.mesh.geometry.setDrawRange(0, length);
  }

  grow(length) {
    const old = this.mesh.geometry;
    const geometry = new THREE.BufferGeometry();
    this.room = Math.max(64, 2 * length);
    for (const name of ["position", "color"]) {
      const array = new Float32Array(3 * this.room);
      if (old.attributes[name]) array.set(old.attributes[name].array);
      geometry.setAttribute(name, new THREE.BufferAttribute(array, 3));
    }
    this.mesh.geometry = geometry;
    old.dispose();
  }
}
