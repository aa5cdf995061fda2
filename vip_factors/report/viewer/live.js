// The live page: answers come over a WebSocket; the newest is shown, and asked for again when the connection is lost.
import { find, Stage } from "./stage.js";

const RETRY_MS = 1000, READABLE_MS = 120;  // numbers that change faster cannot be read
const FLOOR_ANSWERS = 120;  // that the floor is found of: a jump must not move it
const BALL_OVER_SOLE_M = 0.021, APART_M = 1.4, MOST_FINDINGS = 5;

export function showLive() {
  const data = JSON.parse(find("live").textContent);
  const stage = new Stage(data), { world } = stage, bodies = world ? world.bodies : [];
  const poses = data.bodies.map(({ parents }) => (
    { rotations: new Float32Array(4 * parents.length), positions: new Float32Array(3) }
  ));
  bodies.forEach((body, index) => {
    Object.assign(body.poses, poses[index]);
    body.root.visible = false;  // until it is known how it stands
  });
  const lowest = [], told = [], times = [];
  let newest = null, shown = -1, read = 0, shifts = null, begun = false, ended = false;

  const tell = (id, text) => (find(id).textContent = text);

  function tellState(state, words) {
    document.body.dataset.state = state;
    tell("state", words);
  }

  function connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/stream${location.search}`);
    socket.addEventListener("open", () => newest || tellState("waiting", "waiting for the first pose"));
    socket.addEventListener("message", ({ data: text }) => take(JSON.parse(text)));
    socket.addEventListener("close", ({ reason }) => {
      ended = reason !== "";
      tellState(ended ? "ended" : "lost", ended ? reason : "no connection, trying again");
      if (!ended) setTimeout(connect, RETRY_MS);
    });
  }

  function take(answer) {
    if (answer.version !== data.version) return tellState("lost", "this page is of another version: load it again");
    if (!newest) requestAnimationFrame(show);
    newest = answer;
    times.push(performance.now());
    if (answer.findings.length) {
      told.unshift(...answer.findings.reverse());
      told.length = Math.min(told.length, MOST_FINDINGS);
      find("findings").replaceChildren(...told.map(({ severity, text }) => {
        const item = document.createElement("li");
        item.className = severity;
        item.textContent = text;
        return item;
      }));
    }
    tellState("live", answer.preliminary ? "live, still calibrating" : "live");
  }

  const chosen = (wearer) => (find("pose").value === "smoothed" && wearer.smoothed) || wearer.newest;

  function show(now) {
    if (newest.frame !== shown) {
      shown = newest.frame;
      if (world) place();
      document.body.dataset.frame = String(shown);
    }
    if (now - read > READABLE_MS) {
      read = now;
      tellNumbers(now);
    }
    requestAnimationFrame(show);
  }

  function place() {
    const all = newest.wearers.map(chosen);
    shifts ??= all.map((one, index) => (data.apart ? apart(all[0], one, index) : [0, 0, 0]));
    all.forEach(({ joints }, index) => {
      const of = Object.values(joints), at = of[0].position;
      if (at.includes(null)) return;
      bodies[index].root.visible = true;
      of.forEach(({ rotation_wxyz: [w, x, y, z], position }, joint) => {
        poses[index].rotations.set([x, y, z, w], 4 * joint);
        stretch(bodies[index].bones[joint], joint, position, of[data.bodies[index].parents[joint]]);
      });
      poses[index].positions.set(at.map((one, axis) => one + shifts[index][axis]));
    });
    world.cameras.forEach(({ poses: at, frustum }, index) => {
      const camera = newest.cameras.find(({ name }) => name === data.cameras[index].name);
      frustum.visible = Boolean(camera);
      if (!camera) return;
      const { orientation_wxyz: [w, x, y, z], position } = camera[find("pose").value] ?? camera.newest;
      Object.assign(at, { rotations: Float32Array.of(x, y, z, w), positions: Float32Array.from(position) });
    });
    lowest.push(Math.min(all[0].joints.left_foot.position[2], all[0].joints.right_foot.position[2]));
    if (lowest.length > FLOOR_ANSWERS) lowest.shift();
    data.floor = [...lowest].sort((a, b) => a - b)[lowest.length >> 1] - BALL_OVER_SOLE_M;
    world.show(0);
    world.stand();
    if (bodies.length > 1) world.back();
    if (!begun) stage.begin();
    begun = true;
    stage.draw();
  }

  /** The body is being found: a joint stays as far from the one above it as it is now said to be. */
  function stretch(bone, joint, position, above) {
    if (!joint) return;
    const offset = bone.position.fromArray(position.map((one, axis) => one - above.position[axis]));
    const [w, x, y, z] = above.orientation_wxyz;
    offset.applyQuaternion({ x: -x, y: -y, z: -z, w });
  }

  function apart(first, one, index) {
    const a = first.joints.pelvis.position, b = one.joints.pelvis.position;
    return [a[0] - b[0], a[1] - b[1] + APART_M * index, a[2] - b[2]];
  }

  function tellNumbers(now) {
    while (times.length && now - times[0] > 1000) times.shift();
    tell("clock", `${newest.time.toFixed(1)} s`);
    tell("rate", `${times.length} a second`);
    tell("verdict", newest.verdict);
    find("verdict").className = newest.verdict;
    for (const cell of document.querySelectorAll("[data-angle]")) {
      const value = chosen(newest.wearers[cell.dataset.wearer]).angles_deg[cell.dataset.angle];
      cell.textContent = value === null ? "\u2013" : `${value.toFixed(0).replace(/^-0$/, "0")}°`;
    }
  }

  Object.assign(document.body.dataset, { viewer: "ready", webgl: world ? "yes" : "no" });
  tellState("waiting", "connecting");
  connect();
}
