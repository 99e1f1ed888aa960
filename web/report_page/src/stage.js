// The robot in 3-D: the actual pose, ghosts of command, truth and other runs, the path that is planned and travelled.
//
// A ghost stands off the actual pose by the error times the magnification: the command by the following error with the
// set-point delay removed, the truth by what encoders do not see, another run by its difference. At 1 it is where it is.
// The cell is that of the first run; its parts go with the actual pose.

import {
  AmbientLight, DirectionalLight, HemisphereLight, Mesh, MeshBasicMaterial, PerspectiveCamera, Scene, SphereGeometry,
  Vector3, WebGLRenderer,
} from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { Line2 } from 'three/addons/lines/Line2.js';
import { LineGeometry } from 'three/addons/lines/LineGeometry.js';
import { LineMaterial } from 'three/addons/lines/LineMaterial.js';

import { Cell } from './cell.js';
import { Robot } from './robot.js';
import { colour, isDark, onTheme } from './theme.js';

const VIEWS = {
  iso: [1.25, -1.55, 0.55],
  front: [0, -1.9, 0.02],
  side: [1.9, 0, 0.02],
  top: [0, -0.001, 2.1],
};
const DOT_PIXELS = 6; // radius of the mark at the TCP
const PATH_POINTS = 4000; // of a path at most

