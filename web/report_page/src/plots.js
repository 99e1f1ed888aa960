// Plots of signals over the common time: one uPlot each, all with the same window, cursor and instant.

import uPlot from 'uplot';

import { AXIS_COLOURS, axisColours, colour, onTheme } from './theme.js';

const HEIGHT = 150;
const GUTTER = 58; // width of the scale at the left; the track of moves keeps the same
const DASHES = { run: [[], [7, 4], [2, 3], [8, 3, 2, 3]], command: [4, 3], true: [1, 3] };
const STEPS = uPlot.paths.stepped({ align: 1 }); // a sample stands until the next one
const DRAGGED = 4; // pixels between a click and a drag

export class Plots {
  constructor(report, clock) {
    this.report = report;
    this.clock = clock;
    this.panels = [];
    this.list = document.getElementById('panels');
    this.chips = document.getElementById('chips');
    for (const record of report.records) {
      for (const plot of record.plots) this.put(plot, [new Panel(this, plot, samplesOf(record, plot))]);
    }
    for (const plot of report.plots) this.add(plot);
    new ResizeObserver(() => this.resize()).observe(this.list);
    clock.addEventListener('window', () => this.panels.forEach((panel) => panel.showWindow()));
    clock.addEventListener('time', () => this.panels.forEach((panel) => panel.showTime()));
    onTheme(() => this.panels.forEach((panel) => panel.remake()));
  }

  // A plot, and below it that of the differences, with one button that shows or hides them.
  add(plot) {
    const { report } = this;
    const made = [new Panel(this, plot, curvesOf(report, plot))];
    report.differences.forEach((difference) => {
      const curves = differencesOf(report, difference, plot);
      if (curves.length) made.push(new Panel(this, plot, curves, report.runs[difference.number].name));
    });
    this.put(plot, made);
  }

  // What belongs to a plot, with the button that shows or hides it.
  put(plot, made) {
    const group = document.createElement('div');
    group.className = 'group';
    made.forEach((panel) => group.append(panel.element));
    this.list.append(group);
    const chip = document.createElement('button');
    chip.className = 'chip';
    chip.type = 'button';
    chip.textContent = plot.title;
    chip.title = plot.what;
    chip.addEventListener('click', () => show(!this.isShown(made)));
    this.chips.append(chip);
    const show = (shown) => {
      group.hidden = !shown;
      chip.setAttribute('aria-pressed', shown);
      made.forEach((panel) => panel.setShown(shown));
    };
    this.panels.push(...made);
    show(plot.shown);
  }

  isShown(panels) {
    return panels[0].shown;
  }

  resize() {
    this.panels.forEach((panel) => panel.resize());
  }
}

// Curves of a plot for all runs: of one run with command and truth, of several what is alone.
function curvesOf(report, plot) {
  const several = report.runs.length > 1;
  const curves = [];
  for (const run of report.runs) {
    plot.signals.forEach((signal, n) => {
      if (!run.has(signal.name) || (several && n > 0)) return;
      const factor = signal.arm ? plot.factor / run.gear_ratio : plot.factor;
      run.columns[signal.name].forEach((values, column) => {
        // what stands first is what the plot is about, whatever its role
        curves.push({ series: run, name: signal.name, column, values, factor, role: n ? signal.role : 'actual' });
      });
    });
  }
  return curves;
}

function differencesOf(report, difference, plot) {
  const [signal] = plot.signals;
  if (!difference.has(signal.name)) return [];
  const factor = signal.arm ? plot.factor / report.runs[0].gear_ratio : plot.factor;
  return difference.columns[signal.name].map((values, column) => ({
    series: difference, name: signal.name, column, values, factor, role: 'actual', difference: true,
  }));
}

// Curves of a plot of a record, whose one signal holds the channels of one unit.
function samplesOf(record, plot) {
  const [{ name }] = plot.signals;
  return record.columns[name].map((values, column) => ({
    series: record, name, column, values, factor: plot.factor, role: 'actual',
  }));
}

