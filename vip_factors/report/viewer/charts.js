// A cursor in every chart, at the time that is shown, with the curves' values there; pointing at a chart moves it.

/** Value of a curve, drawn as lines of "x,y x,y …", at an x; null in its gaps. */
function heightAt(lines, x) {
  for (const points of lines) {
    if (x < points[0][0] - 0.5 || x > points[points.length - 1][0] + 0.5) continue;
    let low = 0, high = points.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (points[middle][0] <= x) low = middle; else high = middle;
    }
    const [x0, y0] = points[low], [x1, y1] = points[high];
    const share = x1 > x0 ? Math.min(Math.max((x - x0) / (x1 - x0), 0), 1) : 0;
    return y0 + share * (y1 - y0);
  }
  return null;
}

class Chart {
  constructor(figure, pointed) {
    this.svg = figure.querySelector("svg");
    this.readout = figure.querySelector(".readout");
    const box = ["left", "right", "top", "bottom", "t0", "t1", "y0", "y1", "decimals"];
    for (const name of box) this[name] = Number(figure.dataset[name]);
    this.unit = figure.dataset.unit ?? "";
    this.curves = new Map();
    for (const line of this.svg.querySelectorAll("polyline[data-name]")) {
      const points = line.getAttribute("points").trim().split(" ").map((one) => one.split(",").map(Number));
      const name = line.dataset.name;
      if (!this.curves.has(name)) this.curves.set(name, { colour: line.getAttribute("stroke"), lines: [] });
      this.curves.get(name).lines.push(points);
    }
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
    for (const [name, { lines }] of this.curves) {
      const height = inside ? heightAt(lines, x) : null;
      if (height === null) continue;
      const value = this.y0 + ((this.bottom - height) / (this.bottom - this.top)) * (this.y1 - this.y0);
      parts.push(`${name} ${value.toFixed(this.decimals).replace(/^-(0\.?0*)$/, "$1")}${this.unit}`);
    }
    this.readout.textContent = parts.join("  ·  ");
  }
}

export function charts(pointed) {
  return [...document.querySelectorAll("figure.chart")].map((figure) => new Chart(figure, pointed));
}
