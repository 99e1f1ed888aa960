// The report as the page holds it: runs, their differences, and records of oscilloscopes, with the values of signals.

import { unpacked } from './columns.js';

// A series of bus cycles with the signals of a run, or of a difference of two; or the samples of a record.
class Series {
  constructor(document, number) {
    Object.assign(this, document);
    this.number = number;
    this.columns = {};
    this.lastTime = this.first_s + (this.cycles - 1) * this.period_s;
  }

  async unpack() {
    const names = Object.keys(this.signals);
    const found = await Promise.all(names.map((name) => unpacked(this.signals[name], this.cycles)));
    names.forEach((name, i) => {
      this.columns[name] = found[i];
      delete this.signals[name]; // the text is not needed any more
    });
  }

  has(name) {
    return name in this.columns;
  }

  // Whether it tells of a time: what runs hold stands on either side of them.
  covers(time) {
    return !this.held || (time >= this.first_s - 1e-9 && time < this.lastTime + this.period_s);
  }

  // Number of the cycle at a time, or the one before; the first or last one outside.
  cycleAt(time) {
    const cycle = Math.floor((time - this.first_s) / this.period_s + 1e-6);
    return Math.min(Math.max(cycle, 0), this.cycles - 1);
  }

  // Values of all columns of a signal at a time: of the cycle, or between two cycles.
  at(name, time, smooth = false) {
    const columns = this.columns[name];
    const cycle = this.cycleAt(time);
    if (!smooth || cycle + 1 >= this.cycles) return columns.map((column) => column[cycle]);
    const share = Math.min(Math.max((time - this.first_s) / this.period_s - cycle, 0), 1);
    return columns.map((column) => column[cycle] + share * (column[cycle + 1] - column[cycle]));
  }
}

export class Report {
  constructor(document) {
    Object.assign(this, document);
    this.runs = document.runs.map((run, number) => new Series(run, number));
    this.differences = document.differences.map((difference, n) => new Series(difference, n + 1));
    this.records = (document.records ?? []).map((record) => Object.assign(new Series(record, 0), { held: true }));
    const all = this.runs;
    this.first = Math.min(...all.map((run) => run.first_s));
    this.last = Math.max(...all.map((run) => run.lastTime));
    this.period = Math.min(...all.map((run) => run.period_s));
  }

  async unpack() {
    await Promise.all([...this.runs, ...this.differences, ...this.records].map((series) => series.unpack()));
    if (this.cell) await this.unpackCell();
  }

  // The columns of the cell, which is that of the first run.
  async unpackCell() {
    const { ways, stays, places, rows } = this.cell;
    const [of, from, at] = await Promise.all([
      ways ? unpacked(ways, this.runs[0].cycles) : [], unpacked(stays, rows), unpacked(places, rows),
    ]);
    this.cell.table = { ways: of, stays: from, places: at };
    for (const name of ['ways', 'stays', 'places']) delete this.cell[name]; // the text is not needed any more
  }
}

// Read the report from the element of the page that holds it.
export async function readReport() {
  const report = new Report(JSON.parse(document.getElementById('report').textContent));
  await report.unpack();
  return report;
}