// Which of the dashes tells a curve from those of its colour: by the run, or by the channel of a record.
function dashOf({ series, column, difference }) {
  if (series.held) return Math.floor(column / AXIS_COLOURS);
  return difference ? 0 : series.number;
}

class Panel {
  constructor(plots, plot, curves, subtracted = '') {
    Object.assign(this, { plots, plot, curves, subtracted, shown: false, chart: null, hovered: null });
    this.hidden = new Set();
    this.digits = digitsFor(Math.max(...curves.map(largest)));
    this.element = document.createElement('figure');
    this.element.className = subtracted ? 'panel difference' : 'panel';
    this.caption = this.element.appendChild(document.createElement('figcaption'));
    this.body = this.element.appendChild(document.createElement('div'));
    this.body.className = 'plot';
    const title = this.caption.appendChild(document.createElement('b'));
    title.title = plot.what;
    title.textContent = subtracted ? `${plot.title}: ${subtracted} − ${plots.report.runs[0].name}` : plot.title;
    const unit = this.caption.appendChild(document.createElement('span'));
    unit.className = 'unit';
    unit.textContent = plot.unit;
    this.legend = this.caption.appendChild(document.createElement('span'));
    this.legend.className = 'legend';
    this.makeLegend();
  }

  // An entry for each curve that tells its value; a click hides the curve.
  makeLegend() {
    const several = this.plots.report.runs.length > 1 && !this.subtracted;
    this.entries = this.curves.map((curve, n) => {
      if (curve.role !== 'actual') return null;
      const entry = this.legend.appendChild(document.createElement('button'));
      entry.type = 'button';
      entry.className = 'entry';
      entry.style.setProperty('--curve', `var(--${this.colourName(curve)})`);
      entry.dataset.dash = dashOf(curve);
      const label = entry.appendChild(document.createElement('span'));
      label.textContent = this.plot.columns[curve.column] ?? '';
      if (several && curve.column === 0) label.dataset.run = curve.series.name;
      const value = entry.appendChild(document.createElement('output'));
      entry.addEventListener('click', () => this.toggle(n));
      return { entry, value };
    });
    const roles = [...new Set(this.curves.map((curve) => curve.role))].filter((role) => role !== 'actual');
    for (const role of roles) {
      const entry = this.legend.appendChild(document.createElement('button'));
      entry.type = 'button';
      entry.className = `entry role ${role}`;
      entry.textContent = role;
      entry.addEventListener('click', () => this.toggleRole(role, entry));
    }
  }

  colourName(curve) {
    return this.plot.columns.length === 1 ? 'norm' : `axis${(curve.column % AXIS_COLOURS) + 1}`;
  }

  toggle(n) {
    const { column, series, difference } = this.curves[n];
    const same = this.curves.flatMap((curve, i) =>
      curve.column === column && curve.series === series && curve.difference === difference ? [i] : []);
    const hide = !this.hidden.has(n);
    for (const i of same) this.setHidden(i, hide);
    this.entries[n].entry.classList.toggle('off', hide);
  }

  toggleRole(role, entry) {
    const off = entry.classList.toggle('off');
    this.curves.forEach((curve, i) => {
      if (curve.role === role) this.setHidden(i, off);
    });
  }

  setHidden(i, hide) {
    if (hide) this.hidden.add(i);
    else this.hidden.delete(i);
    this.chart?.setSeries(i + 1, { show: !hide });
  }

  setShown(shown) {
    this.shown = shown;
    if (shown && !this.chart) this.make();
  }

  remake() {
    this.chart?.destroy();
    this.chart = null;
    if (this.shown) this.make();
  }

  resize() {
    if (!this.chart || !this.body.clientWidth) return;
    this.chart.setSize({ width: this.body.clientWidth, height: this.height() });
    this.showTime();
  }

  height() {
    return this.subtracted ? Math.round(0.72 * HEIGHT) : HEIGHT;
  }

