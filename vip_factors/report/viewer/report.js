// The report: a time that the 3D view, the slider and the charts share.
import { charts } from "./charts.js";
import { find, Stage } from "./stage.js";

export function showReport() {
  const data = JSON.parse(find("motion").textContent);
  const [slider, play, clock, speed] = ["slider", "play", "clock", "speed"].map(find);
  const last = data.frames - 1;
  let place = 0, playing = false, before = 0;
  const stage = new Stage(data), { world } = stage, films = [...document.querySelectorAll("video")];

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
    for (const film of films) {
      if (!playing && !isUsed(film)) film.currentTime = Math.max((time - film.dataset.start) / film.dataset.pace, 0);
    }
    stage.draw();
  }

  const setTime = (time) => setPlace((time - data.start) * data.rate);

  function setPlaying(to) {
    playing = to && last > 0;
    play.textContent = playing ? "Pause" : "Play";
    if (!playing) return;
    films.forEach((film) => film.pause());
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

  const isUsed = (film) => !film.paused || film.matches(":hover");

  /** The page's time is that of a film while somebody plays or scrubs it. */
  function follow(film) {
    if (isUsed(film) && !playing) setTime(Number(film.dataset.start) + film.currentTime * film.dataset.pace);
    if (!film.paused) requestAnimationFrame(() => follow(film));
  }

  films.forEach((film) => {
    film.addEventListener("play", () => {
      setPlaying(false);
      films.forEach((other) => other !== film && other.pause());
      requestAnimationFrame(() => follow(film));
    });
    film.addEventListener("seeked", () => follow(film));
  });
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
  if (world) {
    find("canvas").addEventListener("keydown", (event) => {
      if (event.key === " ") {
        event.preventDefault();
        setPlaying(!playing);
      }
    });
  }
  setTime(data.shown);
  stage.begin();
  Object.assign(document.body.dataset, {
    viewer: "ready", webgl: world ? "yes" : "no", frames: String(data.frames), charts: String(drawn.length),
    bodies: String(data.bodies.length),
  });
}
