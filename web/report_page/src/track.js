// The track above the plots: moves as blocks, outputs, events and faults as marks, on the time of the plots.

const NARROW = 16; // pixels in which no number fits
const SIGNS = { start: '▸', output: '◆', event: '●', fault: '✖' };

export function track(report, clock) {
  const element = document.getElementById('track');
  const lanes = report.runs.map((run) => {
    const lane = element.appendChild(document.createElement('div'));
    lane.className = 'lane';
    if (report.runs.length > 1) lane.dataset.run = run.name;
    const items = [];
    const add = (item, from, to, text) => {
      item.title = text;
      item.addEventListener('click', () => clock.seek(from));
      lane.append(item);
      items.push({ item, from, to });
    };
    for (const [number, kind, from, to] of run.moves) {
      const item = document.createElement('button');
      item.type = 'button';
      item.className = `move ${kind}`;
      item.textContent = number;
      add(item, from, to, `move ${number}, ${kind}: ${from.toFixed(3)} to ${to.toFixed(3)} s`);
    }
    for (const [time, kind, text] of run.marks) {
      const item = document.createElement('button');
      item.type = 'button';
      item.className = `mark ${kind}`;
      item.textContent = SIGNS[kind];
      item.setAttribute('aria-label', text);
      add(item, time, null, `${time.toFixed(3)} s: ${text}`);
    }
    const now = lane.appendChild(document.createElement('i'));
    now.className = 'now';
    return { lane, items, now };
  });

  const place = () => {
    const [from, to] = clock.window;
    const share = (time) => (100 * (time - from)) / (to - from);
    for (const { lane, items } of lanes) {
      for (const { item, from: begin, to: end } of items) {
        item.hidden = (end ?? begin) < from || begin > to;
        if (item.hidden) continue;
        item.style.left = `${Math.max(share(begin), 0)}%`;
        if (end === null) continue;
        const width = Math.min(share(end), 100) - Math.max(share(begin), 0);
        item.style.width = `${width}%`;
        item.classList.toggle('narrow', (width * lane.clientWidth) / 100 < NARROW);
      }
    }
    showTime();
  };
  const showTime = () => {
    const [from, to] = clock.window;
    for (const { now } of lanes) now.style.left = `${(100 * (clock.time - from)) / (to - from)}%`;
  };
  new ResizeObserver(place).observe(element);
  clock.addEventListener('window', place);
  clock.addEventListener('time', showTime);
  place();
}