  make() {
    const { clock } = this.plots;
    const axes = axisColours();
    const norm = colour('norm');
    const line = { stroke: colour('muted'), grid: { stroke: colour('line'), width: 1 }, ticks: { show: false } };
    const font = '11px system-ui, sans-serif';
    this.chart = new uPlot(
      {
        width: this.body.clientWidth || 400,
        height: this.height(),
        padding: [6, 10, 0, 0],
        legend: { show: false },
        scales: {
          x: { time: false, range: () => clock.window },
          y: { range: (chart, low, high) => spanOf(low, high) },
        },
        axes: [
          { ...line, font, size: 22, gap: 3, space: 70, values: (chart, ticks) => labels(ticks) },
          { ...line, font, size: GUTTER, gap: 5, space: 28, values: (chart, ticks) => labels(ticks) },
        ],
        cursor: {
          sync: { key: 'time', setSeries: false },
          drag: { x: true, y: false, setScale: false, dist: DRAGGED },
          points: { size: 5 },
          y: false,
        },
        series: [
          {},
          ...this.curves.map((curve, n) => ({
            show: !this.hidden.has(n),
            stroke: this.plot.columns.length === 1 ? norm : axes[curve.column % AXIS_COLOURS],
            width: curve.role === 'actual' ? 1.4 : 1,
            alpha: curve.role === 'actual' ? 1 : 0.75,
            dash: curve.role === 'actual' ? DASHES.run[dashOf(curve)] : DASHES[curve.role],
            points: { show: false },
            ...(curve.series.held && { paths: STEPS }),
          })),
        ],
        hooks: {
          drawClear: [(chart) => this.drawMarks(chart)],
          setSelect: [(chart) => this.select(chart)],
          setCursor: [(chart) => this.hover(chart)],
        },
      },
      dataOf(this.curves),
      this.body,
    );
    this.now = this.chart.over.appendChild(document.createElement('i'));
    this.now.className = 'now';
    watch(this.chart, clock);
    this.showTime();
  }

  showWindow() {
    if (!this.chart) return;
    const [min, max] = this.plots.clock.window;
    this.chart.setScale('x', { min, max });
    this.showTime();
  }

  showTime() {
    if (!this.chart || !this.shown) return;
    const { time, window } = this.plots.clock;
    const share = (time - window[0]) / (window[1] - window[0]);
    this.now.style.left = `${100 * share}%`;
    if (this.hovered === null) this.showValues(time);
  }

  showValues(time) {
    this.curves.forEach((curve, n) => {
      if (!this.entries[n]) return;
      const value = curve.series.covers(time) ? curve.factor * curve.values[curve.series.cycleAt(time)] : NaN;
      this.entries[n].value.textContent = Number.isFinite(value) ? unsigned(value.toFixed(this.digits)) : '–';
    });
  }

  hover(chart) {
    const { left } = chart.cursor;
    this.hovered = left < 0 || left === null || left === undefined ? null : chart.posToVal(left, 'x');
    this.showValues(this.hovered ?? this.plots.clock.time);
  }

  select(chart) {
    const { left, width } = chart.select;
    if (width <= DRAGGED) return;
    this.plots.clock.show(chart.posToVal(left, 'x'), chart.posToVal(left + width, 'x'));
    chart.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  }

  // Every other move is shaded, faults and starts are lines.
  drawMarks(chart) {
    const { ctx, bbox } = chart;
    const at = (time) => chart.valToPos(time, 'x', true);
    const [run] = this.plots.report.runs;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.fillStyle = colour('shade');
    run.moves.forEach(([, , from, to], n) => {
      if (n % 2 === 0) ctx.fillRect(at(from), bbox.top, at(to) - at(from), bbox.height);
    });
    for (const [time, kind] of run.marks) {
      if (kind !== 'fault' && kind !== 'event') continue;
      ctx.fillStyle = colour(kind);
      ctx.fillRect(Math.round(at(time)), bbox.top, devicePixelRatio, bbox.height);
    }
    ctx.restore();
  }
}

