// Copyright 2026 The RPO stack authors
// SPDX-License-Identifier: Apache-2.0
// Flights, over or still running: a scene of three.js, the time line below it, the numbers beside it.
// Frame: target LVLH, x R-bar (outward, up on the screen), y V-bar, z H-bar; metres, seconds.
'use strict';

const el = id => document.getElementById(id);
const DATA = JSON.parse(el('data').textContent);
const AXES = ['x R-bar', 'y V-bar', 'z H-bar'], AXIS_COLOURS = ['x', 'y', 'z'];
const HUES = ['x', 'y', 'z', 'optimum', 'small_positive', 'muted'];
const SPEEDS = [0.2, 0.5, 1, 2, 5, 10, 20, 50, 100];
const REDRAW_MS = 80;   // the numbers beside the scene change so often at most
const SLOW_MS = 30;     // frames that take longer are drawn with fewer pixels, while the replay plays
const PATH_POINTS = 300;
const CAMERA = 5;       // length of a field of view, in sizes of the chaser
const V = (x, y, z) => new THREE.Vector3(x, y, z);
const colour = name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

// ---------------------------------------------------------------- flights

function floats(text) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return new Float32Array(bytes.buffer);
}

class Flight {
  constructor(data, number) {
    Object.assign(this, data);
    this.number = number;
    for (const name of ['times', 'states', 'forces', 'reference', 'estimate', 'attitudes', 'chaser'])
      this[name] = data[name] && floats(data[name]);
    for (const limit of this.limits) limit.values = floats(limit.values);
    this.turns = data.turns.map(([name, unit, values]) => [name, unit, floats(values)]);
    this.last = this.times.length - 1;
    this.end = this.times[this.last];
  }
  extend(more) {  // take what was flown since, of a flight that is still running
    const joined = (own, text) => {
      const added = floats(text), made = new Float32Array(own.length + added.length);
      made.set(own);
      made.set(added, own.length);
      return made;
    };
    for (const name of ['times', 'states', 'forces', 'reference', 'estimate', 'attitudes', 'chaser'])
      if (this[name]) this[name] = joined(this[name], more[name]);
    this.limits.forEach((limit, k) => { limit.values = joined(limit.values, more.limits[k].values); });
    this.turns = this.turns.map(([name, unit, values], k) => [name, unit, joined(values, more.turns[k][2])]);
    Object.assign(this, { phases: more.phases, acts: more.acts, verdict: more.verdict });
    if (this.reasons && more.reasons) {
      this.reasons.words.push(...more.reasons.words);
      this.reasons.samples.push(...more.reasons.samples);
    }
    this.last = this.times.length - 1;
    this.end = this.times[this.last];
  }
  index(t) {  // of the last sample at or before t
    let low = 0, high = this.last;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.times[middle] <= t + 1e-4) low = middle; else high = middle - 1;
    }
    return low;
  }
  // The state at a time: between samples the cubic through both positions and velocities.
  at(t) {
    const i = Math.min(this.index(t), Math.max(0, this.last - 1)), s = this.states;
    const h = this.times[i + 1] - this.times[i] || 1, u = Math.min(1, Math.max(0, (t - this.times[i]) / h));
    const r = [0, 0, 0], v = [0, 0, 0];
    for (let k = 0; k < 3; k++) {
      const a = s[6 * i + k], b = s[6 * i + 6 + k], va = s[6 * i + 3 + k], vb = s[6 * i + 9 + k];
      r[k] = (1 + 2 * u) * (1 - u) ** 2 * a + u * (1 - u) ** 2 * h * va + u * u * (3 - 2 * u) * b - u * u * (1 - u) * h * vb;
      v[k] = (1 - u) * va + u * vb;
    }
    return { r, v, i: this.index(t) };
  }
  // One of the attitudes at a time, between two samples the chord.
  attitude(t, attitudes) {
    const i = Math.min(this.index(t), Math.max(0, this.last - 1)), q = [0, 1].map(k => new THREE.Quaternion().fromArray(attitudes, 4 * (i + k)));
    return q[0].slerp(q[1], Math.min(1, Math.max(0, (t - this.times[i]) / (this.times[i + 1] - this.times[i] || 1))));
  }
  path(values, width, most = PATH_POINTS) {  // positions of at most so many samples, and their times
    const n = this.last + 1, m = Math.min(n, most), points = [], times = [];
    for (let k = 0; k < m; k++) {
      const i = Math.round(k * (n - 1) / Math.max(1, m - 1));
      points.push(values[width * i], values[width * i + 1], values[width * i + 2]);
      times.push(this.times[i]);
    }
    return { points, times };
  }
}

const flights = DATA.flights.map((data, i) => new Flight(data, i));
const END = DATA.live ? DATA.live.end : Math.max(...flights.map(flight => flight.end));
const MANY = flights.length > HUES.length;
const judged = flight => flight.missed === null ? '' : flight.missed ? 'bad' : 'good';
const hue = flight => MANY ? (flight.missed ? 'bad' : 'x') : HUES[flight.number];
let chosen = flights[0], now = 0, playing = false, dirty = true;
let speed = SPEEDS.reduce((a, b) => Math.abs(END / b - 25) < Math.abs(END / a - 25) ? b : a);

// ---------------------------------------------------------------- scene

