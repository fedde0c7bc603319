// Plots over time: zoomed together, cursors linked, in the colours of the page. Data are in two bytes a value.
(() => {
  "use strict";
  const color = name => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
  const plots = [];
  let range = null, whole = null, busy = false, before = true;

  function unpacked({low, step, data}) {
    const bytes = Uint8Array.from(atob(data), c => c.charCodeAt(0));
    const whole = new Int16Array(bytes.buffer);
    return Array.from(whole, v => v === -32768 ? null : low + (v + 32767) * step);
  }

  // stretches of time, over the whole height or as a strip at the bottom, which stays visible in grey
  function shade(u, spans, strip) {
    for (const span of spans) {
      u.ctx.save();
      u.ctx.fillStyle = color(span.color);
      for (const [first, last] of span.pairs) {
        const a = Math.max(u.valToPos(first, "x", true), u.bbox.left);
        const b = Math.min(u.valToPos(last, "x", true), u.bbox.left + u.bbox.width);
        if (b < a) continue;
        u.ctx.globalAlpha = strip ? 1 : .18;
        const high = strip ? 4 * devicePixelRatio : u.bbox.height;
        u.ctx.fillRect(a, u.bbox.top + u.bbox.height - high, Math.max(b - a, 2 * devicePixelRatio), high);
      }
      u.ctx.restore();
    }
  }

  function rule(u, rules) {
    for (const {y, color: name, dash} of rules) {
      const at = u.valToPos(y, "y", true);
      if (at < u.bbox.top || at > u.bbox.top + u.bbox.height) continue;
      u.ctx.save();
      u.ctx.strokeStyle = color(name);
      u.ctx.setLineDash(dash.split(" ").filter(Boolean).map(Number));
      u.ctx.beginPath();
      u.ctx.moveTo(u.bbox.left, at);
      u.ctx.lineTo(u.bbox.left + u.bbox.width, at);
      u.ctx.stroke();
      u.ctx.restore();
    }
  }

  function zoom(min, max) {
    if (busy || !whole) return;
    busy = true;
    range = [Math.max(min, whole[0]), Math.min(max, whole[1])];
    for (const u of plots) u.setScale("x", {min: range[0], max: range[1]});
    busy = false;
    document.documentElement.dataset.range = range.map(v => v.toFixed(3)).join(" ");
  }

  function draw(place) {
    if (place.dataset.drawn) return;
    place.dataset.drawn = "1";
    const told = JSON.parse(place.querySelector("script").textContent);
    const t = unpacked(told.t);
    whole = whole || [t[0], t[t.length - 1]];
    const axis = label => ({
      label, labelSize: label ? 20 : 0, labelFont: "12px system-ui", font: "11px system-ui", gap: 3,
      stroke: () => color("ink"), grid: {stroke: () => color("line"), width: 1}, ticks: {stroke: () => color("line")},
    });
    for (const panel of told.panels) {
      const marks = [...panel.spans, ...panel.rules].filter(m => m.label);
      const named = [...new Map(marks.map(m => [m.label, m])).values()];
      const u = new uPlot({
        width: place.clientWidth, height: panel.height, title: panel.title,
        scales: {x: {time: false}, y: panel.limits ? {range: panel.limits} : {}},
        legend: {markers: {fill: (u, k) => u.series[k].stroke(u, k)}},
        cursor: {sync: {key: "elid"}, drag: {x: true, y: false}},
        axes: [{...axis(panel.xlabel), size: 28}, {...axis(panel.ylabel), size: 52, space: 20}],
        series: [
          {label: "cursor at (s)", value: (u, v) => v == null ? "" : v.toFixed(3)},
          ...panel.series.map(s => ({
            label: s.label, stroke: () => color(s.color), width: s.width, points: {show: false},
            dash: s.dash ? s.dash.split(" ").map(Number) : undefined, show: before || !/before/.test(s.label),
            value: (u, v) => v == null ? "" : v.toPrecision(3),
          })),
        ],
        hooks: {
          drawClear: [u => shade(u, panel.spans)],
          draw: [u => shade(u, panel.spans.filter(span => span.strip), true), u => rule(u, panel.rules)],
          setCursor: [u => u.root.classList.toggle("pointed", u.cursor.idx != null)],
          setScale: [(u, key) => { if (key === "x" && u.scales.x.min != null) zoom(u.scales.x.min, u.scales.x.max); }],
        },
      }, [t, ...panel.series.map(s => unpacked(s.y))], place);
      // the cursor's time is no curve: it has no swatch
      u.root.querySelector(".u-legend .u-series .u-marker").remove();
      for (const mark of named) {
        const row = document.createElement("tr");
        row.className = "u-series mark";
        row.innerHTML = '<th><div class="u-marker"></div><div class="u-label"></div></th>';
        row.querySelector(".u-marker").style.cssText = `background: var(--${mark.color}); opacity: .5`;
        row.querySelector(".u-label").textContent = mark.label;
        u.root.querySelector(".u-legend").append(row);
      }
      u.over.setAttribute("role", "img");
      u.over.setAttribute("aria-label", [place.getAttribute("aria-label"), panel.title, panel.ylabel].join(", "));
      plots.push(u);
      if (range) u.setScale("x", {min: range[0], max: range[1]});
    }
  }

  const doing = {
    in: ([a, b]) => [a + (b - a) / 4, b - (b - a) / 4],
    out: ([a, b]) => [a - (b - a) / 2, b + (b - a) / 2],
    back: ([a, b]) => [Math.max(a - (b - a) / 2, whole[0]), Math.max(a - (b - a) / 2, whole[0]) + b - a],
    on: ([a, b]) => [Math.min(b + (b - a) / 2, whole[1]) - b + a, Math.min(b + (b - a) / 2, whole[1])],
    all: () => whole,
  };

  function press(event) {
    const what = event.target.dataset.do;
    if (what === "before") {
      before = !before;
      event.target.textContent = before ? "hide before" : "show before";
      for (const u of plots) u.series.forEach((s, k) => { if (/before/.test(s.label)) u.setSeries(k, {show: before}); });
    } else if (what && whole) zoom(...doing[what](range || whole));
  }

  const every = document.querySelectorAll(".plot");
  const seen = place => { if (!place.closest("details:not([open])")) draw(place); };
  every.forEach(seen);
  document.addEventListener("toggle", event => event.target.querySelectorAll(".plot").forEach(seen), true);
  document.querySelectorAll(".tools button").forEach(button => button.addEventListener("click", press));
  const old = document.querySelector('[data-do="before"]');
  if (old && ![...every].some(place => /"label":"[^"]*before/.test(place.textContent))) old.remove();
  const repaint = () => plots.forEach(u => u.redraw(false));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
  matchMedia("print").addEventListener("change", repaint);
  // paper: plots as wide as a sheet, and tables of parameters unfolded
  const paper = 680, closed = [];
  addEventListener("beforeprint", () => {
    document.querySelectorAll("section:not(.rest) details:not([open])").forEach(d => {
      if (d.querySelector("table") && !d.querySelector(".plot")) { d.open = true; closed.push(d); }
    });
    for (const u of plots) u.setSize({width: paper, height: u.height});
  });
  addEventListener("afterprint", () => {
    for (const d of closed.splice(0)) d.open = false;
    fit();
  });
  let waiting = 0;
  const fit = () => plots.forEach(u => {
    const width = u.root.parentElement.clientWidth;
    if (width && width !== u.width) u.setSize({width, height: u.height});
  });
  addEventListener("resize", () => {
    cancelAnimationFrame(waiting);
    waiting = requestAnimationFrame(fit);
  });
})();
