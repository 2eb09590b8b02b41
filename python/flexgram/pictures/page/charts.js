/* Responses between chosen ports, and the error over the band, on one frequency axis. */
"use strict";

(function () {
  const place = document.getElementById("charts");
  if (!place) return;
  const data = JSON.parse(document.getElementById("chart-data").textContent);
  function floats(text) {
    const raw = atob(text), all = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; ++i) all[i] = raw.charCodeAt(i);
    return new Float32Array(all.buffer);
  }
  function number(x) {
    return x === 0 ? "0" : Math.abs(x) >= 1e-3 && Math.abs(x) < 1e6
      ? Number(x.toPrecision(4)).toString() : x.toExponential(2);
  }
  function tick(x) { /* 3e-6, not 3.00e-6; 0.2 beside 0.03 as it is */
    const size = Math.abs(x);
    if (size === 0 || (size >= 0.01 && size < 1e5)) return number(x);
    return x.toExponential(1).replace(".0e", "e").replace("e+", "e");
  }
  function decades(low, high, pixels, options, graph, values) { /* powers of ten, if there are some */
    const from = Math.log10(low), to = Math.log10(high);
    if (!(to - from >= 1.5)) return Dygraph.numericTicks(low, high, pixels, options, graph, values);
    const step = Math.max(1, Math.ceil((to - from) * 24 / pixels)), found = [];
    for (let k = Math.ceil(from / step) * step; k <= to; k += step)
      found.push({ v: Math.pow(10, k), label: tick(Math.pow(10, k)) });
    return found;
  }
  const curves = {}; // "output|input" -> what is drawn of them
  data.pairs.forEach(function (pair, k) { curves[pair.output + "|" + pair.input] = k; });
  const hz = data.hz, reduced = floats(data.reduced), full = data.full && floats(data.full);
  const least = data.least && floats(data.least), most = data.most && floats(data.most);
  const output = place.querySelector(".output"), input = place.querySelector(".input");
  const logarithmic = place.querySelector(".logarithmic");

  function rows(pair) {
    const n = hz.length, m = data.full_hz.length, of = new Map();
    for (let i = 0; i < n; ++i) {
      const row = [hz[i], null, reduced[pair * n + i]];
      if (least) row.push(least[pair * n + i], most[pair * n + i]);
      of.set(hz[i], row);
    }
    for (let i = 0; full && i < m; ++i) {
      const row = of.get(data.full_hz[i]) || [data.full_hz[i], null, null];
      if (least && row.length < 5) row.push(null, null);
      row[1] = full[pair * m + i];
      of.set(data.full_hz[i], row);
    }
    const table = Array.from(of.values());
    return table.sort(function (a, b) { return a[0] - b[0]; });
  }
  function bands(canvas, area, graph) { /* nothing is claimed outside of these */
    canvas.fillStyle = "rgba(28, 39, 51, 0.07)";
    let from = graph.xAxisRange()[0];
    data.bands.concat([[graph.xAxisRange()[1], 0]]).forEach(function (band) {
      const a = graph.toDomXCoord(from), b = graph.toDomXCoord(band[0]);
      if (b > a) canvas.fillRect(a, area.y, b - a, area.h);
      from = Math.max(from, band[1]);
    });
    canvas.fillStyle = "rgba(192, 57, 43, 0.35)";
    data.excluded.forEach(function (band) {
      const a = graph.toDomXCoord(band[0]), b = graph.toDomXCoord(band[1]);
      canvas.fillRect(a, area.y, Math.max(b - a, 2), area.h);
    });
  }
  function axes() {
    return {
      x: { logscale: logarithmic.checked, axisLabelFormatter: number,
           valueFormatter: function (x) { return number(x) + " Hz"; } },
      y: { axisLabelFormatter: tick, valueFormatter: number, axisLabelWidth: 90, ticker: decades }
    };
  }
  const common = {
    logscale: true, legend: "always", labelsSeparateLines: false, connectSeparatedPoints: true,
    underlayCallback: bands, animatedZooms: false, strokeWidth: 1.6, highlightCircleSize: 3,
    dateWindow: wanted()
  };
  function wanted() { /* a logarithmic axis has no zero */
    const first = hz.find(function (x) { return x > 0; });
    return [logarithmic.checked ? Math.max(data.from, first) : data.from, data.to];
  }
  let response = null;
  function redraw() {
    const pair = curves[output.value + "|" + input.value];
    const labels = ["frequency", "full body", "reduced"];
    if (least) labels.push("smallest over the parameters", "largest over the parameters");
    const words = place.querySelector(".unshown");
    words.hidden = pair !== undefined;
    place.querySelector(".response").hidden = pair === undefined;
    place.querySelector(".of-response").hidden = pair === undefined;
    words.textContent = "This pair is not in the page: flexgram report --port " + output.value +
      "," + input.value;
    if (pair === undefined) return;
    const series = {
      "full body": { color: "#444444", strokeWidth: 0, drawPoints: true,
                     pointSize: data.full_hz.length > 150 ? 1.5 : 3 },
      reduced: { color: "#0868ac" },
      "smallest over the parameters": { color: "#e08214", strokePattern: [2, 3] },
      "largest over the parameters": { color: "#e08214", strokePattern: [2, 3] }
    };
    const own = { file: rows(pair), labels: labels, series: series,
                  visibility: [Boolean(full), true].concat(least ? [true, true] : []),
                  title: output.value + " from " + input.value, titleHeight: 20,
                  ylabel: "|H| [" + data.pairs[pair].unit + "]", axes: axes(),
                  drawPoints: hz.length === 1 };
    if (response) {
      response.updateOptions(own);
      return;
    }
    const options = Object.assign({ labelsDiv: place.querySelector(".of-response") }, common, own);
    delete options.file;
    response = new Dygraph(place.querySelector(".response"), own.file, options);
  }
  output.addEventListener("change", redraw);
  input.addEventListener("change", redraw);
  redraw();
  const graphs = [response];
  const error = place.querySelector(".error");
  if (error && data.error.rows.length) {
    const table = data.error.rows.map(function (row) { /* nothing is known between bands */
      return row.map(function (x) { return x === "gap" ? NaN : x; });
    });
    graphs.push(new Dygraph(error, table, Object.assign({}, common, {
      labels: data.error.labels, axes: axes(), ylabel: "relative error", xlabel: "frequency [Hz]",
      series: data.error.series, labelsDiv: place.querySelector(".of-error")
    })));
    Dygraph.synchronize(graphs[0], graphs[1], { zoom: true, selection: true, range: false });
  }
  logarithmic.addEventListener("change", function () {
    graphs.forEach(function (graph) {
      graph.updateOptions({ axes: axes(), dateWindow: wanted(), valueRange: null });
    });
  });
  function whole() {
    graphs.forEach(function (graph) {
      graph.updateOptions({ dateWindow: wanted(), valueRange: null });
    });
  }
  place.querySelector(".whole").addEventListener("click", whole);
  place.addEventListener("dblclick", function () { window.setTimeout(whole, 0); });
  place.dataset.ready = "yes";
})();