const software = (() => {  // a processor that draws has no time to smooth edges
  const gl = document.createElement('canvas').getContext('webgl');
  if (!gl) {
    el('note').textContent = 'This browser does not draw in three dimensions (WebGL): report.html beside this page has pictures.';
    throw Error('no WebGL');
  }
  const info = gl.getExtension('WEBGL_debug_renderer_info');
  return /swiftshader|llvmpipe|software/i.test(info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : '');
})();
const renderer = new THREE.WebGLRenderer({ antialias: !software });
renderer.debug.checkShaderErrors = false;  // it would wait for each of them
const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(38, 1, 0.05, 1e5);
camera.up.set(1, 0, 0);
el('view').prepend(renderer.domElement);
renderer.domElement.tabIndex = 0;
renderer.domElement.setAttribute('aria-label', 'Scene: drag to turn it, wheel to zoom');
const orbit = new THREE.OrbitControls(camera, renderer.domElement);
orbit.addEventListener('change', () => { dirty = true; });
orbit.minDistance = 0.5;
const painted = [];   // [material, name of its colour], painted again when the theme changes
const paint = (material, name) => { painted.push([material, name]); return material; };
const flat = (name, opacity = 1, more = {}) => paint(new THREE.MeshBasicMaterial(
  { transparent: opacity < 1, opacity, depthWrite: opacity === 1, ...more }), name);
const lit = name => paint(new THREE.MeshLambertMaterial(), name);
const thin = (name, opacity = 1) => paint(new THREE.LineBasicMaterial({ transparent: opacity < 1, opacity }), name);
const wide = [];      // materials of wide lines, which must know the size of the picture
function thick(name, width) {
  const material = new THREE.LineMaterial({ linewidth: width });
  wide.push(material);
  return paint(material, name);
}
function add(parent, ...objects) { parent.add(...objects); return objects[0]; }
const mesh = (geometry, material, x = 0, y = 0, z = 0) => {
  const made = new THREE.Mesh(geometry, material);
  made.position.set(x, y, z);
  return made;
};
const polyline = (points, material) =>
  new THREE.Line(new THREE.BufferGeometry().setFromPoints(points.map(p => V(...p))), material);
function ribbon(points, material) {  // a wide line; as much of it is drawn as `geometry.instanceCount` says
  const made = new THREE.Line2(new THREE.LineGeometry().setPositions(points), material);
  made.frustumCulled = false;
  return made;
}

// How far the flights and the zones reach: the size of everything drawn.
const box = new THREE.Box3();
for (const flight of flights) for (let i = 0; i <= flight.last; i += 5) box.expandByPoint(V(...flight.states.slice(6 * i, 6 * i + 3)));
box.expandByPoint(V(0, 0, 0));
for (const radius of DATA.scene.keep_out) box.union(new THREE.Box3(V(-radius, -radius, -radius), V(radius, radius, radius)));
for (const place of [...DATA.scene.corridors.map(cone => cone.end), ...Object.values(DATA.scene.points)]) box.expandByPoint(V(...place));
const middle = box.getCenter(V()), size = Math.max(4, box.getSize(V()).length());

// The sky: brighter where the Earth is.
const sky = mesh(new THREE.SphereGeometry(1, 24, 16), new THREE.MeshBasicMaterial({ vertexColors: true, side: THREE.BackSide, depthWrite: false, depthTest: false }));
sky.renderOrder = -1;
scene.add(sky);
function paintSky() {
  const high = new THREE.Color(colour('high')), low = new THREE.Color(colour('low'));
  const place = sky.geometry.attributes.position, colours = new Float32Array(3 * place.count);
  for (let i = 0; i < place.count; i++)
    high.clone().lerp(low, Math.min(1, Math.max(0, 0.45 - 0.9 * place.getX(i)))).toArray(colours, 3 * i);
  sky.geometry.setAttribute('color', new THREE.BufferAttribute(colours, 3));
}

const stars = new THREE.Points(new THREE.BufferGeometry(), paint(new THREE.PointsMaterial({ size: 1.6, sizeAttenuation: false, transparent: true, opacity: 0.7, depthTest: false, depthWrite: false }), 'muted'));
stars.geometry.setFromPoints(Array.from({ length: 500 }, (_, i) => {  // evenly over the sphere, less those before the Earth
  const x = 1 - 2 * ((i * 0.7548777) % 1), turn = 2 * Math.PI * ((i * 0.5698403) % 1), across = Math.sqrt(1 - x * x);
  return V(x, across * Math.cos(turn), across * Math.sin(turn));
}).filter(p => p.x > -0.25));
stars.renderOrder = -1;
stars.frustumCulled = sky.frustumCulled = false;
scene.add(stars);
const sun = new THREE.DirectionalLight(0xffffff, 0.85);
sun.position.set(0.8, -0.5, -0.6);
scene.add(sun, new THREE.AmbientLight(0xffffff, 0.5));

// The local horizontal plane, with a grid of round numbers.
const step = [1, 2, 5].map(f => f * 10 ** Math.floor(Math.log10(size / 6))).reduce((a, b) => Math.abs(b - size / 9) < Math.abs(a - size / 9) ? b : a);
const grid = (() => {
  const points = [], low = [], high = [];
  for (const k of ['y', 'z']) {
    low.push(Math.floor(box.min[k] / step - 0.3) * step);
    high.push(Math.ceil(box.max[k] / step + 0.3) * step);
  }
  for (let y = low[0]; y <= high[0] + step / 2; y += step) points.push(V(0, y, low[1]), V(0, y, high[1]));
  for (let z = low[1]; z <= high[1] + step / 2; z += step) points.push(V(0, low[0], z), V(0, high[0], z));
  scene.add(new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(points), thin('muted', 0.22)));
  return { low, high };
})();
const up = [Math.min(box.min.x, -step), Math.max(box.max.x, step)];
scene.add(polyline([[0, grid.low[0], 0], [0, grid.high[0], 0]], thin('muted', 0.7)));
scene.add(polyline([[0, 0, grid.low[1]], [0, 0, grid.high[1]]], thin('muted', 0.7)));
scene.add(polyline([[up[0], 0, 0], [up[1], 0, 0]], thin('muted', 0.7)));

