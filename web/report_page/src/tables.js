// Rows of the table of moves go to their move; the row of the move that is driven is marked.

export function tables(report, clock) {
  const rows = [...document.querySelectorAll('tr[data-from]')].map((row) => ({
    row,
    from: Number(row.dataset.from),
    to: Number(row.dataset.to),
    run: report.runs[Number(row.dataset.run)],
  }));
  for (const one of rows) {
    // the table has the times of its run, the page those of the first one
    const shift = one.run.shift_s;
    one.from += shift;
    one.to += shift;
    one.row.tabIndex = 0;
    const go = () => {
      const room = Math.max(0.1 * (one.to - one.from), 0.02);
      clock.show(one.from - room, one.to + room);
      clock.seek(one.from);
    };
    one.row.addEventListener('click', go);
    one.row.addEventListener('keydown', (event) => {
      if (event.key === 'Enter') go();
    });
  }
  const mark = () => {
    for (const { row, from, to } of rows) row.classList.toggle('driven', from <= clock.time && clock.time < to);
  };
  clock.addEventListener('time', mark);
  mark();
}
