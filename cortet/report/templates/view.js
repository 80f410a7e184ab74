// Draws what cortet/report/boundary_view.py made, with three.js. Nothing is fetched.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("boundary").textContent);
  const panel = document.getElementById("view");
  const canvas = panel.querySelector("canvas");
  const picked = document.getElementById("picked");

  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
  const places = Float32Array.from(new Uint16Array(bytes(data.points)), (value, i) => data.low[i % 3] + data.step * value);
  const faces = data.index_bytes === 2 ? new Uint16Array(bytes(data.faces)) : new Uint32Array(bytes(data.faces));
  const q = Float32Array.from(new Uint16Array(bytes(data.q)), (value) => value / 65535);

  function colour(value) {
    const [low, high] = data.range, last = data.colours.length - 1;
    if (value > high) return data.beyond;
    const at = Math.max(0, (last * (value - low)) / (high - low)), below = Math.min(Math.floor(at), last - 1);
    return data.colours[below].map((part, k) => part + (at - below) * (data.colours[below + 1][k] - part));
  }

  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(Float32Array.from([...q].flatMap(colour), (part) => part / 255), 3));
  geometry.setIndex(new THREE.BufferAttribute(faces, 1));
  geometry.computeVertexNormals();
  geometry.computeBoundingSphere();
  const { center: middle, radius } = geometry.boundingSphere;

  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
  } catch {
    return; // no WebGL here: the page says so
  }
  document.getElementById("no-view").hidden = true;
  panel.hidden = false;
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));

  const scene = new THREE.Scene();
  const shell = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide }));
  scene.add(shell, new THREE.AmbientLight(0xffffff, 0.45));
  const marks = new THREE.Group();
  const dot = new THREE.SphereGeometry(0.013 * radius, 16, 12);
  const pink = new THREE.MeshBasicMaterial({ color: 0xe0218a, depthTest: false, transparent: true, opacity: 0.85 });
  for (const { centre } of data.worst) {
    const mark = new THREE.Mesh(dot, pink);
    mark.position.set(...centre);
    marks.add(mark);
  }
  scene.add(marks);

  const camera = new THREE.PerspectiveCamera(25, 1, 0.01 * radius, 100 * radius);
  const lamp = new THREE.DirectionalLight(0xffffff, 0.65);
  camera.add(lamp);
  scene.add(camera);
  const controls = new THREE.TrackballControls(camera, canvas);
  canvas.style.touchAction = "pan-y"; // a finger can still scroll the page past the view
  controls.staticMoving = true;
  controls.rotateSpeed = 3;
  controls.noZoom = true; // until the view has the focus, so that the wheel scrolls the page
  controls.keys = [];
  canvas.addEventListener("focus", () => (controls.noZoom = false));
  canvas.addEventListener("blur", () => (controls.noZoom = true));

  const FROM = {
    left: [-1, 0, 0], right: [1, 0, 0], front: [0, 1, 0], back: [0, -1, 0], top: [0, 0, 1], bottom: [0, 0, -1],
  };
  function lookFrom(side) {
    const [x, y, z] = FROM[side];
    controls.target.copy(middle);
    const narrow = Math.min(1, camera.aspect);
    camera.position.set(x, y, z).multiplyScalar(radius / Math.sin((Math.PI / 180) * 12.5) / narrow).add(middle);
    camera.up.set(0, z ? 1 : 0, z ? 0 : 1);
    draw();
  }
  function zoom(factor) {
    camera.position.sub(controls.target).multiplyScalar(factor).add(controls.target);
    draw();
  }
  function turn(right, up) {
    const eye = camera.position.clone().sub(controls.target);
    const side = new THREE.Vector3().crossVectors(camera.up, eye).normalize();
    const angle = Math.PI / 24;
    const spin = new THREE.Quaternion().setFromAxisAngle(camera.up.clone().normalize(), -right * angle);
    spin.multiply(new THREE.Quaternion().setFromAxisAngle(side, up * angle));
    camera.up.applyQuaternion(spin);
    camera.position.copy(eye.applyQuaternion(spin)).add(controls.target);
    draw();
  }
  function draw() {
    controls.update();
    renderer.render(scene, camera);
  }
  function resize() {
    const { clientWidth: width, clientHeight: height } = canvas;
    if (!width) return;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    controls.handleResize();
    draw();
  }
  function tell(event) {
    const box = canvas.getBoundingClientRect();
    const at = new THREE.Vector2((2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height);
    const caster = new THREE.Raycaster();
    caster.setFromCamera(at, camera);
    const [hit] = caster.intersectObject(shell);
    if (!hit) return;
    const nodes = [hit.face.a, hit.face.b, hit.face.c];
    const place = hit.point.toArray().map((value) => value.toFixed(2)).join(", ");
    picked.textContent = `q ${Math.max(...nodes.map((node) => q[node])).toFixed(3)} at (${place}) mm`;
  }

  const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  canvas.addEventListener("keydown", (event) => {
    if (KEYS[event.key]) turn(...KEYS[event.key]);
    else if (event.key === "+" || event.key === "=") zoom(0.8);
    else if (event.key === "-") zoom(1.25);
    else return;
    event.preventDefault();
  });
  canvas.addEventListener("click", tell);
  // the controls tell of a move only when they are asked for it
  for (const kind of ["pointermove", "wheel"]) canvas.addEventListener(kind, () => requestAnimationFrame(draw));
  for (const button of panel.querySelectorAll("[data-from]")) button.addEventListener("click", () => lookFrom(button.dataset.from));
  for (const button of panel.querySelectorAll("[data-zoom]")) button.addEventListener("click", () => zoom(+button.dataset.zoom));
  document.getElementById("marks").addEventListener("change", (event) => {
    marks.visible = event.target.checked;
    draw();
  });
  new ResizeObserver(resize).observe(canvas);
  addEventListener("scroll", () => controls.handleResize(), { passive: true });
  resize();
  lookFrom(middle.x < 0 ? "left" : "right");
})();