// Labels are HTML above the picture.
const labels = [];
function label(text, place, kind = '') {
  const span = document.createElement('span');
  span.textContent = text;
  span.className = kind;
  el('labels').append(span);
  labels.push({ span, place, rank: kind ? 0 : 1 });
  return span;
}
label(`V-bar ${step * Math.round(grid.high[0] / step)} m`, V(0, grid.high[0], 0));
label(`H-bar ${step * Math.round(grid.high[1] / step)} m`, V(0, 0, grid.high[1]));
label('R-bar, outward', V(up[1], 0, 0));
label('to the Earth', V(up[0], 0, 0));

// Zones and points of the scenario. Corridor, points and the target turn with it.
const turned = add(scene, new THREE.Group()), turning = [];  // [object, its place in the scene]
function placed(object) {
  turning.push([object, object.position.clone()]);
  return turning[turning.length - 1][1];
}
for (const radius of DATA.scene.keep_out) {
  add(scene, mesh(new THREE.SphereGeometry(radius, 32, 20), flat('z', 0.1, { side: THREE.DoubleSide })));
  const ring = new THREE.BufferGeometry().setFromPoints(new THREE.EllipseCurve(0, 0, radius, radius).getPoints(72).map(p => V(p.x, p.y, 0)));
  for (let k = 0; k < 6; k++) {  // meridians through the V-bar, and parallels across it
    const meridian = new THREE.Line(ring, thin('z', 0.35)), parallel = new THREE.Line(ring, thin('z', 0.35));
    meridian.rotation.y = k * Math.PI / 6;
    parallel.rotation.x = Math.PI / 2;
    parallel.scale.setScalar(Math.sin((k + 0.5) * Math.PI / 6));
    parallel.position.y = radius * Math.cos((k + 0.5) * Math.PI / 6);
    scene.add(meridian, parallel);
  }
}
for (const [number, cone] of DATA.scene.corridors.entries()) {
  const tip = V(...cone.tip), end = V(...cone.end), length = tip.distanceTo(end);
  const wall = mesh(new THREE.CylinderGeometry(cone.far, cone.near, length, 32, 1, true), flat('small_positive', 0.1, { side: THREE.DoubleSide }));
  wall.position.copy(tip).add(end).multiplyScalar(0.5);
  wall.quaternion.setFromUnitVectors(V(0, 1, 0), end.sub(tip).normalize());
  turned.add(wall);
  if (number) continue;  // the others are much alike
  const pieces = cone.lines.flatMap(line => line.slice(1).flatMap((p, i) => [V(...line[i]), V(...p)]));
  turned.add(new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(pieces), thin('small_positive', 0.55)));
}
for (const [name, place] of Object.entries(DATA.scene.points)) {
  const mark = add(turned, mesh(new THREE.OctahedronGeometry(1), flat('optimum'), ...place));
  mark.userData.pixels = 5;
  label(name.replaceAll('_', ' '), placed(mark));
}

// Bodies. The ring of each is at its origin; a chaser comes from `ahead`, so both meet there.
const ahead = V(...DATA.scene.ahead);
const toward = new THREE.Quaternion();
{ // y of the body along `ahead`, its wings along H-bar where that is across
  const side = Math.abs(ahead.z) < 0.9 ? V(0, 0, 1) : V(1, 0, 0);
  const third = side.clone().sub(ahead.clone().multiplyScalar(side.dot(ahead))).normalize();
  toward.setFromRotationMatrix(new THREE.Matrix4().makeBasis(ahead.clone().cross(third), ahead, third));
}
function vehicle(parts) {
  const body = new THREE.Group(), inner = new THREE.Group();
  inner.add(...parts);
  inner.quaternion.copy(toward);
  return add(scene, add(body, inner) && body);
}
const panel = lit('panel'), hull = lit('hull'), foil = lit('foil'), dark = lit('muted');
const target = vehicle([
  mesh(new THREE.CylinderGeometry(0.62, 0.62, 1.7, 8), hull, 0, -1.0),
  mesh(new THREE.TorusGeometry(0.36, 0.07, 8, 24).rotateX(Math.PI / 2), dark, 0, -0.07),
  mesh(new THREE.CylinderGeometry(0.36, 0.5, 0.14, 20), dark, 0, -0.12),
  ...[-1, 1].flatMap(s => [
    mesh(new THREE.BoxGeometry(0.03, 1.1, 2.6), panel, 0, -1.1, s * 2.3),
    mesh(new THREE.BoxGeometry(0.07, 0.07, 0.6), dark, 0, -1.1, s * 0.8)]),
]);
target.position.set(...DATA.scene.goal);
turned.add(target);
const targetAt = placed(target);
const chaser = vehicle([
  mesh(new THREE.BoxGeometry(0.9, 0.9, 0.9), foil, 0, 0.65),
  mesh(new THREE.TorusGeometry(0.33, 0.06, 8, 24).rotateX(Math.PI / 2), dark, 0, 0.07),
  mesh(new THREE.CylinderGeometry(0.45, 0.33, 0.14, 20), dark, 0, 0.14),
  mesh(new THREE.CylinderGeometry(0.28, 0.12, 0.3, 16), dark, 0, 1.22),
  ...[-1, 1].map(s => mesh(new THREE.BoxGeometry(0.03, 0.7, 1.3), panel, 0, 0.7, s * 1.15)),
]);
const docking = add(chaser, ribbon([0, 0, 0, 0, -2.6, 0], thick('ink', 2)));
const docked = new THREE.Quaternion(...DATA.scene.mate).invert();  // the target's axes in the chaser's, when docked
chaser.children[0].quaternion.premultiply(docked);
docking.quaternion.copy(chaser.children[0].quaternion);
const views = DATA.scene.cameras.map(({ axis, half, turns }) => {  // fields of view, from the docking ring
  const long = CAMERA * Math.cos(half), round = CAMERA * Math.sin(half);
  const cone = mesh(new THREE.ConeGeometry(round, long, 32, 1, true).translate(0, -long / 2, 0), flat('good', 0.13, { side: THREE.DoubleSide }));
  cone.quaternion.setFromUnitVectors(V(0, -1, 0), V(...axis).normalize());
  return add(turns ? chaser : scene, cone);
});
label('target', targetAt, 'body');
label('chaser', chaser.position, 'body');

