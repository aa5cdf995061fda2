// A wearer: the skeleton as nested objects, and on it tapered, round-ended pieces.
import { Color, LatheGeometry, Mesh, MeshStandardMaterial, Object3D, Quaternion, Vector2, Vector3 } from "three";

const ARC = 7, AROUND = 20;  // points of a round end's quarter, and around a piece

/** Numbers of a base64 text, as an array of a type: little-endian, as all browsers' machines are. */
export function numbers(text, Type) {
  const bytes = Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
  return new Type(bytes.buffer);
}

/** A rounded piece from the origin along y, of two radii. */
function taperedPiece(length, radiusStart, radiusEnd) {
  // Where both balls have one tangent: at this angle above their equators.
  const tilt = Math.asin(Math.max(-1, Math.min(1, (radiusStart - radiusEnd) / Math.max(length, 1e-6))));
  const outline = [];
  for (const [radius, height, from, to] of [
    [radiusStart, 0, -Math.PI / 2, tilt],
    [radiusEnd, length, tilt, Math.PI / 2],
  ]) {
    for (let step = 0; step <= ARC; step++) {
      const angle = from + ((to - from) * step) / ARC;
      outline.push(new Vector2(Math.max(radius * Math.cos(angle), 0), height + radius * Math.sin(angle)));
    }
  }
  return new LatheGeometry(outline, AROUND);
}

function piece([, x0, y0, z0, x1, y1, z1, radiusStart, radiusEnd], material) {
  const start = new Vector3(x0, y0, z0), along = new Vector3(x1, y1, z1).sub(start);
  const mesh = new Mesh(taperedPiece(along.length(), radiusStart, radiusEnd), material);
  mesh.position.copy(start);
  if (along.length() > 0) mesh.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), along.normalize());
  mesh.castShadow = true;
  return mesh;
}

/** Poses of something at frames: quaternions (x, y, z, w) in 1/32767, positions in metres. */
export class Poses {
  constructor({ rotations, positions }, joints) {
    this.joints = joints;
    this.rotations = numbers(rotations, Int16Array);
    this.positions = numbers(positions, Float32Array);
  }

  /** Put the quaternion of a joint, between frame and the next one, into `out`. */
  rotation(frame, next, share, joint, out) {
    this.#quaternion(frame, joint, out);
    if (share > 0) out.slerp(this.#quaternion(next, joint, spare), share);
    return out;
  }

  #quaternion(frame, joint, out) {
    return out.fromArray(this.rotations, 4 * (frame * this.joints + joint)).normalize();
  }

  position(frame, next, share, out) {
    out.fromArray(this.positions, 3 * frame);
    return share > 0 ? out.lerp(sparePosition.fromArray(this.positions, 3 * next), share) : out;
  }
}

const spare = new Quaternion(), sparePosition = new Vector3();

export class Body {
  constructor(data) {
    this.name = data.name;
    this.poses = new Poses(data, data.parents.length);
    this.root = new Object3D();
    this.bones = data.parents.map((parent, joint) => {
      const bone = new Object3D();
      bone.position.fromArray(data.offsets[joint]);
      return bone;
    });
    data.parents.forEach((parent, joint) => (parent < 0 ? this.root : this.bones[parent]).add(this.bones[joint]));
    const materials = new Map();
    for (const one of data.pieces) {
      const colour = one[9];
      if (!materials.has(colour)) {
        materials.set(colour, new MeshStandardMaterial({
          color: new Color(colour), roughness: 0.75, transparent: data.ghost, opacity: data.ghost ? 0.3 : 1,
          depthWrite: !data.ghost,
        }));
      }
      this.bones[one[0]].add(piece(one, materials.get(colour)));
    }
  }

  show(frame, next, share) {
    this.bones.forEach((bone, joint) => this.poses.rotation(frame, next, share, joint, bone.quaternion));
    this.poses.position(frame, next, share, this.bones[0].position);
  }

  get place() {
    return this.bones[0].position;
  }
}