export class Stage {
  constructor(report, clock) {
    Object.assign(this, { report, clock, dirty: true, magnified: 1, shown: { planned: true, travelled: true } });
    this.element = document.getElementById('stage');
    this.canvas = this.element.querySelector('canvas');
    this.renderer = new WebGLRenderer({ canvas: this.canvas, antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.scene = new Scene();
    this.scene.add(new HemisphereLight(0xffffff, 0x8899aa, 2.0), new AmbientLight(0xffffff, 0.5));
    const sun = new DirectionalLight(0xffffff, 1.6);
    sun.position.set(1.5, -2, 3);
    this.scene.add(sun);
    this.camera = new PerspectiveCamera(35, 1, 0.02, 50);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.enableDamping = false;
    this.controls.addEventListener('change', () => this.redraw());
    this.build();
    this.look('iso');
    this.bind();
    new ResizeObserver(() => this.resize()).observe(this.element);
    clock.addEventListener('time', () => this.redraw());
    onTheme(() => this.repaint());
    this.resize();
  }

  build() {
    const [run] = this.report.runs;
    this.robot = new Robot(run.robot);
    this.robot.repaint(isDark());
    this.scene.add(this.robot.group);
    this.cell = this.report.cell ? new Cell(run, this.report.cell) : null;
    if (this.cell) this.scene.add(this.cell.group);
    this.ghosts = ghostsOf(this.report).map((ghost) => {
      const robot = new Robot(ghost.run.robot, { colour: colour(ghost.colour), opacity: 0.42 });
      this.scene.add(robot.group);
      return { ...ghost, robot, shown: ghost.initially };
    });
    this.dots = [{ run, colour: 'dot' }, ...this.ghosts].map((one) => {
      const material = new MeshBasicMaterial({ color: colour(one.colour), depthTest: false, transparent: true, toneMapped: false });
      const dot = new Mesh(new SphereGeometry(1, 24, 16), material);
      dot.renderOrder = 10;
      this.scene.add(dot);
      return dot;
    });
    this.paths = [];
    const add = (source, name, style) => {
      if (!source.has(name)) return;
      const path = new Path(source, name, style);
      this.paths.push(path);
      this.scene.add(path.line);
    };
    add(run, 'tcp_command', { colour: 'planned', width: 1.5, kind: 'planned' });
    this.report.runs.forEach((one, n) => add(one, 'tcp_actual', { colour: n ? `run${n}` : 'travelled', width: 2.5, kind: 'travelled' }));
    const reach = this.reach();
    this.controls.target.set(0, 0, reach.middle);
    this.size = reach.size;
  }

  // Height of the middle of the robot and how large it is, by its workspace and its base.
  reach() {
    const { parts, hips } = this.report.runs[0].robot;
    const [cylinder] = parts.find((part) => part.name === 'workspace').shapes;
    const bottom = cylinder.position_m[2] - cylinder.length_m / 2;
    const radius = Math.max(cylinder.radius_m, Math.hypot(hips[0][0], hips[0][1]));
    return { middle: 0.52 * bottom, size: Math.max(-bottom, 2 * radius) };
  }

  look(name) {
    const [x, y, z] = VIEWS[name];
    // a narrow stage needs more distance
    const far = this.size * Math.max(1.12, 0.9 / Math.max(this.camera.aspect, 0.3));
    this.camera.position.copy(this.controls.target).add(new Vector3(x, y, z).multiplyScalar(far));
    this.controls.update();
    this.view = name;
    this.redraw();
  }

  bind() {
    this.element.querySelectorAll('[data-view]').forEach((button) => {
      button.addEventListener('click', () => this.look(button.dataset.view));
    });
    const options = document.getElementById('options');
    if (matchMedia('(max-width: 52rem)').matches) options.closest('details').open = false;
    const option = (text, name, checked, change) => {
      const label = options.appendChild(document.createElement('label'));
      const box = label.appendChild(document.createElement('input'));
      box.type = 'checkbox';
      box.checked = checked;
      const key = label.appendChild(document.createElement('i'));
      key.style.background = `var(--${name})`;
      label.append(text);
      box.addEventListener('change', () => {
        change(box.checked);
        this.redraw();
      });
    };
    for (const ghost of this.ghosts) {
      option(ghost.text, ghost.colour, ghost.shown, (checked) => { ghost.shown = checked; });
    }
    option('planned path', 'planned', true, (checked) => { this.shown.planned = checked; });
    option('travelled', 'travelled', true, (checked) => { this.shown.travelled = checked; });
    option('workspace', 'air', true, (checked) => this.robot.showPart('workspace', checked));
    if (this.cell) option('cell', 'belt', true, (checked) => { this.cell.group.visible = checked; });

    const slider = document.getElementById('magnify');
    const value = document.getElementById('magnified');
    slider.closest('label').hidden = !this.ghosts.length;
    slider.addEventListener('input', () => {
      this.magnified = magnification(slider.value);
      value.textContent = `×${this.magnified}`;
      this.redraw();
    });
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.element;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    const before = this.camera.aspect;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.paths.forEach((path) => path.line.material.resolution.set(width, height));
    if (Math.abs(before - this.camera.aspect) > 0.01) this.look(this.view);
    this.redraw();
  }

  // New colours: of ghosts, dots and paths.
  repaint() {
    this.robot.repaint(isDark());
    this.cell?.repaint();
    this.ghosts.forEach((ghost, n) => {
      ghost.robot.group.traverse((object) => {
        object.material?.color.set(colour(ghost.colour));
        object.material?.emissive.set(colour(ghost.colour)).multiplyScalar(0.35);
      });
      this.dots[n + 1].material.color.set(colour(ghost.colour));
    });
    this.dots[0].material.color.set(colour('dot'));
    this.paths.forEach((path) => path.line.material.color.set(colour(path.style.colour)));
    this.redraw();
  }

  // Draw in the next frame, once.
  redraw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
    });
  }

  draw() {
    const { time } = this.clock;
    const [run] = this.report.runs;
    const actual = actualPose(run, time);
    this.robot.place(actual.angles, actual.tcp, actual.turn);
    // where parts are known they are seen themselves
    this.robot.showPart('payload', !this.cell?.parts.length && carries(run, time));
    this.cell?.place(time, this.robot.tcp, this.robot.turned);
    this.showDot(0, actual.tcp, true);
    this.ghosts.forEach((ghost, n) => {
      const pose = ghost.pose(time, actual, this.magnified);
      ghost.robot.group.visible = ghost.shown;
      ghost.robot.place(pose.angles, pose.tcp, pose.turn);
      this.showDot(n + 1, pose.tcp, ghost.shown);
    });
    for (const path of this.paths) {
      path.line.visible = this.shown[path.style.kind];
      if (path.style.kind === 'travelled') path.showUntil(time);
    }
    this.tell(time);
    this.renderer.render(this.scene, this.camera);
  }

  // The mark at a TCP has the same size on the screen wherever it is.
  showDot(n, tcp, shown) {
    const dot = this.dots[n];
    dot.visible = shown && tcp.every(Number.isFinite);
    if (!dot.visible) return;
    dot.position.set(...tcp);
    const far = dot.position.distanceTo(this.camera.position);
    const metresPerPixel = (2 * far * Math.tan((this.camera.fov * Math.PI) / 360)) / this.element.clientHeight;
    dot.scale.setScalar((n ? 0.7 : 1) * DOT_PIXELS * metresPerPixel);
  }

  tell(time) {
    const [run] = this.report.runs;
    const told = document.getElementById('told');
    const lines = [];
    if (run.has('tcp_actual')) {
      const [x, y, z] = run.at('tcp_actual', time).map((value) => (1e3 * value).toFixed(1));
      lines.push(`TCP ${x}, ${y}, ${z} mm`);
    }
    if (run.has('turn_position')) {
      lines.push(`tool ${((180 / Math.PI) * turnOf(run, 'turn_position', time, false)).toFixed(2)} deg`);
    }
    if (run.has('tcp_error_norm')) lines.push(`error ${(1e3 * run.at('tcp_error_norm', time)[0]).toFixed(3)} mm`);
    const move = run.moves.find(([, , from, to]) => from <= time && time < to);
    if (move) lines.push(`move ${move[0]}, ${move[1]}`);
    told.textContent = lines.join('\n');
  }

  // What maps a place [m] to a pixel of the window: 4 x 4, by columns, and where the canvas is.
  projection() {
    this.camera.updateMatrixWorld();
    const matrix = this.camera.projectionMatrix.clone().multiply(this.camera.matrixWorldInverse);
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    return { matrix: matrix.elements.slice(), left, top, width, height };
  }
}