// Thrust: an arrow along the force, and a plume against it for each axis.
const arrow = new THREE.Group();
const shaft = mesh(new THREE.CylinderGeometry(0.07, 0.07, 1, 10).translate(0, 0.5, 0), flat('y'));
const head = mesh(new THREE.ConeGeometry(0.2, 0.45, 14).translate(0, 0.22, 0), flat('y'));
arrow.add(shaft, head);
scene.add(arrow);
const plumes = [0, 1, 2].map(() => add(scene, mesh(
  new THREE.ConeGeometry(0.32, 1, 14).translate(0, -0.5, 0), flat('small_positive', 0.6))));
const drop = add(scene, polyline([[0, 0, 0], [1, 0, 0]], thin('ink', 0.35)));
drop.frustumCulled = false;
const cloud = add(scene, mesh(new THREE.SphereGeometry(1, 24, 16), flat('optimum', 0.35, { depthTest: false })));  // seen through the chaser
cloud.matrixAutoUpdate = false;
const ghost = add(scene, mesh(new THREE.OctahedronGeometry(1), flat('optimum')));
ghost.userData.pixels = 6;

// Paths: the whole one thin, the flown part of the chosen flight wide; a dot for each other chaser.
const dot = new THREE.SphereGeometry(1, 12, 8);
for (const flight of flights) {
  flight.thin = add(scene, new THREE.Line(new THREE.BufferGeometry(), thin(hue(flight), 0.4)));
  flight.flown = add(scene, ribbon([0, 0, 0, 0, 0, 0], thick(hue(flight), 2.6)));
  flight.dot = add(scene, mesh(dot, flat(hue(flight))));
  flight.dot.userData.pixels = 4;
  const dashes = new THREE.LineDashedMaterial({ dashSize: step / 10, gapSize: step / 14 });
  if (flight.reference) flight.planned = add(scene, new THREE.Line(new THREE.BufferGeometry(), paint(dashes, 'optimum')));
  flight.thin.frustumCulled = false;
  if (flight.planned) flight.planned.frustumCulled = false;
  lay(flight);
}
function lay(flight) {  // the paths through what is known of a flight
  const { points, times } = flight.path(flight.states, 6), line = flight.thin.geometry;
  line.setAttribute('position', new THREE.Float32BufferAttribute(points, 3));
  flight.flown.geometry.dispose();
  flight.flown.geometry = new THREE.LineGeometry().setPositions(points);
  Object.assign(flight, { points, pathTimes: times, shown: 0 });
  if (!flight.planned) return;
  const planned = flight.path(flight.reference, 3).points;
  flight.planned.geometry.setAttribute('position', new THREE.Float32BufferAttribute(planned, 3));
  flight.planned.computeLineDistances();
}

// ---------------------------------------------------------------- the picture of a moment

const pixel = place => 2 * Math.tan(camera.fov * Math.PI / 360) * camera.position.distanceTo(place) / renderer.domElement.clientHeight;
const sprites = [...scene.children, ...turned.children].filter(child => child.userData.pixels);