// The times of all curves in one array, and their values there; runs with other times are drawn between two cycles.
function dataOf(curves) {
  const series = [...new Set(curves.map((curve) => curve.series))];
  const period = Math.min(...series.map((one) => one.period_s));
  const first = Math.min(...series.map((one) => one.first_s));
  const last = Math.max(...series.map((one) => one.lastTime));
  const rows = Math.round((last - first) / period) + 1;
  const times = Float64Array.from({ length: rows }, (_, i) => first + i * period);
  const values = curves.map(({ series: one, values: own, factor }) => {
    const offset = (one.first_s - first) / period;
    const step = one.period_s / period;
    return Array.from({ length: rows }, (_, i) => {
      const place = (i - offset) / step;
      const cycle = Math.floor(place + 1e-6);
      if (cycle < 0 || cycle >= one.cycles) return null;
      const share = place - cycle;
      const value = share > 1e-6 && cycle + 1 < one.cycles
        ? own[cycle] + share * (own[cycle + 1] - own[cycle])
        : own[cycle];
      return Number.isNaN(value) ? null : factor * value;
    });
  });
  return [times, ...values];
}

function largest({ values, factor }) {
  let found = 0;
  for (const value of values) if (Math.abs(value) > found) found = Math.abs(value);
  return found * Math.abs(factor);
}

// The range of a scale: a little more than the values; one that does not move still has a range.
function spanOf(low, high) {
  if (low === null || !Number.isFinite(low)) return [-1, 1];
  const room = 0.06 * (high - low) || Math.max(1e-6, 0.1 * Math.abs(high));
  return [low - room, high + room];
}

// Ticks with as many digits as they need.
function labels(ticks) {
  let digits = 0;
  while (digits < 9 && ticks.some((tick) => Math.abs(tick - Number(tick.toFixed(digits))) > 1e-6 * Math.abs(tick))) digits += 1;
  return ticks.map((tick) => unsigned(tick.toFixed(digits)));
}

// Digits behind the point that show a value up to a size with four digits that mean something.
function digitsFor(size) {
  return size > 0 ? Math.min(Math.max(3 - Math.floor(Math.log10(size)), 0), 6) : 3;
}

// What is rounded to zero has no sign.
function unsigned(text) {
  return text.replace(/^-(0(\.0*)?)$/, '$1');
}

// A click goes to an instant; the wheel with a key, and two fingers, zoom; one finger moves the instant.
function watch(chart, clock) {
  const { over } = chart;
  const timeAt = (x) => chart.posToVal(x - over.getBoundingClientRect().left, 'x');
  let pressed = null;
  over.addEventListener('mousedown', (event) => { pressed = event.clientX; });
  over.addEventListener('mouseup', (event) => {
    if (pressed !== null && Math.abs(event.clientX - pressed) < DRAGGED) clock.seek(timeAt(event.clientX));
    pressed = null;
  });
  over.addEventListener('dblclick', () => clock.showAll());
  over.addEventListener('wheel', (event) => {
    if (!event.ctrlKey && !event.shiftKey && !event.metaKey) return;
    event.preventDefault();
    clock.zoom(2 ** (-(event.deltaY || event.deltaX) / 240), timeAt(event.clientX));
  }, { passive: false });

  const fingers = new Map();
  let spread = 0;
  over.addEventListener('pointerdown', (event) => {
    if (event.pointerType === 'touch') fingers.set(event.pointerId, event.clientX);
    spread = 0;
  });
  over.addEventListener('pointermove', (event) => {
    if (!fingers.has(event.pointerId)) return;
    fingers.set(event.pointerId, event.clientX);
    const places = [...fingers.values()];
    if (places.length === 1) clock.seek(timeAt(places[0]));
    if (places.length === 2) {
      const now = Math.max(Math.abs(places[0] - places[1]), 10);
      if (spread) clock.zoom(now / spread, timeAt((places[0] + places[1]) / 2));
      spread = now;
    }
  });
  for (const end of ['pointerup', 'pointercancel']) {
    over.addEventListener(end, (event) => fingers.delete(event.pointerId));
  }
}
