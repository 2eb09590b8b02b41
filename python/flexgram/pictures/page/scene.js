/* The body in space: turned by mouse, touch and keys; its modes and load history move. */
"use strict";

(function () {
  const place = document.getElementById("scene");
  if (!place) return;
  const data = JSON.parse(document.getElementById("scene-data").textContent);
  const VIRIDIS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
  const MARKS = data.colours.marks, PLAIN = new THREE.Color(data.colours.plain);

  function bytes(text) {
    const raw = atob(text), all = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; ++i) all[i] = raw.charCodeAt(i);
    return all.buffer;
  }
  function shorts(packed) {
    const whole = new Int16Array(bytes(packed.values)), all = new Float32Array(whole.length);
    for (let i = 0; i < whole.length; ++i) all[i] = whole[i] * packed.unit;
    return all;
  }
  function colour(share, into, at) {
    const x = 4 * Math.min(Math.max(share, 0), 1), k = Math.min(Math.floor(x), 3), f = x - k;
    for (let c = 0; c < 3; ++c)
      into[at + c] = (VIRIDIS[k][c] * (1 - f) + VIRIDIS[k + 1][c] * f) / 255;
  }
  function number(x) {
    return Number(x.toPrecision(4)).toString();
  }

  const rest = shorts({ values: data.points, unit: data.unit });
  const count = rest.length / 3;
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  } catch (error) {
    place.querySelector(".told").textContent =
      "This browser cannot draw in space (WebGL is off): the picture does not move.";
    return;
  }
  const view = place.querySelector(".view"), canvas = renderer.domElement;
  renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
  renderer.setClearColor(0xffffff);
  canvas.tabIndex = 0;
  canvas.setAttribute("role", "application");
  canvas.setAttribute("aria-label", "the body; arrow keys turn it, + and - zoom, space plays");
  view.appendChild(canvas);

  const scene = new THREE.Scene(), radius = data.size / 2;
  const camera = new THREE.PerspectiveCamera(data.look.angle, 1, 0.01 * radius, 100 * radius);
  camera.up.set(0, 0, 1);
  const controls = new THREE.OrbitControls(camera, canvas);
  controls.enableKeys = false;
  controls.addEventListener("change", draw);
  /* From a direction, as near as the box of the body allows. */
  function look(direction) {
    const near = direction.normalize(), right = camera.up.clone().cross(near).normalize();
    const up = near.clone().cross(right);
    const tangent = data.look.fill * Math.tan(data.look.angle * Math.PI / 360);
    const aspect = Math.min(view.clientWidth / view.clientHeight, data.look.aspect);
    let distance = 1.2 * radius;
    for (let k = 0; k < 8; ++k) {
      const corner = new THREE.Vector3(
        data.low[0] * (k & 1 ? 1 : -1), data.low[1] * (k & 2 ? 1 : -1),
        data.low[2] * (k & 4 ? 1 : -1));
      const size = Math.max(Math.abs(corner.dot(up)), Math.abs(corner.dot(right)) / aspect);
      distance = Math.max(distance, corner.dot(near) + size / tangent);
    }
    camera.position.copy(near.multiplyScalar(distance));
    controls.target.set(0, 0, 0);
    controls.update();
  }

  scene.add(new THREE.AmbientLight(0xffffff, 0.55));
  const lamp = new THREE.DirectionalLight(0xffffff, 0.6);
  camera.add(lamp);
  scene.add(camera);

  const positions = new THREE.BufferAttribute(new Float32Array(rest), 3);
  const colours = new THREE.BufferAttribute(new Float32Array(rest.length), 3);
  const surface = new THREE.BufferGeometry();
  surface.setAttribute("position", positions);
  surface.setAttribute("color", colours);
  surface.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes(data.triangles)), 1));
  scene.add(new THREE.Mesh(surface, new THREE.MeshPhongMaterial({
    vertexColors: THREE.VertexColors, side: THREE.DoubleSide, flatShading: true, shininess: 10,
    polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1
  })));
  const beams = new THREE.BufferGeometry();
  beams.setAttribute("position", positions);
  beams.setAttribute("color", colours);
  beams.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes(data.lines)), 1));
  scene.add(new THREE.LineSegments(beams, new THREE.LineBasicMaterial({
    vertexColors: THREE.VertexColors, linewidth: 2
  })));
  const still = new THREE.BufferGeometry();
  still.setAttribute("position", new THREE.BufferAttribute(rest, 3));
  still.setIndex(surface.index);
  const outline = new THREE.LineSegments(
    new THREE.EdgesGeometry(still, 30), new THREE.LineBasicMaterial({
      color: 0x1c2733, transparent: true, opacity: 0.35
    }));
  scene.add(outline);

  /* The axes of the mesh, at the corner of the body. */
  const corner = new THREE.Vector3(data.low[0], data.low[1], data.low[2]);
  const triad = new THREE.AxesHelper(0.18 * data.size);
  triad.position.copy(corner);
  scene.add(triad);
  const labels = [];
  ["x", "y", "z"].forEach(function (name, k) {
    const label = document.createElement("span"), end = corner.clone();
    end.setComponent(k, end.getComponent(k) + 0.2 * data.size);
    label.className = "axis";
    label.textContent = name;
    view.appendChild(label);
    labels.push({ mean: end, label: label, points: null });
  });
  Object.keys(data.interfaces).forEach(function (name, k) {
    const own = data.interfaces[name], mark = MARKS[k % MARKS.length];
    const dots = new THREE.BufferGeometry();
    if (own.drawn.length) { /* they move with the body */
      dots.setAttribute("position", positions);
      dots.setIndex(own.drawn);
    } else {
      dots.setAttribute("position", new THREE.BufferAttribute(new Float32Array(own.points), 3));
    }
    const points = new THREE.Points(dots, new THREE.PointsMaterial({
      color: mark, size: 5, sizeAttenuation: false
    }));
    points.frustumCulled = false;
    scene.add(points);
    const mean = new THREE.Vector3(own.middle[0], own.middle[1], own.middle[2]);
    const label = document.createElement("span");
    label.className = "label";
    label.textContent = name;
    label.style.borderColor = mark;
    view.appendChild(label);
    labels.push({ mean: mean, label: label, points: points });
  });

  /* What is shown: a motion by its number, the history, or the body at rest. */
  const motions = data.motions.map(shorts);
  const history = data.history && {
    times: data.history.times, weights: data.history.weights, most: data.history.most,
    largest: data.history.largest, shapes: data.history.shapes.map(shorts),
    stress: data.history.stress ? new Uint8Array(bytes(data.history.stress)) : null
  };
  const chooser = place.querySelector("select"), play = place.querySelector(".play");
  const size = place.querySelector(".size"), moment = place.querySelector(".moment");
  const told = place.querySelector(".told"), bar = place.querySelector(".bar");
  const slow = window.matchMedia && window.matchMedia("(prefers-reduced-motion: reduce)").matches;
  let shown = "rest", playing = false, phase = 0, last = 0, largest = 1;

  function moved(field, factor) {
    const x = positions.array;
    for (let i = 0; i < x.length; ++i) x[i] = rest[i] + factor * field[i];
    positions.needsUpdate = true;
  }
  function amounts(field) {
    let most = 0;
    const all = new Float32Array(count);
    for (let i = 0; i < count; ++i) {
      all[i] = Math.hypot(field[3 * i], field[3 * i + 1], field[3 * i + 2]);
      most = Math.max(most, all[i]);
    }
    return { all: all, most: most };
  }
  function paint(shares) {
    for (let i = 0; i < count; ++i) {
      const share = shares(i);
      if (share < 0) colours.array.set([0.8, 0.8, 0.8], 3 * i);
      else colour(share, colours.array, 3 * i);
    }
    colours.needsUpdate = true;
  }
  function plain() {
    for (let i = 0; i < count; ++i) PLAIN.toArray(colours.array, 3 * i);
    colours.needsUpdate = true;
  }
  function scaleBar(from, to, words) {
    bar.hidden = !words;
    if (!words) return;
    bar.querySelector(".from").textContent = from;
    bar.querySelector(".to").textContent = to;
    bar.querySelector(".words").textContent = words;
  }
  function magnified() {
    return Number(size.value) * 0.07 * data.size;
  }
  function show(which) {
    shown = which;
    chooser.value = which;
    moment.parentElement.hidden = which !== "history";
    document.querySelectorAll("[data-motion]").forEach(function (row) {
      row.setAttribute("aria-pressed", String(row.dataset.motion === which));
    });
    phase = 0.25;
    play.disabled = which === "rest";
    if (which === "rest") {
      moved(rest, 0);
      plain();
      scaleBar("", "", "");
      stop();
      told.textContent = "";
    } else if (which === "history") {
      atMoment();
    } else {
      const own = amounts(motions[Number(which)]);
      largest = own.most || 1;
      paint(function (i) { return own.all[i] / largest; });
      scaleBar("0", "largest", "displacement");
      told.textContent = data.motions[Number(which)].name;
      if (!slow) start();
    }
    place_now();
  }
  function atMoment() {
    const k = Number(moment.value), field = new Float32Array(rest.length);
    history.shapes.forEach(function (shape, j) {
      const w = history.weights[k][j];
      for (let i = 0; i < field.length; ++i) field[i] += w * shape[i];
    });
    moved(field, magnified() / (history.largest || 1));
    const own = amounts(field);
    if (history.stress) {
      const at = k * count; // 255: none is known there
      paint(function (i) {
        return history.stress[at + i] === 255 ? -1 : history.stress[at + i] / 254;
      });
      scaleBar("0", number(history.most / 1e6) + " MPa", "von Mises stress; grey: not known");
    } else {
      paint(function (i) { return own.all[i] / (history.largest || 1); });
      scaleBar("0", number(1e3 * history.largest) + " mm", "displacement");
    }
    told.textContent = "t = " + number(history.times[k]) + " s, largest displacement " +
      number(1e3 * own.most) + " mm";
  }
  function place_now() {
    if (shown !== "rest" && shown !== "history")
      moved(motions[Number(shown)], Math.sin(2 * Math.PI * phase) * magnified() / largest);
    draw();
  }
  let waiting = 0; // the frame that is asked for
  function tick(time) {
    waiting = 0;
    if (!playing) return;
    const passed = Math.min(Math.max((time - last) / 1000, 0), 0.1);
    last = time;
    if (shown === "history") {
      phase += passed * 12;
      if (phase >= 1) {
        moment.value = (Number(moment.value) + Math.floor(phase)) % history.times.length;
        phase %= 1;
        atMoment();
      }
    } else {
      phase += 0.6 * passed;
    }
    place_now();
    ask();
  }
  function ask() {
    if (!waiting) waiting = window.requestAnimationFrame(tick);
  }
  function start() {
    if (playing || shown === "rest") return;
    playing = true;
    last = window.performance.now();
    play.textContent = "pause";
    told.setAttribute("aria-live", "off");
    ask();
  }
  function stop() {
    playing = false;
    play.textContent = "play";
    told.setAttribute("aria-live", "polite");
  }
  function draw() {
    renderer.render(scene, camera);
    const at = new THREE.Vector3();
    const placed = []; // names at the same place stand below each other
    labels.forEach(function (one) {
      at.copy(one.mean).project(camera);
      one.label.style.visibility = at.z < 1 ? "visible" : "hidden";
      const x = 50 + 50 * at.x;
      let y = 50 - 50 * at.y;
      while (one.points && placed.some(function (other) {
        return Math.abs(other[0] - x) < 12 && Math.abs(other[1] - y) < 5;
      })) y += 5;
      if (one.points) placed.push([x, y]);
      one.label.style.left = x + "%";
      one.label.style.top = y + "%";
    });
  }
  function fit() {
    const width = view.clientWidth, height = view.clientHeight;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    draw();
  }

  chooser.addEventListener("change", function () { show(chooser.value); });
  play.addEventListener("click", function () { if (playing) stop(); else start(); });
  size.addEventListener("input", function () {
    if (shown === "history") atMoment();
    place_now();
  });
  moment.addEventListener("input", function () { stop(); atMoment(); draw(); });
  if (history) {
    moment.max = history.times.length - 1;
    moment.value = data.history.worst;
  }
  place.querySelector(".names").addEventListener("change", function (event) {
    labels.forEach(function (one) {
      if (!one.points) return;
      one.points.visible = event.target.checked;
      one.label.hidden = !event.target.checked;
    });
    draw();
  });
  place.querySelectorAll("[data-look]").forEach(function (button) {
    button.addEventListener("click", function () {
      const d = button.dataset.look.split(",").map(Number);
      look(new THREE.Vector3(d[0], d[1], d[2]));
      draw();
    });
  });
  document.querySelectorAll("[data-motion]").forEach(function (row) {
    row.addEventListener("click", function () {
      show(row.dataset.motion);
      place.scrollIntoView({ block: "nearest" });
    });
  });
  canvas.addEventListener("keydown", function (event) {
    const turn = new THREE.Spherical().setFromVector3(
      new THREE.Vector3(camera.position.x, camera.position.z, -camera.position.y));
    const step = Math.PI / 24;
    if (event.key === "ArrowLeft") turn.theta -= step;
    else if (event.key === "ArrowRight") turn.theta += step;
    else if (event.key === "ArrowUp") turn.phi -= step;
    else if (event.key === "ArrowDown") turn.phi += step;
    else if (event.key === "+" || event.key === "=") turn.radius /= 1.1;
    else if (event.key === "-") turn.radius *= 1.1;
    else if (event.key === " ") play.click();
    else return;
    event.preventDefault();
    turn.makeSafe();
    const to = new THREE.Vector3().setFromSpherical(turn);
    camera.position.set(to.x, -to.z, to.y);
    controls.update();
    draw();
  });
  window.addEventListener("resize", fit);
  look(new THREE.Vector3().fromArray(data.look.from));
  fit();
  show(history ? "history" : motions.length ? "0" : "rest");
  view.querySelector(".still").remove();
  place.dataset.ready = "yes";
})();