function place(state) {
  const r = V(...state.r), force = V(...chosen.forces.slice(3 * state.i, 3 * state.i + 3));
  chaser.position.copy(r);
  if (chosen.attitudes) turned.quaternion.copy(chosen.attitude(Math.min(now, chosen.end), chosen.attitudes));
  docking.visible = !!chosen.chaser;
  if (chosen.chaser) chaser.quaternion.copy(chosen.attitude(Math.min(now, chosen.end), chosen.chaser));
  else chaser.quaternion.identity();
  turned.updateMatrixWorld();
  for (const [object, at] of turning) object.getWorldPosition(at);
  // Bodies are drawn in their size, or larger where that could not be seen.
  const room = r.distanceTo(targetAt) / pixel(r);
  const grown = at => Math.max(1, Math.min(30, Math.max(13, 0.5 * room)) * pixel(at) / 2);
  chaser.scale.setScalar(grown(r));
  target.scale.setScalar(grown(targetAt));
  const unit = chaser.scale.x, share = force.length() / DATA.scene.max_force;
  const middleOf = V(0, 0.65 * unit, 0).applyQuaternion(docking.quaternion).applyQuaternion(chaser.quaternion).add(r);
  for (const cone of views.filter(cone => cone.parent === scene)) {
    cone.position.copy(r);
    cone.scale.setScalar(unit);
  }
  arrow.visible = share > 2e-3;
  arrow.position.copy(middleOf);
  arrow.scale.setScalar(unit);
  if (arrow.visible) arrow.quaternion.setFromUnitVectors(V(0, 1, 0), force.clone().normalize());
  const length = 1.2 + 4 * Math.sqrt(share);
  shaft.scale.y = length;
  head.position.y = length;
  const own = force.clone().applyQuaternion(chaser.quaternion.clone().invert());  // in the axes of the thrusters
  plumes.forEach((plume, k) => {
    const part = own.getComponent(k) / DATA.scene.max_force;
    plume.visible = Math.abs(part) > 2e-3;
    const along = V(0, 0, 0).setComponent(k, Math.sign(part) || 1).applyQuaternion(chaser.quaternion);
    plume.quaternion.setFromUnitVectors(V(0, 1, 0), along);
    plume.position.copy(middleOf).addScaledVector(along, -0.45 * unit);
    plume.scale.set(unit, unit * (0.5 + 3 * Math.sqrt(Math.abs(part))), unit);
  });
  drop.geometry.attributes.position.setXYZ(0, ...state.r);
  drop.geometry.attributes.position.setXYZ(1, 0, state.r[1], state.r[2]);
  drop.geometry.attributes.position.needsUpdate = true;
  cloud.visible = !!chosen.estimate;
  if (chosen.estimate) {  // the image of the unit sphere under three times the factor of the covariance
    const [x, y, z, a, b, c, d, e, f] = chosen.estimate.slice(9 * state.i, 9 * state.i + 9);
    cloud.matrix.set(3 * a, 0, 0, x, 3 * b, 3 * c, 0, y, 3 * d, 3 * e, 3 * f, z, 0, 0, 0, 1);
    cloud.matrixWorldNeedsUpdate = true;
  }
  ghost.visible = !!chosen.reference;
  if (chosen.reference) ghost.position.set(...chosen.reference.slice(3 * state.i, 3 * state.i + 3));
  for (const flight of flights) {
    const own = flight === chosen, here = own ? state : flight.at(Math.min(now, flight.end));
    flight.dot.visible = !own;
    flight.dot.position.set(...here.r);
    let count = 0;
    while (count < flight.pathTimes.length - 1 && flight.pathTimes[count + 1] <= now) count++;
    flight.flown.visible = stats.frames > 0 && (own || !MANY);  // the first frame, at 0 s, goes without its program
    if (flight.flown.visible) {  // so many whole parts, and the last one as far as the chaser is
      const ends = flight.flown.geometry.attributes.instanceEnd, points = flight.points, last = points.length / 3 - 1;
      const restore = flight.shown ?? 0;
      if (restore < last) ends.setXYZ(restore, ...points.slice(3 * restore + 3, 3 * restore + 6));
      if (count < last) ends.setXYZ(count, ...here.r);
      ends.data.needsUpdate = true;
      flight.shown = count;
      flight.flown.geometry.instanceCount = Math.min(last, count + 1);
    }
    flight.thin.material.opacity = own ? 0.7 : MANY ? 0.3 : 0.45;
    if (flight.planned) flight.planned.visible = own;
  }
  for (const one of sprites) one.scale.setScalar(one.userData.pixels * pixel(one.getWorldPosition(V())));
}

function placeLabels() {
  const width = renderer.domElement.clientWidth, height = renderer.domElement.clientHeight;
  const taken = [{ x: width - 240, y: 20, w: 240 }];  // the buttons
  for (const { span, place, rank } of [...labels].sort((a, b) => a.rank - b.rank)) {
    const p = place.clone().project(camera), x = (p.x + 1) / 2 * width + 9, y = (1 - p.y) / 2 * height - 22;
    span.dataset.width ||= span.offsetWidth;
    const w = +span.dataset.width;
    const free = !taken.some(t => Math.abs(t.y - y) < 16 && x < t.x + t.w && t.x < x + w);
    const inside = p.z < 1 && x > 0 && x + w < width && y > 0 && y < height - 20;
    span.style.visibility = free && inside ? '' : 'hidden';
    if (!free || !inside) continue;
    taken.push({ x, y, w });
    span.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
  }
}

// Views: everything; the surroundings of the target; beside the chaser, and with it.
const DIRECTION = V(0.42, -0.5, -0.75).normalize();
let follows = false, view = 0;
function look(at, distance, direction = DIRECTION) {
  orbit.target.copy(at);
  camera.position.copy(at).addScaledVector(direction, distance);
  camera.near = Math.max(0.02, distance / 500);
  camera.far = 40 * (distance + size);
  camera.updateProjectionMatrix();
  orbit.update();
}
const near = Math.max(6, ...DATA.scene.keep_out.map(radius => 1.25 * radius), ...DATA.scene.corridors.map(c => V(...c.end).length()));
const VIEWS = [
  ['Overview', () => {  // the nearest from which all of it is in the picture
    let distance = size / 4;
    do look(middle, distance *= 1.05); while (distance < 10 * size && !landmarks.every(inPicture));
  }],
  ['Target', () => look(targetAt, fitted(Math.min(near, size / 2)))],
  ['Chaser', () => { place(chosen.at(now)); look(chaser.position, Math.min(16, size / 2), ahead.clone().multiplyScalar(0.75).add(V(0.4, 0.2, -0.5)).normalize()); }],
];
const landmarks = [
  V(0, 0, 0), ...Object.values(DATA.scene.points).map(p => V(...p)), ...DATA.scene.corridors.map(cone => V(...cone.end)),
  ...DATA.scene.keep_out.flatMap(r => [V(r, 0, 0), V(-r, 0, 0), V(0, r, 0), V(0, -r, 0), V(0, 0, r), V(0, 0, -r)]),
  ...flights.flatMap(flight => Array.from({ length: 21 }, (_, i) => V(...flight.at(flight.end * i / 20).r))),
];
function inPicture(place) {
  camera.updateMatrixWorld();
  const p = place.clone().project(camera);
  return Math.abs(p.x) < 0.9 && Math.abs(p.y) < 0.8 && p.z < 1;
}
function fitted(radius) {
  return radius / Math.sin(camera.fov * Math.PI / 360) / Math.min(1, Math.max(0.62, camera.aspect));
}
function show(number) {
  view = number;
  follows = number === 2;
  VIEWS[number][1]();
  [...el('cameras').children].forEach((button, i) => button.setAttribute('aria-pressed', i === number));
  dirty = true;
}
VIEWS.forEach(([name], i) => {
  const button = document.createElement('button');
  button.textContent = name;
  button.title = `View ${i + 1}`;
  button.onclick = () => show(i);
  el('cameras').append(button);
});

