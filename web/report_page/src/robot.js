// A robot made of the parts that the report holds, put where arm angles and a TCP say.
//
// Sizes and joints come from delta3_pacdrive/scene. An arm turns about its motor, a rod stands between the joint at the
// elbow and that at the plate, the plate is at the TCP and never turned: nothing here knows kinematics. The tool of a
// rotary axis turns with what hangs on it, and its bar leads from the middle of the motor axes to the top of the tool.

import {
  BoxGeometry, Color, CylinderGeometry, DoubleSide, Group, Mesh, MeshLambertMaterial, Quaternion, SphereGeometry,
  SRGBColorSpace, Vector3,
} from 'three';

const X = new Vector3(1, 0, 0);
const Y = new Vector3(0, 1, 0);
const Z = new Vector3(0, 0, 1);
const PALE = new Color(0xc8d4e0);
const DIM = 0.1; // lightness of a part that is lost before a dark background
const TURNED = ['tool', 'payload', 'pointer'];
const AT_TCP = ['plate', ...TURNED];

function geometryOf(shape) {
  if (shape.kind === 'box') return new BoxGeometry(...shape.size_m);
  if (shape.kind === 'sphere') return new SphereGeometry(shape.radius_m, 20, 14);
  // cylinders of three.js stand along y, those of the scene along z
  const segments = shape.radius_m > 0.1 ? 64 : 24;
  return new CylinderGeometry(shape.radius_m, shape.radius_m, shape.length_m, segments).rotateX(Math.PI / 2);
}

export class Robot {
  // Without a look it has its own colours and all parts; a ghost has one translucent colour and only what moves.
  constructor(document, look = null) {
    this.document = document;
    this.group = new Group();
    this.parts = new Map();
    for (const part of document.parts) {
      if (look && (!part.moves || part.name === 'payload')) continue;
      const material = this.materialOf(part, look);
      const group = new Group();
      for (const shape of part.shapes) {
        const mesh = new Mesh(geometryOf(shape), material);
        mesh.position.set(...shape.position_m);
        mesh.quaternion.set(...shape.quaternion);
        group.add(mesh);
      }
      this.parts.set(part.name, group);
      this.group.add(group);
    }
    this.placeMotors();
  }

  materialOf(part, look) {
    const [red, green, blue, opacity] = part.colour;
    const material = new MeshLambertMaterial();
    material.color.setRGB(red, green, blue, SRGBColorSpace);
    if (look) {
      material.color.set(look.colour);
      material.emissive.set(look.colour).multiplyScalar(0.35);
    }
    else material.userData.own = material.color.clone();
    const seen = look ? look.opacity : part.name === 'workspace' ? 0.6 * opacity : opacity;
    // where a ghost is in the same place, the robot is seen
    if (look) Object.assign(material, { polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2 });
    if (seen < 1) Object.assign(material, { transparent: true, opacity: seen, depthWrite: false });
    if (part.name === 'workspace') material.side = DoubleSide;
    return material;
  }

  part(name) {
    return this.parts.get(name) ?? new Group();
  }

  placeMotors() {
    this.document.azimuths.forEach((azimuth, i) => {
      const motor = this.part(`motor${i + 1}`);
      motor.position.set(...this.document.hips[i]);
      motor.quaternion.setFromAxisAngle(Z, azimuth);
    });
  }

  // Put all parts where arm angles [rad], a TCP [m] and the angle of the tool [rad] say.
  place(angles, tcp, turned = 0) {
    if (![...angles, ...tcp, turned].every(Number.isFinite)) return;
    const { hips, joints, azimuths, arms } = this.document;
    const turn = new Quaternion();
    const [start, end, along] = [new Vector3(), new Vector3(), new Vector3()];
    azimuths.forEach((azimuth, i) => {
      const upper = this.part(`arm${i + 1}`);
      upper.position.set(...hips[i]);
      upper.quaternion.setFromAxisAngle(Z, azimuth).multiply(turn.setFromAxisAngle(Y, angles[i]));
      const elbow = new Vector3(arms[i], 0, 0).applyQuaternion(upper.quaternion).add(upper.position);
      const middle = new Vector3(...joints[i][0]).add(new Vector3(...joints[i][1])).multiplyScalar(0.5);
      ['a', 'b'].forEach((name, n) => {
        const rod = this.part(`forearm${i + 1}${name}`);
        end.set(...joints[i][n]);
        start.copy(end).sub(middle).add(elbow);
        end.add(new Vector3(...tcp));
        rod.position.copy(start);
        rod.quaternion.setFromUnitVectors(X, along.copy(end).sub(start).normalize());
      });
    });
    for (const name of AT_TCP) this.part(name).position.set(...tcp);
    for (const name of TURNED) this.part(name).quaternion.setFromAxisAngle(Z, turned);
    if (this.document.bar_top !== undefined) this.placeBar(tcp, turned);
    this.tcp = tcp;
    this.turned = turned;
  }

  placeBar(tcp, turned) {
    const top = new Vector3(tcp[0], tcp[1], tcp[2] + this.document.bar_top);
    this.part('bar_rod').position.copy(top);
    const along = top.clone().negate().normalize();
    for (const name of ['bar_tube', 'bar_rod']) {
      const { quaternion } = this.part(name);
      quaternion.setFromUnitVectors(Z, along).multiply(new Quaternion().setFromAxisAngle(Z, turned));
    }
  }

  // Give a robot without a look its own colours; before a dark background dark ones are paler.
  repaint(dark) {
    this.group.traverse(({ material }) => {
      const own = material?.userData.own;
      if (own) material.color.copy(own).lerp(PALE, dark && own.getHSL({}).l < DIM ? 0.35 : 0);
    });
  }

  showPart(name, shown) {
    this.part(name).visible = shown;
  }

  dispose() {
    this.group.traverse((object) => {
      object.geometry?.dispose();
      object.material?.dispose();
    });
  }
}

