// Where the 3D view stands on a page: drawn when something has changed, names over heads, buttons to look from.
import { World } from "./world.js";

export const find = (id) => document.getElementById(id);

export class Stage {
  constructor(data) {
    this.data = data;
    this.labels = new Map();
    this.waiting = false;
    this.world = this.#open();
    if (!this.world) return;
    document.body.classList.add("with-3d");
    this.#name();
    const follow = find("follow");
    follow.addEventListener("change", () => (this.world.follows = follow.checked));
    for (const button of document.querySelectorAll("button[data-look]")) {
      button.addEventListener("click", () => {
        this.world.look(button.dataset.look);
        this.draw();
      });
    }
    new ResizeObserver(() => this.draw()).observe(find("stage"));
    this.#paint();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#paint());
  }

  /** The first picture, at once. */
  begin() {
    if (!this.world) return;
    this.world.look("front");
    this.#render();
  }

  draw() {
    if (this.waiting || !this.world) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.#render();
    });
  }

  #open() {
    try {
      return new World(find("canvas"), this.data, () => this.draw());
    } catch (problem) {
      if (!/webgl/i.test(String(problem))) throw problem;
      return null;
    }
  }

  /** In the colours of the page's style, which has others in the dark. */
  #paint() {
    const style = getComputedStyle(document.documentElement);
    const names = ["ground", "major", "minor", "wire"];
    this.world.paint(Object.fromEntries(names.map((one) => [one, style.getPropertyValue(`--${one}`).trim()])));
    this.draw();
  }

  #render() {
    this.world.render();
    for (const [body, label] of this.labels) {
      const at = this.world.labelPlace(body);
      label.hidden = at === null;
      if (at) label.style.transform = `translate(-50%, -100%) translate(${at[0].toFixed(1)}px, ${at[1].toFixed(1)}px)`;
    }
  }

  #name() {
    const own = this.world.bodies.filter((_, index) => !this.data.bodies[index].ghost);
    for (const body of own.length > 1 ? own : []) {
      const label = document.createElement("span");
      label.className = "label";
      label.textContent = body.name;
      find("stage").append(label);
      this.labels.set(body, label);
    }
  }
}