// ---------------------------------------------------------------- numbers beside the picture

const shown = (value, unit = '') => {
  const size = Math.abs(value);
  const text = size >= 100 ? value.toFixed(0) : size >= 10 ? value.toFixed(1) : size >= 1 ? value.toFixed(2)
    : size >= 0.01 ? value.toFixed(3) : size >= 1e-4 ? value.toFixed(5) : size > 0 ? value.toExponential(0) : '0';
  return `${text.replace('-', '−')} ${unit}`.trim();
};
const node = (tag, text = '', kind = '') => {
  const made = document.createElement(tag);
  made.textContent = text;
  made.className = kind;
  return made;
};
const say = (element, text) => { if (element.textContent !== text) element.textContent = text; };
const figures = {};
const MOTION = ['range', 'speed', 'closing speed'];
for (const name of new Set([...MOTION, ...flights.flatMap(flight => flight.turns.map(([name]) => name))])) {
  figures[name] = node('dd');
  const group = node('div');
  group.append(node('dt', name), figures[name]);
  el('figures').append(group);
}

function build() {  // what depends on the chosen flight
  el('limits').replaceChildren(...chosen.limits.map(limit => {
    const row = node('div'), name = node('span', limit.name), bar = node('div', '', 'bar');
    const when = limit.from_s === 0 ? '' : limit.from_s >= chosen.end ? ' at the end' : ` from ${shown(limit.from_s, 's')}`;
    name.append(node('small', when));
    bar.append(node('i'));
    row.append(name, node('b'), bar);
    return row;
  }));
  el('axes').replaceChildren(...AXES.map((name, k) => {
    const box = node('div', '', 'axis'), line = node('div'), bar = node('div', '', 'bar'), part = node('i');
    line.append(node('b', name.slice(0, 1)), node('span', name.slice(2) + ': ', 'muted'), node('span'));
    part.style.background = `var(--${AXIS_COLOURS[k]})`;
    bar.append(part);
    box.append(line, bar, node('p'), node('p'), node('p'));
    return box;
  }));
  const has = [...MOTION, ...chosen.turns.map(([name]) => name)];
  for (const [name, figure] of Object.entries(figures)) figure.parentNode.hidden = !has.includes(name);
  say(el('verdict'), chosen.verdict);
  el('verdict').className = judged(chosen);
  [...el('flights').children].forEach((button, i) => button.setAttribute('aria-pressed', flights[i] === chosen));
  legend();
  strip();
  dirty = true;
}

function legend() {
  const rows = MANY ? [['x', 'keeps its limits'], ['bad', 'misses a limit']] : [[hue(chosen), 'flown']];
  rows.push(['y', 'force']);
  if (chosen.chaser) rows.push(['ink', 'docking axis']);
  if (views.length) rows.push(['good', 'field of view']);
  if (chosen.reference) rows.push(['optimum', 'reference']);
  if (chosen.estimate) rows.push(['optimum', 'estimate, 3 sigma']);
  if (DATA.scene.keep_out.length) rows.push(['z', 'keep-out sphere']);
  if (DATA.scene.corridors.length) rows.push(['small_positive', 'corridor']);
  rows.push(['muted', `grid ${step} m; bodies not to scale from afar`]);
  el('legend').replaceChildren(...rows.map(([name, text]) => {
    const row = node('li', text), mark = node('i');
    mark.style.background = `var(--${name})`;
    row.prepend(mark);
    return row;
  }));
}

