// Bundle the scripts of the report page into the package: node bundle.js (or npm run bundle), see CONTRIBUTING.md.

import { build } from 'esbuild';
import { createHash } from 'node:crypto';
import { readFileSync, readdirSync, writeFileSync } from 'node:fs';

const ASSETS = '../../delta3_pacdrive/studies/report_page/assets';
const here = (path) => new URL(path, import.meta.url);
const versions = JSON.parse(readFileSync(here('package.json'), 'utf-8')).devDependencies;

// A test compares this digest with that of the sources.
const digest = createHash('sha256');
for (const name of ['package.json', ...readdirSync(here('src')).sort().map((file) => `src/${file}`)]) {
  digest.update(readFileSync(here(name)));
}
await build({
  absWorkingDir: here('.').pathname,
  entryPoints: ['src/main.js'],
  outfile: `${ASSETS}/page.js`,
  bundle: true,
  minify: true,
  format: 'iife',
  target: 'es2022',
  charset: 'utf8',
  loader: { '.css': 'text' },
  legalComments: 'none', // LICENSES.txt contains all of them
  banner: {
    js: `/* Made from web/report_page by npm run bundle, sources ${digest.digest('hex').slice(0, 16)}; three.js ${versions.three} and uPlot ${versions.uplot}, both MIT: LICENSES.txt */`,
  },
});
const licence = (name, version, file) =>
  `${name} ${version}\n\n${readFileSync(here(`node_modules/${file}`), 'utf-8').trim()}\n`;
writeFileSync(
  here(`${ASSETS}/LICENSES.txt`),
  [licence('three.js', versions.three, 'three/LICENSE'), licence('uPlot', versions.uplot, 'uplot/LICENSE')].join('\n'),
);
