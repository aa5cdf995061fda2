// A cursor in every chart, at the time that is shown, with the curves' values there; pointing at a chart moves it.

/** Value of a curve at a time, between its samples; null in its gaps and beyond its ends. */
function valueAt({ time, values }, at) {
  let low = 0, high = time.length - 1;
  if (!(at >= time[0] - 1e-3 && at <= time[high] + 1e-3)) return null;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (time[middle] <= at) low = middle; else high = middle;
  }
  const a = values[low], b = values[high];
  if (a === null || b === null) return null;
  const share = time[high] > time[low] ? Math.min(Math.max((at - time[low]) / (time[high] - time[low]), 0), 1) : 0;
  return a + share * (b - a);
}

class Chart {
  constructor(figure, pointed) {
    this.svg = figure.querySelector("svg");
    this.readout = figure.querySelector(".readout");
    Object.assign(this, JSON.parse(figure.dataset.numbers));
    [this.left, this.top, this.right, this.bottom] = this.box;
    [this.t0, this.t1] = this.span;
    this.cursor = document.createElementNS("http://www.w3.org/2000/svg", "line");
    for (const [key, value] of Object.entries({ class: "cursor", y1: this.top, y2: this.bottom })) {
      this.cursor.setAttribute(key, value);
    }
    this.svg.append(this.cursor);
    const point = (event, chosen) => {
      const box = this.svg.getBoundingClientRect();
      const x = ((event.clientX - box.left) / box.width) * this.svg.viewBox.baseVal.width;
      if (x < this.left - 4 || x > this.right + 4) return;
      const share = Math.min(Math.max((x - this.left) / (this.right - this.left), 0), 1);
      pointed(this.t0 + share * (this.t1 - this.t0), chosen);
    };
    this.svg.addEventListener("pointermove", (event) => point(event, false));
    this.svg.addEventListener("pointerdown", (event) => point(event, true));
  }

  show(time) {
    const x = this.left + ((time - this.t0) / Math.max(this.t1 - this.t0, 1e-9)) * (this.right - this.left);
    const inside = x >= this.left - 1 && x <= this.right + 1;
    this.cursor.setAttribute("visibility", inside ? "visible" : "hidden");
    this.cursor.setAttribute("x1", x);
    this.cursor.setAttribute("x2", x);
    const parts = [`${time.toFixed(2)} s`];
    for (const curve of this.curves) {
      const value = inside ? valueAt(curve, time) : null;
      if (value === null) continue;
      parts.push(`${curve.name} ${value.toFixed(this.decimals).replace(/^-(0\.?0*)$/, "$1")}${this.unit}`);
    }
    this.readout.textContent = parts.join("  ·  ");
  }
}

export function charts(pointed) {
  return [...document.querySelectorAll("figure.chart")].map((figure) => new Chart(figure, pointed));
}
