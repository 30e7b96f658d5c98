// A report with moving charts: plots by dygraphs with a common cursor, play and dark mode.
// The data is in #data, as tools/report/report.cpp wrote it. robot.js draws the robot.
'use strict';
var report = (() => {
  const data = JSON.parse(document.getElementById('data').textContent);
  const root = document.documentElement;
  const bar = document.getElementById('bar');
  const part = name => bar.querySelector('.' + name);
  const several = data.runs.length > 1;
  const state = {t: 0, playing: false, window: [0, data.end_s], begin: 0, version: 0};

  const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  for (const curve of data.charts.flatMap(chart => chart.curves)) {
    const pairs = new Float32Array(bytes(curve.points).buffer);  // x, y, x, y, …
    curve.x = data.live ? [] : pairs.filter((_, i) => i % 2 === 0);
    curve.y = data.live ? [] : pairs.filter((_, i) => i % 2 === 1);
    curve.shown = true;
  }

  /// Returns the curve's value at time t: linear between its points, constant beyond its ends.
  function value(curve, t) {
    const {x, y} = curve;
    let low = 0, high = x.length - 1;
    if (t <= x[0]) return y[0];
    if (t >= x[high]) return y[high];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (x[middle] <= t) low = middle; else high = middle;
    }
    return x[high] === x[low] ? y[high] : y[low] + (y[high] - y[low]) * (t - x[low]) / (x[high] - x[low]);
  }

  /// Returns one row for each instant of any curve, as dygraphs needs them; null for a curve
  /// without a point there.
  function rows({curves, logarithmic}) {
    const next = curves.map(() => 0), all = [];
    for (;;) {
      let x = Infinity;
      curves.forEach((curve, i) => { if (curve.x[next[i]] < x) x = curve.x[next[i]]; });
      if (x === Infinity) return all;
      all.push([x, ...curves.map((curve, i) => {
        if (curve.x[next[i]] !== x) return null;
        const y = curve.y[next[i]++];
        return logarithmic && !(y > 0) ? null : y;
      })]);
    }
  }

  function short(number, digits = 6) {
    const rounded = Number(number.toPrecision(digits));
    return rounded && Math.abs(rounded) < 1e-3 ? rounded.toExponential() : String(rounded);
  }
  const dark = () => root.dataset.theme === 'dark';
  // Black and the darkest blue of the palette are invisible on a dark page.
  const ink = colour => dark() && {'#000000': '#ffffff', '#0072B2': '#3d9fdc'}[colour] || colour;

  function colours(chart) {
    const series = {};
    chart.curves.forEach((curve, i) => {
      series[i] = {color: ink(curve.colour), strokeWidth: curve.width,
                   strokePattern: curve.dash.length ? curve.dash : null};
    });
    return {series, gridLineColor: dark() ? '#3a3a3a' : '#dddddd', axisLineColor: '#777777'};
  }

  /// Draws the levels and marks of a chart under its curves.
  function underlay(chart, context, area, plot) {
    context.save();
    context.setLineDash([2, 3]);
    context.strokeStyle = '#888888';
    for (const level of chart.levels) {
      const y = plot.toDomYCoord(level);
      if (y < area.y || y > area.y + area.h) continue;
      context.beginPath();
      context.moveTo(area.x, y);
      context.lineTo(area.x + area.w, y);
      context.stroke();
    }
    for (const [from, to, colour] of chart.marks) {
      const x = plot.toDomXCoord(from);
      context.fillStyle = colour;
      context.fillRect(x, area.y, Math.max(1, plot.toDomXCoord(to) - x), 5);
    }
    context.restore();
  }

  function keys(chart) {
    const line = document.createElement('div');
    line.className = 'keys';
    chart.curves.forEach((curve, i) => {
      const key = document.createElement('button');
      const shared = curve.signal === 'q_ref' && chart.curves.filter(each => each.signal === 'q_ref').length === 1;
      const suffix = several && !shared ? ' · ' + data.runs[curve.run].label : '';
      key.innerHTML = '<b></b> ' + curve.name + suffix + ' <output></output>';
      key.setAttribute('aria-pressed', 'true');
      key.onclick = () => {
        curve.shown = !curve.shown;
        key.setAttribute('aria-pressed', curve.shown);
        chart.plot.setVisibility(i, curve.shown);
      };
      line.append(key);
    });
    return line;
  }

  /// Returns the ticks of a logarithmic axis, at whole powers of ten if there are two of them.
  function decades(low, high, pixels, ...others) {
    const first = Math.ceil(Math.log10(low)), last = Math.floor(Math.log10(high));
    if (!(last > first)) return Dygraph.numericTicks(low, high, pixels, ...others);
    const step = Math.max(1, Math.ceil((last - first + 1) * 20 / pixels));
    const ticks = [];
    for (let k = first; k <= last; k += step) ticks.push({v: 10 ** k, label: '1e' + k});
    return ticks;
  }

  function build(chart) {
    const live = document.querySelector('#' + chart.name + ' .panel');
    const label = document.createElement('div');
    label.className = 'unit';
    label.innerHTML = chart.label + (chart.note ? ' · ' + chart.note : '');
    chart.keys = keys(chart);
    chart.place = document.createElement('div');
    chart.place.className = 'plot';
    chart.line = document.createElement('div');
    chart.line.className = 'cursor';
    live.append(label, chart.keys, chart.place);
    chart.version = state.version;
    chart.plot = new Dygraph(chart.place, rows(chart), {
      ...colours(chart),
      labels: ['t', ...chart.curves.keys()].map(String),
      connectSeparatedPoints: true,
      legend: 'never',
      highlightCircleSize: 0,
      logscale: chart.logarithmic,
      valueRange: data.live ? null : chart.range,
      dateWindow: state.window,
      animatedZooms: false,
      axes: {
        x: {axisLabelWidth: 60, axisLabelFormatter: x => short(x)},
        y: {
          axisLabelWidth: 64,
          axisLabelFormatter: y => short(y),
          drawAxis: chart.y_axis,
          ...(chart.logarithmic && {ticker: decades})
        }
      },
      underlayCallback: (context, area, plot) => underlay(chart, context, area, plot),
      drawCallback: (plot, initial) => {
        if (!initial) zoom(plot.xAxisRange(), chart);
      },
    });
    chart.place.append(chart.line);
    chart.place.addEventListener('mousemove', event => {
      if (!state.playing && !state.following && !event.buttons) seek(chart.plot.toDataXCoord(event.clientX - chart.place.getBoundingClientRect().left));
    });
    paint(chart);
  }

  function inView(chart) {
    const box = document.getElementById(chart.name).getBoundingClientRect();
    return box.bottom > 0 && box.top < innerHeight;
  }

  /// Updates a visible chart: the cursor, the common time interval and the theme.
  function paint(chart) {
    const {plot} = chart;
    if (chart.theme !== root.dataset.theme) {
      chart.theme = root.dataset.theme;
      plot.updateOptions(colours(chart), true);
      chart.curves.forEach((curve, i) => {
        const sample = chart.keys.children[i].firstChild;
        sample.style.borderTop = (curve.dash.length ? 'dashed ' : 'solid ') + Math.max(2, Math.min(4, curve.width)) + 'px ' + ink(curve.colour);
      });
      chart.window = null;
    }
    if (chart.window !== state.window || chart.version !== state.version) {
      const file = chart.version !== state.version && {file: rows(chart)};
      chart.version = state.version;
      chart.window = state.window;
      plot.updateOptions({dateWindow: state.window, ...file});
    }
    const x = plot.toDomXCoord(state.t), area = plot.getArea();
    chart.line.style.display = x >= area.x - 1 && x <= area.x + area.w + 1 ? '' : 'none';
    chart.line.style.transform = `translateX(${x}px)`;
    chart.curves.forEach((curve, i) => {
      // The first and the last point may be anywhere in their intervals of ticks.
      const stretch = data.live ? 0.2 : data.end_s / 500, last = curve.x[curve.x.length - 1];
      const there = chart.y_axis && state.t >= curve.x[0] - stretch && state.t <= last + stretch;
      chart.keys.children[i].lastChild.textContent = there ? short(value(curve, state.t), 4) : '';
    });
  }

  /// Applies one chart's time interval to all charts.
  function zoom(window, from) {
    if (window[0] === state.window[0] && window[1] === state.window[1]) return;
    from.window = state.window = window;
    if (data.live) part('play').textContent = (state.following = false) || '▶ follow';
    refresh();
  }

  function refresh(charts = data.charts.filter(inView)) {
    for (const chart of charts) chart.plot ? paint(chart) : build(chart);
    if (report_robot.drawn) report_robot.move(state.t);
    part('time').value = state.t;
    part('now').textContent = state.t.toFixed(3) + ' s';
  }

  function seek(t) {
    state.t = Math.max(state.begin, Math.min(data.end_s, t));
    refresh();
  }

  function play() {
    state.playing = !state.playing;
    part('play').textContent = state.playing ? '❚❚ pause' : '▶ play';
    if (!state.playing) return;
    if (state.t >= data.end_s) seek(0);
    let before = performance.now();
    requestAnimationFrame(function frame(now) {
      if (!state.playing) return;
      seek(state.t + Math.max(0, now - before) / 1000 * part('speed').value);
      before = now;
      if (state.t >= data.end_s) play(); else requestAnimationFrame(frame);
    });
  }

  function start_robot() {
    const curve_of = (run, signal, joint) => {
      const curves = data.charts.find(chart => chart.name === 'tracking-' + (joint + 1))?.curves.filter(c => c.signal === signal);
      // All runs share one curve for a common reference.
      return curves?.find(c => c.run === run) ?? (signal === 'q_ref' ? curves?.[0] : undefined);
    };
    report_robot.start(data.runs, (run, signal, joint) => {
      const curve = curve_of(run, signal, joint);
      return curve && (t => value(curve, t));
    }, data.live ? 0 : data.end_s);
  }

  /// Adds the points that a run in progress has made since the last interval. Keeps the newest
  /// minute.
  function take(stretch) {
    if (stretch.run !== data.live) return location.reload();
    // The server sent it again after a lost connection.
    if (stretch.number <= state.version) return;
    const most = 4800;  // two points 40 times a second
    for (const chart of data.charts) {
      const joint = chart.name.split('-').pop() - 1;
      for (const curve of chart.curves) {
        const points = stretch.curves[curve.signal]?.[joint] ?? [];
        for (let i = 0; i < points.length; i += 2) {
          curve.x.push(points[i]);
          curve.y.push(points[i + 1]);
        }
        if (curve.x.length > 1.1 * most) [curve.x, curve.y] = [curve.x.slice(-most), curve.y.slice(-most)];
      }
    }
    state.begin = Math.min(...data.charts.flatMap(chart => chart.curves).map(curve => curve.x[0] ?? Infinity));
    data.end_s = stretch.t;
    state.version = stretch.number;
    const saturated = stretch.saturated.map(joint => joint + 1).join(', ');
    part('status').textContent = `${stretch.rate} ticks/s, jitter ${stretch.jitter_us} µs, ${stretch.missed} commands missed` +
      (saturated && `, saturated: joint ${saturated}`);
    for (const event of stretch.events) {
      document.getElementById('happened').appendChild(document.createElement('li')).textContent = event;
    }
  }

  /// Draws a run in progress: the robot in each frame, and one visible chart after the other.
  function follow() {
    const source = new EventSource('events?robot=' + encodeURIComponent(data.robot));
    source.onmessage = event => take(JSON.parse(event.data));
    source.onerror = () => part('status').textContent = 'no connection to the server; type: tachless watch --web';
    part('play').textContent = '❚❚ pause';
    part('speed').parentElement.hidden = true;
    part('play').onclick = () => part('play').textContent = (state.following = !state.following) ? '❚❚ pause' : '▶ follow';
    part('time').addEventListener('input', () => part('play').textContent = (state.following = false) || '▶ follow');
    let turn = 0;
    state.following = true;
    requestAnimationFrame(function frame() {
      requestAnimationFrame(frame);
      if (!state.version) return;  // without points, dygraphs interprets times as dates
      const begin = performance.now();
      if (!state.started) {
        state.started = true;
        start_robot();
      }
      part('time').min = state.begin;
      part('time').max = data.end_s;
      if (state.following) {
        state.t = data.end_s;
        state.window = [state.begin, Math.max(data.end_s, state.begin + 1e-3)];
      }
      const charts = data.charts.filter(inView);
      refresh(charts.slice(turn %= charts.length || 1, ++turn));
      state.frame_ms = performance.now() - begin;
    });
  }

  function start() {
    root.dataset.theme = matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light';
    root.classList.add('moves');
    part('time').max = data.end_s;
    part('time').oninput = event => seek(Number(event.target.value));
    part('play').onclick = play;
    part('theme').onclick = () => { root.dataset.theme = dark() ? 'light' : 'dark'; refresh(); };
    part('view').onclick = () => root.classList.toggle('no-robot');
    if (data.live) return follow();
    for (const event of ['scroll', 'resize']) addEventListener(event, () => requestAnimationFrame(() => refresh()));
    start_robot();
    // The visible charts are built first, the others when the browser is idle.
    refresh();
    root.dataset.ready = performance.now().toFixed(0);
    (function rest() {
      const chart = data.charts.find(each => !each.plot);
      if (chart) setTimeout(() => { if (!chart.plot) build(chart); rest(); });
    })();
  }

  return {start, seek, play, take, state, data};
})();
