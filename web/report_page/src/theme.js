// Light and dark: as the system says, or as the button says. Colours are those of the style sheet.

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

export const AXIS_COLOURS = 6; // columns beyond begin anew

// Colours of the three axes, or of x, y, z, and of further columns.
export function axisColours() {
  return Array.from({ length: AXIS_COLOURS }, (_, n) => colour(`axis${n + 1}`));
}

export function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
}

// Call back whenever the colours change.
export function onTheme(callback) {
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', callback);
  document.addEventListener('theme', callback);
}

export function themeButton(button) {
  button.addEventListener('click', () => {
    document.documentElement.dataset.theme = isDark() ? 'light' : 'dark';
    document.dispatchEvent(new Event('theme'));
  });
}
