// What stands around the robot, and the parts: each goes with what bears it, its belt or the TCP that is shown.
//
// Things are level areas. Belts have marks that go with their surface; parts are boxes with their colour, by type, and
// those that fell, were pressed or lost have the colour of faults.

import {
  BoxGeometry, BufferGeometry, Color, DoubleSide, Group, InstancedMesh, LineBasicMaterial, LineLoop, Matrix4, Mesh,
  MeshBasicMaterial, MeshLambertMaterial, PlaneGeometry, Quaternion, Vector3,
} from 'three';

import { colour } from './theme.js';

const Z = new Vector3(0, 0, 1);
const SLAB_M = 0.012; // thickness of a belt
const MARKS_M = 0.1; // from mark to mark on a belt
const MARK_M = 0.008; // length of a mark
const BEAM_M = 0.02; // height of a light barrier over its belt
const LIFT_M = { box: -0.002, supply: -0.002, belt: 0, window: 0.001, camera: 0.0015, sensor: 0.002, barrier: BEAM_M };
const FILL = { box: 0.25, supply: 0.12, window: 0.13, camera: 0.22, sensor: 0.1, barrier: 0.9 };
const CORNERS = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];
const CIRCLE = Array.from({ length: 48 }, (_, n) => [
  0.5 * Math.cos((n * Math.PI) / 24), 0.5 * Math.sin((n * Math.PI) / 24),
]);
const TYPE_COLOURS = 4;
const WENT_WRONG = ['dropped', 'pressed', 'lost'];

export class Cell {
  constructor(run, document) {
    this.run = run;
    Object.assign(this, document);
    this.group = new Group();
    this.painted = []; // materials with the names of their colours
    this.marks = [];
    this.things.forEach((thing) => this.addThing(thing));
    this.boxes = this.addBoxes();
    this.repaint();
  }

  material(made, name) {
    this.painted.push([made, name]);
    return made;
  }

  // A thing lies in a group of its own: there x is its length and y its width.
  addThing([kind, x, y, z, angle, length, width]) {
    const place = new Group();
    place.position.set(x, y, z + LIFT_M[kind]);
    place.quaternion.setFromAxisAngle(Z, angle);
    this.group.add(place);
    if (kind === 'belt') {
      const slab = new Mesh(new BoxGeometry(length, width, SLAB_M), this.material(new MeshLambertMaterial(), 'belt'));
      slab.position.z = -0.5 * SLAB_M;
      const count = Math.ceil(length / MARKS_M) + 1;
      const paint = this.material(new MeshBasicMaterial(), 'marks');
      const marks = new InstancedMesh(new BoxGeometry(MARK_M, width, 0.0005), paint, count);
      marks.frustumCulled = false;
      place.add(slab, marks);
      this.marks.push({ marks, length });
      return;
    }
    const options = { transparent: true, opacity: FILL[kind], depthWrite: false, side: DoubleSide };
    const outline = kind === 'sensor' ? CIRCLE : CORNERS;
    if (kind !== 'sensor') {
      place.add(new Mesh(new PlaneGeometry(length, width), this.material(new MeshBasicMaterial(options), kind)));
    }
    const points = outline.map(([u, v]) => new Vector3(u * length, v * width, 0));
    const line = new LineLoop(new BufferGeometry().setFromPoints(points), this.material(new LineBasicMaterial(), kind));
    place.add(line);
  }

  addBoxes() {
    // stays of each part, in the order of their cycles
    this.stays = this.parts.map(() => []);
    const [part, cycle, how, belt] = this.table.stays;
    const [x, y, z, angle, begin] = this.table.places;
    for (let i = 0; i < this.rows; i += 1) {
      this.stays[part[i]].push({
        cycle: cycle[i], how: this.hows[how[i]], belt: belt[i], at: [x[i], y[i], z[i]], angle: angle[i], begin: begin[i],
      });
    }
    const boxes = new InstancedMesh(new BoxGeometry(1, 1, 1), new MeshLambertMaterial(), Math.max(this.parts.length, 1));
    boxes.frustumCulled = false;
    boxes.count = 0;
    this.group.add(boxes);
    return boxes;
  }

