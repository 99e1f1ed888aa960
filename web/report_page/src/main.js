// The report page: reads what stands in it, and puts 3-D, plots, track, tables and time together.

import plotStyle from 'uplot/dist/uPlot.min.css';

import { Clock } from './clock.js';
import { Plots } from './plots.js';
import { readReport } from './report.js';
import { Stage } from './stage.js';
import { tables } from './tables.js';
import { themeButton } from './theme.js';
import { track } from './track.js';
import { transport } from './transport.js';

async function start() {
  document.head.prepend(Object.assign(document.createElement('style'), { textContent: plotStyle }));
  themeButton(document.getElementById('theme'));
  const report = await readReport();
  const clock = new Clock(report);
  transport(clock, report.time);
  track(report, clock);
  const plots = new Plots(report, clock);
  tables(report, clock);
  let stage = null;
  try {
    stage = new Stage(report, clock);
  } catch (error) {
    // a browser without WebGL still shows everything else
    document.getElementById('stage').classList.add('failed');
    document.getElementById('told').textContent = `No 3-D here: ${error.message}`;
  }
  document.documentElement.dataset.ready = 'yes';
  // for those who look into a page: the values, the time and where things are drawn
  window.delta3 = { report, clock, plots, stage };
}

start().catch((error) => {
  document.documentElement.dataset.ready = 'failed';
  const told = document.getElementById('told');
  told.textContent = `This page cannot be shown: ${error.message}`;
  throw error;
});
