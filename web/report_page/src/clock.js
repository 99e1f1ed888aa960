// The one time of the page: the instant that is shown, the window that plots show, and whether it plays.

export const SPEEDS = [0.01, 0.02, 0.05, 0.1, 0.25, 0.5, 1, 2, 4];
const WINDOW_MIN = 5; // cycles

export class Clock extends EventTarget {
  constructor(report) {
    super();
    Object.assign(this, { first: report.first, last: report.last, period: report.period });
    this.time = Math.min(Math.max(0, this.first), this.last);
    this.window = [this.first, this.last];
    this.speed = 1;
    this.playing = false;
    this.frame = null;
  }

  seek(time) {
    this.time = Math.min(Math.max(time, this.first), this.last);
    // the window follows an instant that leaves it
    const [from, to] = this.window;
    if (this.time < from || this.time > to) {
      const begin = this.playing ? this.time : this.time - (to - from) / 2;
      this.show(begin, begin + to - from);
    }
    this.dispatchEvent(new Event('time'));
  }

  // Show a window of time, kept within the runs.
  show(from, to) {
    const whole = this.last - this.first;
    const length = Math.min(Math.max(to - from, WINDOW_MIN * this.period), whole);
    const middle = (from + to) / 2;
    const begin = Math.min(Math.max(middle - length / 2, this.first), this.last - length);
    this.window = [begin, begin + length];
    this.dispatchEvent(new Event('window'));
  }

  showAll() {
    this.window = [this.first, this.last];
    this.dispatchEvent(new Event('window'));
  }

  // Magnify by a factor; the instant ``around`` keeps its place.
  zoom(factor, around = this.time) {
    const [from, to] = this.window;
    const kept = Math.min(Math.max(around, from), to);
    this.show(kept - (kept - from) / factor, kept + (to - kept) / factor);
  }

  setSpeed(speed) {
    this.speed = speed;
    this.dispatchEvent(new Event('playing'));
  }

  play() {
    if (this.playing) return;
    if (this.time >= this.last - this.period / 2) this.seek(this.first);
    this.playing = true;
    let before = null;
    const step = (now) => {
      if (!this.playing) return;
      const elapsed = before === null ? 0 : (now - before) / 1000;
      before = now;
      this.seek(this.time + elapsed * this.speed);
      if (this.time >= this.last) this.pause();
      else this.frame = requestAnimationFrame(step);
    };
    this.frame = requestAnimationFrame(step);
    this.dispatchEvent(new Event('playing'));
  }

  pause() {
    this.playing = false;
    cancelAnimationFrame(this.frame);
    this.dispatchEvent(new Event('playing'));
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }
}