function numbers(state) {
  const range = Math.hypot(...state.r), dot = state.r.reduce((sum, r, k) => sum + r * state.v[k], 0);
  for (const [name, value, unit] of [['range', range, 'm'], ['speed', 1e3 * Math.hypot(...state.v), 'mm/s'], ['closing speed', range ? -1e3 * dot / range : 0, 'mm/s'],
    ...chosen.turns.map(([name, unit, values]) => [name, values[state.i], unit])]) {
    const [number, ...rest] = shown(Math.abs(value) < 0.005 && unit[0] !== '°' ? 0 : value, unit).split(' ');
    if (figures[name].dataset.said !== number) {
      figures[name].dataset.said = number;
      figures[name].replaceChildren(number + ' ', node('small', rest.join(' ')));
    }
  }
  const phase = chosen.phases.filter(p => p[2] <= now + 1e-6).pop(), act = chosen.acts.find(a => a[1] <= now && now < a[2]);
  const said = [phase && `Phase ${phase[0].replaceAll('_', ' ')}: ${phase[1]}.`, act && `Assurance acts: ${act[0].replaceAll('_', ' ')}.`];
  if (chosen.estimate) {
    const e = chosen.estimate.slice(9 * state.i, 9 * state.i + 3);
    said.push(`The estimate is off by ${shown(Math.hypot(...e.map((x, k) => x - chosen.states[6 * state.i + k])), 'm')}.`);
  }
  say(el('said'), said.filter(Boolean).join(' '));
  el('said').hidden = !el('said').textContent;
  chosen.limits.forEach((limit, k) => {
    const row = el('limits').children[k], value = limit.values[state.i], [, number, bar] = row.children;
    const counts = now >= limit.from_s - 1e-6 || limit.from_s === 0;
    const broken = limit.floor ? value < limit.limit : value > limit.limit * (1 + 1e-6);
    const kind = counts && broken ? 'bad' : counts ? '' : 'idle';
    if (row.className !== kind) row.className = kind;
    say(number, Number.isNaN(value) ? '–' : limit.floor ? shown(value, limit.unit) : `${shown(value)} of ${+limit.limit.toPrecision(3)} ${limit.unit}`);
    const most = limit.floor ? Math.abs(limit.values[0]) || 1 : limit.limit || 1;
    bar.firstChild.style.width = `${Math.min(100, 100 * Math.abs(value || 0) / most)}%`;
  });
  const told = chosen.reasons, last = told && told.samples.length - 1;
  const sample = told && told.samples[DATA.live ? state.i : Math.min(last, Math.floor(now / chosen.end * last + 1e-6))];
  [...el('axes').children].forEach((box, k) => {
    const [line, bar, ...texts] = box.children, force = chosen.forces[3 * state.i + k];
    const words = sample ? told.words[sample[k][0]] : '';
    say(line.lastChild, `${force > 0 ? '+' : ''}${shown(Math.abs(force) < 5e-5 ? 0 : force, 'N')}${words ? ', ' + words : ''}`);
    const share = Math.min(1, Math.abs(force) / DATA.scene.max_force) * 50;
    bar.firstChild.style.cssText += `;left:${force < 0 ? 50 - share : 50}%;width:${share}%`;
    texts.forEach((text, j) => {
      const cause = sample && sample[k][1][j];
      text.hidden = !cause;
      if (!cause) return;
      const why = `${cause[0]} % ${told.words[cause[1]]} | because ${told.words[cause[2]]}`;
      if (text.dataset.said === why) return;
      text.dataset.said = why;
      text.replaceChildren(node('em', `${cause[0]} % ${told.words[cause[1]]}`), `, because ${told.words[cause[2]]}`);
    });
  });
}

// ---------------------------------------------------------------- time line

const canvas = el('strip').querySelector('canvas');
function strip() {  // the range over the time, phases, and where assurance acts, drawn once
  const ratio = devicePixelRatio, w = canvas.clientWidth, h = canvas.clientHeight;
  if (!w) return;
  canvas.width = w * ratio;
  canvas.height = h * ratio;
  const g = canvas.getContext('2d');
  g.scale(ratio, ratio);
  const x = t => t / END * w, top = 16, far = Math.max(...Array.from({ length: chosen.last + 1 }, (_, i) => Math.hypot(...chosen.states.slice(6 * i, 6 * i + 3))));
  g.font = `11px ${getComputedStyle(document.body).fontFamily}`;
  g.fillStyle = colour('bad');
  g.globalAlpha = 0.35;
  for (const [, from, to] of chosen.acts) g.fillRect(x(from), top, Math.max(1.5, x(to) - x(from)), h - top);
  g.globalAlpha = 1;
  g.beginPath();
  g.moveTo(0, h);
  for (let px = 0; px <= x(chosen.end); px++) {
    const { r } = chosen.at(px / w * END);
    g.lineTo(px, h - (h - top - 2) * Math.hypot(...r) / far);
  }
  g.lineTo(x(chosen.end), h);
  g.fillStyle = colour('grid');
  g.fill();
  g.strokeStyle = colour('muted');
  g.stroke();
  g.fillStyle = colour('muted');
  let free = 0;
  for (const [name, , begin] of chosen.phases) {
    g.fillRect(x(begin), top - 4, 1, h - top + 4);
    const text = name.replaceAll('_', ' '), wide = g.measureText(text).width, at = Math.min(x(begin) + 3, w - wide);
    if (at >= free) { g.fillText(text, at, 11); free = at + wide + 8; }
  }
  if (!chosen.phases.length) g.fillText('range', 2, 11);
}

let following = !!DATA.live;  // the newest moment of a flight that is still running
function seek(t) {
  const newest = DATA.live ? chosen.end : END;
  following = !!DATA.live && t >= newest;
  now = Math.min(newest, Math.max(0, t));
  el('scrub').value = now / END;
  dirty = true;
}
function play(on = !playing) {
  if (on && now >= (DATA.live ? chosen.end : END)) seek(0);
  playing = on;
  el('play').textContent = on ? '❚❚' : '▶';
  el('play').setAttribute('aria-label', on ? 'Pause' : 'Play');
  before = undefined;
  resize();
}
function choose(number) {
  chosen = flights[(number + flights.length) % flights.length];
  build();
}
function setSpeed(value) {
  speed = value;
  el('speed').value = value;
}

