// The scene: bodies, floor, the cameras that filmed them; the eye that looks at it.
import {
  BufferGeometry, Color, DirectionalLight, Float32BufferAttribute, Fog, HemisphereLight, Line, LineBasicMaterial,
  LineSegments, Mesh, Object3D, PerspectiveCamera, PlaneGeometry, Scene, ShadowMaterial, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { Body, Poses, skinOf } from "./body.js";

const FRUSTUM_M = 0.6, TRACK_HEIGHT = 0.004;

export class World {
  constructor(canvas, data, changed) {
    this.canvas = canvas;
    canvas.world = this;  // for scripts, such as docs/capture.py
    this.data = data;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });  // so that it prints
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.shadowMap.enabled = true;
    this.scene = new Scene();
    this.scene.fog = new Fog("#ffffff", 12 + data.extent, 30 + 3 * data.extent);
    this.wire = new LineBasicMaterial();
    const meshes = data.meshes.map((one) => ({ skin: skinOf(one), pose: one.pose }));
    this.bodies = data.bodies.map((one) => new Body(one, meshes[one.mesh]));
    this.bodies.forEach((body) => this.scene.add(body.root));
    this.#ground();
    this.cameras = data.cameras.map((camera) => this.#camera(camera));
    this.eye = new PerspectiveCamera(38, 1, 0.05, 500);
    this.eye.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.eye, canvas);
    this.controls.addEventListener("change", changed);
    this.follows = true;
    this.look("front");
  }

  /** The middle of all wearers' pelvises, at a hip's height over the floor. */
  middle() {
    const own = this.bodies.filter((_, index) => !this.data.bodies[index].ghost);
    const sum = own.reduce((total, body) => total.add(body.place), new Vector3());
    return sum.divideScalar(own.length).setZ(this.data.floor + 0.9);
  }

  show(place) {
    const last = this.data.frames - 1, frame = Math.min(Math.floor(place), last), next = Math.min(frame + 1, last);
    this.bodies.forEach((body) => body.show(frame, next, place - frame));
    this.cameras.forEach(({ poses, frustum }) => {
      poses.rotation(frame, next, place - frame, 0, frustum.quaternion);
      poses.position(frame, next, place - frame, frustum.position);
    });
    const middle = this.middle();
    if (this.follows) {
      this.eye.position.add(middle).sub(this.controls.target);
      this.controls.target.copy(middle);
    }
    this.sun.position.copy(middle).add(new Vector3(1.5, -1, 5));
    this.sun.target.position.copy(middle);
  }

  /** Look from a side: front (of the first wearer as it stands now), side, above, or a camera by its number. */
  look(from) {
    this.show(this.place ?? 0);
    const middle = this.middle(), away = this.#distance();
    this.controls.target.copy(middle);
    if (this.cameras[from]) {
      this.eye.position.copy(this.cameras[from].frustum.position);
    } else {
      const left = new Vector3(1, 0, 0).applyQuaternion(this.bodies[0].bones[0].quaternion).setZ(0).normalize();
      const forward = new Vector3(left.y, -left.x, 0);
      const direction = {
        front: forward.clone().addScaledVector(left, 0.55).setZ(0.28), back: forward.clone().negate().setZ(0.2),
        left: left.clone().setZ(0.12), right: left.clone().negate().setZ(0.12),
        above: new Vector3(0, 0, 1).addScaledVector(forward, 0.02),
      }[from] ?? forward;
      this.eye.position.copy(middle).addScaledVector(direction.normalize(), away);
    }
    this.controls.update();
  }

  /** Further away, if those who are followed do not all fit into the picture any more. */
  back() {
    const { target } = this.controls, away = this.eye.position.clone().sub(target), least = this.#distance();
    if (this.follows && away.length() < least) this.eye.position.copy(target).add(away.setLength(least));
  }

  #distance() {
    const own = this.bodies.filter((_, index) => !this.data.bodies[index].ghost);
    const middle = this.middle();
    const spread = Math.max(...own.map((body) => body.place.distanceTo(middle)));
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    return (2.9 + 2.1 * spread) * (width ? Math.max(1, height / width) : 1);  // a narrow picture shows less of arms
  }

  render() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    const size = `${width} ${height}`;
    if (width && size !== this.size) {
      this.size = size;
      this.renderer.setSize(width, height, false);
      this.eye.aspect = width / height;
      this.eye.updateProjectionMatrix();
    }
    this.renderer.render(this.scene, this.eye);
  }

  /** Where on the canvas, in pixels, a body's label belongs; null if it is behind the eye. */
  labelPlace(body) {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    const at = body.bones[15].getWorldPosition(new Vector3());
    at.z += 0.32;
    at.project(this.eye);
    return at.z > 1 ? null : [((at.x + 1) / 2) * width, ((1 - at.y) / 2) * height];
  }

  /** Colours of the ground, of its lines, and of the camera's. */
  paint({ ground, major, minor, wire }) {
    this.scene.background = new Color(ground);
    this.scene.fog.color.set(ground);
    this.wire.color.set(wire);
    this.ground.remove(this.grid);
    this.grid = this.#lines(new Color(major), new Color(minor));
    this.ground.add(this.grid);
  }

  /** Tiles of a metre, each side by itself: software draws no line that goes on behind the eye. */
  #lines(major, minor) {
    const far = this.tiles / 2, places = [], colours = [];
    for (let across = -far; across <= far; across++) {
      const { r, g, b } = across ? minor : major;
      for (let along = -far; along < far; along++) {
        places.push(across, along, 0, across, along + 1, 0, along, across, 0, along + 1, across, 0);
        colours.push(r, g, b, r, g, b, r, g, b, r, g, b);
      }
    }
    const sides = new BufferGeometry();
    sides.setAttribute("position", new Float32BufferAttribute(places, 3));
    sides.setAttribute("color", new Float32BufferAttribute(colours, 3));
    return new LineSegments(sides, new LineBasicMaterial({ vertexColors: true }));
  }

  /** The ground under whoever walks away over a floor that is still being found. */
  stand() {
    const middle = this.middle();
    this.ground.position.set(Math.round(middle.x), Math.round(middle.y), this.data.floor);
  }

  #ground() {
    const { floor, centre, extent } = this.data;
    this.tiles = 2 * Math.ceil(extent / 2) + 10;
    this.ground = new Object3D();
    this.ground.position.set(Math.round(centre[0]), Math.round(centre[1]), floor);
    const shadows = new Mesh(new PlaneGeometry(4 * this.tiles, 4 * this.tiles), new ShadowMaterial({ opacity: 0.16 }));
    shadows.position.setZ(-0.002);
    shadows.receiveShadow = true;
    this.ground.add(shadows);
    this.sun = new DirectionalLight("#ffffff", 2.2);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(1024, 1024);
    const reach = 2.5 + extent / 2;
    Object.assign(this.sun.shadow.camera, { left: -reach, right: reach, top: reach, bottom: -reach, far: 30 });
    this.sun.shadow.bias = -0.001;
    this.sun.shadow.normalBias = 0.03;
    this.scene.add(this.ground, new HemisphereLight("#ffffff", "#cfcac2", 2.6), this.sun, this.sun.target);
    this.bodies.forEach((body, index) => {
      if (!this.data.bodies[index].ghost) this.scene.add(this.#track(body.poses, this.data.bodies[index].mark));
    });
  }

  #track(poses, colour) {
    const points = [];
    for (let at = 0; at < this.data.frames; at++) {
      points.push(new Vector3().fromArray(poses.positions, 3 * at).setZ(this.data.floor + TRACK_HEIGHT));
    }
    return new Line(new BufferGeometry().setFromPoints(points), new LineBasicMaterial({ color: colour }));
  }

  #camera(camera) {
    const corners = camera.corners.map((one) => new Vector3().fromArray(one).multiplyScalar(FRUSTUM_M));
    const points = [];
    corners.forEach((corner, index) => points.push(new Vector3(), corner, corner, corners[(index + 1) % 4]));
    const [a, b] = corners;  // a hat over the upper edge: which way up it was held
    const peak = a.clone().add(b).multiplyScalar(0.5).setY(a.y - 0.25 * a.distanceTo(b));
    points.push(a, peak, peak, b);
    const frustum = new LineSegments(new BufferGeometry().setFromPoints(points), this.wire);
    const poses = new Poses(camera, 1), path = [];
    for (let at = 0; at < this.data.frames; at++) path.push(new Vector3().fromArray(poses.positions, 3 * at));
    this.scene.add(frustum, new Line(new BufferGeometry().setFromPoints(path), this.wire));
    return { poses, frustum };
  }
}
