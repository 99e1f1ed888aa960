// The bar at the foot of the page: play, slider, time, speed, zoom; and the keys that do the same.

import { SPEEDS } from './clock.js';

const STEPS = 10000; // of the slider

export function transport(clock, timeName) {
  const play = document.getElementById('play');
  const slider = document.getElementById('slider');
  const shown = document.getElementById('time');
  const speed = document.getElementById('speed');
  const length = clock.last - clock.first;

  slider.max = STEPS;
  slider.setAttribute('aria-label', timeName);
  for (const value of SPEEDS) speed.add(new Option(`${value}×`, value, value === 1, value === 1));

  play.addEventListener('click', () => clock.toggle());
  slider.addEventListener('input', () => {
    clock.pause();
    clock.seek(clock.first + (length * slider.value) / STEPS);
  });
  speed.addEventListener('change', () => clock.setSpeed(Number(speed.value)));
  document.getElementById('closer').addEventListener('click', () => clock.zoom(2));
  document.getElementById('wider').addEventListener('click', () => clock.zoom(0.5));
  document.getElementById('all').addEventListener('click', () => clock.showAll());

  const showTime = () => {
    const share = length > 0 ? (clock.time - clock.first) / length : 0;
    slider.value = STEPS * share;
    slider.style.setProperty('--share', `${100 * share}%`);
    shown.textContent = `${clock.time.toFixed(3)} s`;
    slider.setAttribute('aria-valuetext', shown.textContent);
  };
  const showPlaying = () => {
    play.dataset.playing = clock.playing;
    play.setAttribute('aria-label', clock.playing ? 'pause' : 'play');
  };
  clock.addEventListener('time', showTime);
  clock.addEventListener('playing', showPlaying);
  showTime();
  showPlaying();

  const keys = {
    ' ': () => clock.toggle(),
    ArrowRight: (event) => clock.seek(clock.time + (event.shiftKey ? 20 : 1) * clock.period),
    ArrowLeft: (event) => clock.seek(clock.time - (event.shiftKey ? 20 : 1) * clock.period),
    Home: () => clock.seek(clock.first),
    End: () => clock.seek(clock.last),
    '+': () => clock.zoom(2),
    '-': () => clock.zoom(0.5),
    0: () => clock.showAll(),
  };
  document.addEventListener('keydown', (event) => {
    if (event.target.closest('input, select, button, summary') || event.ctrlKey || event.metaKey || event.altKey) return;
    const action = keys[event.key];
    if (!action) return;
    event.preventDefault();
    action(event);
  });
}