// Magnification of the error by the slider, 0 to 60: 1 to 1000, in steps that read well.
function magnification(place) {
  const value = 10 ** (place / 20);
  const step = 10 ** Math.floor(Math.log10(value));
  return Math.round(value / step) * step;
}

function actualPose(run, time) {
  const tcp = run.has('tcp_actual') ? run.at('tcp_actual', time, true) : run.at('tcp_command', time, true);
  const angles = run.at(run.has('motor_position') ? 'motor_position' : 'motor_command', time, true);
  return { tcp, angles: angles.map((angle) => angle / run.gear_ratio), turn: turnOf(run, 'turn_position', time) };
}

// Angle of the tool, or a difference of it [rad]: the sum over its rotary axes, 0 without one.
function turnOf(run, name, time, smooth = true) {
  const held = [name, `${name}_2`].filter((signal) => run.has(signal));
  return held.reduce((sum, signal) => sum + run.at(signal, time, smooth)[0], 0);
}

// A pose that stands off another one by a difference, magnified.
function off(pose, angles, tcp, turn, magnified) {
  return {
    angles: pose.angles.map((angle, i) => angle + magnified * angles[i]),
    tcp: pose.tcp.map((value, i) => value + magnified * tcp[i]),
    turn: pose.turn + magnified * turn,
  };
}

function ghostsOf(report) {
  const [run, ...others] = report.runs;
  const ghosts = [];
  if (run.has('tcp_error') && run.has('following_error')) {
    ghosts.push({
      run, text: 'command', colour: 'command', initially: others.length === 0,
      pose: (time, actual, magnified) =>
        off(
          actual, run.at('following_error', time, true), run.at('tcp_error', time, true),
          turnOf(run, 'turn_error', time), magnified,
        ),
    });
  }
  if (run.has('tcp_true') && run.has('arm_angle')) {
    ghosts.push({
      run, text: 'true pose', colour: 'true', initially: false,
      pose: (time, actual, magnified) => {
        const tcp = run.at('tcp_true', time, true).map((value, i) => value - actual.tcp[i]);
        const angles = run.at('arm_angle', time, true).map((value, i) => value - actual.angles[i]);
        const turn = run.has('turn_true') ? turnOf(run, 'turn_true', time) - actual.turn : 0;
        return off(actual, angles, tcp, turn, magnified);
      },
    });
  }
  for (const other of others) {
    ghosts.push({
      run: other, text: other.name, colour: `run${other.number}`, initially: true,
      pose: (time, actual, magnified) => {
        const pose = actualPose(other, time);
        const tcp = pose.tcp.map((value, i) => value - actual.tcp[i]);
        const angles = pose.angles.map((value, i) => value - actual.angles[i]);
        return off(actual, angles, tcp, pose.turn - actual.turn, magnified);
      },
    });
  }
  return ghosts;
}

// Whether a run carries a payload at a time: what it began with, or the newest mark that tells one.
function carries(run, time) {
  let payload = run.payload_kg;
  for (const [when, kg] of run.payloads) {
    if (when > time + 1e-9) break;
    payload = kg;
  }
  return payload > 0;
}

// The way of a TCP as a line; of a long run every n-th cycle.
class Path {
  constructor(run, name, style) {
    Object.assign(this, { run, style });
    const [x, y, z] = run.columns[name];
    this.step = Math.max(1, Math.ceil(run.cycles / PATH_POINTS));
    const places = [];
    for (let i = 0; i < run.cycles; i += this.step) {
      const last = places.slice(-3);
      const place = [x[i], y[i], z[i]];
      places.push(...(place.every(Number.isFinite) ? place : last.length ? last : [0, 0, 0]));
    }
    if (places.length < 6) places.push(...places.slice(-3));
    this.count = places.length / 3 - 1;
    const material = new LineMaterial({ color: colour(style.colour), linewidth: style.width, transparent: true });
    if (style.kind === 'planned') material.opacity = 0.55;
    this.line = new Line2(new LineGeometry().setPositions(places), material);
    this.line.frustumCulled = false;
  }

  showUntil(time) {
    const cycle = (time - this.run.first_s) / this.run.period_s;
    this.line.geometry.instanceCount = Math.min(Math.max(Math.floor(cycle / this.step + 1e-6), 0), this.count);
  }
}