  // Way of a belt at a time [m], between two bus cycles, from the first cycle of the run on.
  way(belt, time) {
    const { run } = this;
    const ways = this.table.ways[belt];
    const cycle = run.cycleAt(time);
    const share = Math.min(Math.max((time - run.first_s) / run.period_s - cycle, 0), 1);
    return cycle + 1 < run.cycles && share > 0 ? ways[cycle] + share * (ways[cycle + 1] - ways[cycle]) : ways[cycle];
  }

  // Where the parts are at a time, those in hand with a TCP [m] and the angle of the tool [rad]: number, middle of the
  // underside [m], angle [rad], row.
  places(time, tcp, turned = 0) {
    const cycle = this.run.cycleAt(time);
    const ways = this.belts.map((_, belt) => this.way(belt, time));
    const found = [];
    this.stays.forEach((stays, row) => {
      const stay = stays.findLast((one) => one.cycle <= cycle);
      if (!stay || stay.how === 'gone') return;
      const at = [...stay.at];
      const turn = stay.how === 'in hand' ? turned : 0;
      if (stay.how === 'in hand') {
        const [x, y] = at;
        at[0] = Math.cos(turn) * x - Math.sin(turn) * y;
        at[1] = Math.sin(turn) * x + Math.cos(turn) * y;
        at.forEach((_, i) => { at[i] += tcp ? tcp[i] : NaN; });
      }
      if (stay.how === 'riding') {
        const gone = stay.belt < 0 ? NaN : ways[stay.belt] - stay.begin;
        const direction = stay.belt < 0 ? 0 : this.things[this.belts[stay.belt]][4];
        at[0] += gone * Math.cos(direction);
        at[1] += gone * Math.sin(direction);
      }
      if (at.every(Number.isFinite)) found.push({ row, number: this.parts[row][0], at, angle: stay.angle + turn });
    });
    return found;
  }

  // Put everything where a time says, parts in hand to a TCP [m], turned as the tool is [rad].
  place(time, tcp, turned) {
    const matrix = new Matrix4();
    const turn = new Quaternion();
    const found = this.places(time, tcp, turned);
    found.forEach(({ row, at, angle }, n) => {
      const [, type] = this.parts[row];
      const size = this.sizes[type];
      const middle = new Vector3(at[0], at[1], at[2] + 0.5 * size[2]);
      this.boxes.setMatrixAt(n, matrix.compose(middle, turn.setFromAxisAngle(Z, angle), new Vector3(...size)));
      this.boxes.setColorAt(n, this.colours[row]);
    });
    this.boxes.count = found.length;
    this.boxes.instanceMatrix.needsUpdate = true;
    if (this.boxes.instanceColor) this.boxes.instanceColor.needsUpdate = true;
    this.marks.forEach(({ marks, length }, belt) => {
      const way = this.way(belt, time);
      const first = (((Number.isFinite(way) ? way : 0) % MARKS_M) + MARKS_M) % MARKS_M;
      let count = 0;
      for (let along = first; along <= length; along += MARKS_M) {
        marks.setMatrixAt(count, matrix.makeTranslation(along - 0.5 * length, 0, 0.0003));
        count += 1;
      }
      marks.count = count;
      marks.instanceMatrix.needsUpdate = true;
    });
  }

  // Colours of the theme.
  repaint() {
    for (const [material, name] of this.painted) material.color.set(colour(name));
    this.colours = this.parts.map(([, type, outcome]) => {
      if (WENT_WRONG.includes(outcome)) return new Color(colour('fault'));
      return new Color(colour(`part${1 + (type % TYPE_COLOURS)}`));
    });
  }
}