el('play').onclick = () => play();
el('scrub').oninput = () => seek(el('scrub').value * END);
el('speed').append(...SPEEDS.map(value => new Option(`× ${value}`, value)));
el('speed').onchange = () => setSpeed(+el('speed').value);
addEventListener('keydown', event => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === 'SELECT') return;
  if (event.key === ' ' && event.target.tagName === 'BUTTON' && event.target.id !== 'play') return;
  const by = event.shiftKey ? 10 : 1, next = d => SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, SPEEDS.indexOf(speed) + d))];
  const single = d => seek(chosen.times[Math.min(chosen.last, Math.max(0, chosen.index(now) + d))]);
  const keys = {
    ' ': () => play(), ArrowLeft: () => seek(now - by), ArrowRight: () => seek(now + by),
    ArrowUp: () => setSpeed(next(1)), ArrowDown: () => setSpeed(next(-1)), Home: () => seek(0), End: () => seek(END),
    ',': () => single(-1), '.': () => single(1), n: () => choose(chosen.number + 1), p: () => choose(chosen.number - 1),
    1: () => show(0), 2: () => show(1), 3: () => show(2),
  };
  if (!keys[event.key]) return;
  keys[event.key]();
  event.preventDefault();
});

// ---------------------------------------------------------------- frames

const FULL = Math.min(devicePixelRatio, 2);
let before, drawnNumbers = 0, pixels = FULL, cost = 0, sized;
const stats = { frames: 0, first_ms: 0, draw_ms: 0 };
function resize() {
  const { clientWidth: w, clientHeight: h } = el('view'), wanted = [w, h, playing ? pixels : FULL].join();
  if (wanted === sized) return;  // it would wipe the picture
  sized = wanted;
  renderer.setPixelRatio(playing ? pixels : FULL);
  renderer.setSize(w, h, false);
  camera.aspect = w / h;
  camera.updateProjectionMatrix();
  for (const material of wide) material.resolution.set(w, h);
  dirty = true;
}
function theme() {
  for (const [material, name] of painted) material.color.set(colour(name));
  stars.visible = matchMedia('(prefers-color-scheme: dark)').matches;
  paintSky();
  dirty = true;
}
function picture(state) {
  place(state);
  for (const far of [sky, stars]) {
    far.position.copy(camera.position);
    far.scale.setScalar(camera.far / 4);
  }
  renderer.render(scene, camera);
}
function draw(time) {
  const began = performance.now(), state = chosen.at(Math.min(now, chosen.end));
  if (follows) {
    const moved = V(...state.r).sub(orbit.target);
    orbit.target.add(moved);
    camera.position.add(moved);
    camera.updateMatrixWorld();
  }
  picture(state);
  placeLabels();
  el('head').style.transform = `translateX(${(now / END * canvas.clientWidth).toFixed(1)}px)`;
  if (time - drawnNumbers > REDRAW_MS || !playing) {
    drawnNumbers = time;
    numbers(state);
    const text = `${now.toFixed(1)} s`;
    if (el('clock').dataset.said !== text) {
      el('clock').dataset.said = text;
      el('clock').replaceChildren(text, node('small', ` of ${shown(END, 's')}`));
      el('scrub').setAttribute('aria-valuetext', text);
    }
  }
  dirty ||= !stats.frames;
  stats.frames += 1;
  stats.draw_ms = performance.now() - began;
  stats.first_ms ||= performance.now();
}
function frame(time) {
  requestAnimationFrame(frame);
  if (playing) {
    const passed = before === undefined ? 0 : time - before;
    before = time;
    cost = 0.9 * cost + 0.1 * passed;
    if (cost > SLOW_MS && passed < 500 && pixels > 0.6) {  // a slow machine gets fewer pixels, not fewer frames
      pixels = Math.max(0.6, pixels * 0.8);
      cost = 0;
      resize();
    }
    seek(now + speed * Math.min(passed, 250) / 1e3);
    if (now >= (DATA.live ? chosen.end : END)) play(false);
  }
  if (!dirty) return;
  dirty = false;
  draw(time);
}

say(el('note'), DATA.note);
theme();
resize();
show(0);
picture(chosen.at(0));  // the graphics processor is at work while the rest of the page is made
if (flights.length > 1) {
  el('choice').hidden = false;
  el('flights').append(...flights.map(flight => {
    const button = node('button'), mark = node('i');
    mark.style.background = `var(--${hue(flight)})`;
    button.append(mark, node('span', flight.name), node('small', { bad: 'misses', good: 'holds' }[judged(flight)] || 'not judged', judged(flight)));
    button.title = flight.verdict;
    button.onclick = () => choose(flight.number);
    return button;
  }));
}
el('next').hidden = flights.length < 2;
setSpeed(speed);
new ResizeObserver(() => { resize(); strip(); }).observe(el('view'));
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => { theme(); strip(); });
build();
resize();
requestAnimationFrame(frame);

// ---------------------------------------------------------------- a flight that is still running

function card(text) {
  say(el('card'), text);
  el('card').hidden = !text;
}
if (DATA.live) {
  const stream = new EventSource(`/events?flight=${DATA.live.flight}&from=${DATA.live.samples}`);
  let drawn = 0;
  stream.onerror = () => card('No connection to the server; waiting for it.');
  stream.onmessage = event => {
    const said = JSON.parse(event.data);
    if (said.flight !== DATA.live.flight || said.from !== flights[0].last + 1) {  // another flight, or thinned
      stream.close();
      location.reload();
      return;
    }
    card(said.card);
    say(el('verdict'), said.sentence);
    if (!said.more) return;
    flights[0].extend(said.more);
    lay(flights[0]);
    if (following) seek(chosen.end);
    if (performance.now() - drawn > 500) {
      drawn = performance.now();
      strip();
    }
    dirty = true;
  };
  seek(chosen.end);
}
window.replay = { seek, play, choose, show, setSpeed, stats, get now() { return now; }, get playing() { return playing; }, get pixels() { return pixels; } };
