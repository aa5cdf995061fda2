// The page's one script: a time that the 3D view, the slider and the charts share.
import { charts } from "./charts.js";
import { World } from "./world.js";

const data = JSON.parse(document.getElementById("motion").textContent);
const find = (id) => document.getElementById(id);
const [slider, play, clock, speed, follow] = ["slider", "play", "clock", "speed", "follow"].map(find);
const last = data.frames - 1;
let place = 0, playing = false, before = 0, waiting = false, world = null;

function openWorld() {
  try {
    return new World(find("canvas"), data, draw);
  } catch (problem) {
    if (!/webgl/i.test(String(problem))) throw problem;
    return null;
  }
}

function draw() {
  if (waiting || !world) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    world.render();
    placeLabels();
  });
}

function setPlace(to) {
  place = Math.min(Math.max(to, 0), last);
  const time = data.start + place / data.rate;
  slider.value = String(place);
  clock.textContent = `${time.toFixed(2)} s`;
  if (world) {
    world.place = place;
    world.show(place);
  }
  drawn.forEach((chart) => chart.show(time));
  draw();
}

const setTime = (time) => setPlace((time - data.start) * data.rate);

function setPlaying(to) {
  playing = to && last > 0;
  play.textContent = playing ? "Pause" : "Play";
  if (!playing) return;
  if (place >= last) setPlace(0);
  before = performance.now();
  requestAnimationFrame(step);
}

function step(now) {
  if (!playing) return;
  setPlace(place + ((now - before) / 1000) * data.rate * Number(speed.value));
  before = now;
  if (place >= last) setPlaying(false);
  else requestAnimationFrame(step);
}

const labels = new Map();

function placeLabels() {
  for (const [body, label] of labels) {
    const at = world.labelPlace(body);
    label.hidden = at === null;
    if (at) label.style.transform = `translate(-50%, -100%) translate(${at[0].toFixed(1)}px, ${at[1].toFixed(1)}px)`;
  }
}

function makeLabels() {
  const own = world.bodies.filter((_, index) => !data.bodies[index].ghost);
  for (const body of own.length > 1 ? own : []) {
    const label = document.createElement("span");
    label.className = "label";
    label.textContent = body.name;
    find("stage").append(label);
    labels.set(body, label);
  }
}

const drawn = charts((time, chosen) => {
  if (chosen) setPlaying(false);
  if (!playing) setTime(time);
});
slider.max = String(last);
slider.step = "any";
slider.addEventListener("input", () => {
  setPlaying(false);
  setPlace(Number(slider.value));
});
play.addEventListener("click", () => setPlaying(!playing));
for (const button of document.querySelectorAll("button[data-time]")) {
  button.addEventListener("click", () => {
    setPlaying(false);
    setTime(Number(button.dataset.time));
    find("motion-section").scrollIntoView();
  });
}

world = openWorld();
if (world) {
  document.body.classList.add("with-3d");
  makeLabels();
  follow.addEventListener("change", () => (world.follows = follow.checked));
  for (const button of document.querySelectorAll("button[data-look]")) {
    button.addEventListener("click", () => {
      world.look(button.dataset.look);
      draw();
    });
  }
  new ResizeObserver(draw).observe(find("stage"));
  find("canvas").addEventListener("keydown", (event) => {
    if (event.key === " ") {
      event.preventDefault();
      setPlaying(!playing);
    }
  });
}
setTime(data.shown);
if (world) {
  world.look("front");
  world.render();
  placeLabels();
}
Object.assign(document.body.dataset, {
  viewer: "ready", webgl: world ? "yes" : "no", frames: String(data.frames), charts: String(drawn.length),
  bodies: String(data.bodies.length),
});
