// A wearer: the skeleton as nested bones, and the skin that they move.
import {
  Bone, BoxGeometry, BufferAttribute, BufferGeometry, Color, Mesh, MeshStandardMaterial, Object3D, Quaternion, Skeleton,
  SkinnedMesh, Vector3,
} from "three";

/** Numbers of a base64 text, as an array of a type: little-endian, as all browsers' machines are. */
export function numbers(text, Type) {
  const bytes = Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
  return new Type(bytes.buffer);
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
const SENSOR_M = [0.052, 0.038, 0.02], SENSOR_COLOUR = "#2c3038";

/** A skin of a body, in the pose in which it was made. */
export function skinOf({ points, faces, bones, shares }) {
  const geometry = new BufferGeometry(), vertices = Float32Array.from(numbers(points, Int16Array), (one) => one / 1e4);
  const Index = vertices.length / 3 < 1 << 16 ? Uint16Array : Uint32Array;
  geometry.setIndex(new BufferAttribute(numbers(faces, Index), 1));
  geometry.setAttribute("position", new BufferAttribute(vertices, 3));
  geometry.setAttribute("skinIndex", new BufferAttribute(numbers(bones, Uint8Array), 4));
  geometry.setAttribute("skinWeight", new BufferAttribute(numbers(shares, Uint8Array), 4, true));
  geometry.computeVertexNormals();
  return geometry;
}

/** Colours of a skin's vertices: of the bones that move them, in their shares. */
function coloursOf(skin, colours) {
  const { skinIndex, skinWeight } = skin.attributes, tones = colours.map((one) => new Color(one));
  const mixed = new Float32Array(3 * skinIndex.count), sum = new Color();
  for (let vertex = 0; vertex < skinIndex.count; vertex++) {
    sum.setRGB(0, 0, 0);
    for (let of = 0; of < 4; of++) {
      const tone = tones[skinIndex.getComponent(vertex, of)], share = skinWeight.getComponent(vertex, of);
      sum.r += share * tone.r;
      sum.g += share * tone.g;
      sum.b += share * tone.b;
    }
    sum.toArray(mixed, 3 * vertex);
  }
  return new BufferAttribute(mixed, 3);
}

export class Body {
  constructor(data, { skin, pose }) {
    this.name = data.name;
    this.poses = new Poses(data, data.parents.length);
    this.root = new Object3D();
    const made = numbers(pose, Int16Array);
    this.bones = data.parents.map((parent, joint) => {
      const bone = new Bone();
      bone.position.fromArray(data.offsets[joint]);
      bone.quaternion.fromArray(made, 4 * joint).normalize();
      return bone;
    });
    data.parents.forEach((parent, joint) => (parent < 0 ? this.root : this.bones[parent]).add(this.bones[joint]));
    this.bones[0].position.set(0, 0, 0);
    this.root.updateMatrixWorld(true);
    const own = skin.clone();
    own.setAttribute("color", coloursOf(skin, data.colours));
    const mesh = new SkinnedMesh(own, new MeshStandardMaterial({
      vertexColors: true, roughness: 0.75, transparent: data.ghost, opacity: data.ghost ? 0.3 : 1,
    }));
    mesh.bind(new Skeleton(this.bones), mesh.matrixWorld);
    mesh.castShadow = !data.ghost;
    mesh.frustumCulled = false;  // its bounds are those of one pose
    this.root.add(mesh);
    for (const sensor of data.sensors ?? []) this.#wear(sensor);
  }

  /** A box on its bone, flat on the skin: the sensor's z points out of it. */
  #wear({ bone, position, rotation }) {
    const box = new Mesh(new BoxGeometry(...SENSOR_M), new MeshStandardMaterial({ color: SENSOR_COLOUR, roughness: 0.6 }));
    box.position.fromArray(position);
    box.quaternion.fromArray(rotation);
    this.bones[bone].add(box);
  }

  show(frame, next, share) {
    this.bones.forEach((bone, joint) => this.poses.rotation(frame, next, share, joint, bone.quaternion));
    this.poses.position(frame, next, share, this.bones[0].position);
  }

  get place() {
    return this.bones[0].position;
  }
}
