'use strict';

const D = JSON.parse(document.getElementById('data').textContent);
const SWEEP = D.settings.length > 1;
const COST = {
  evaluations: { name: 'evaluations', axis: 'matrix elements evaluated', front: 'front_evaluations' },
  cpu_seconds: { name: 'CPU time', axis: 'CPU time, seconds', front: 'front_cpu_seconds' },
};
const state = {
  x: COST[D.plot.x] ? D.plot.x : 'evaluations',
  figure: D.figures.includes(D.plot.y) ? D.plot.y : D.figures[0],
  colour: D.axes.findIndex((axis) => axis.name === D.plot.colour),
  setting: 0,
  seed: null,
  sort: { key: null, up: true },
  a: { setting: null, name: null },
  b: { setting: null, name: null },
  mode: 'slider',
  zoom: 0,
  split: 50,
};

// ---- elements and numbers

/** An element with properties (`on…`, `class`, attributes) and children. */
function make(tag, properties = {}, ...children) {
  const svg = ['svg', 'g', 'path', 'line', 'circle', 'text'].includes(tag);
  const element = svg ? document.createElementNS('http://www.w3.org/2000/svg', tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith('on')) element.addEventListener(name.slice(2), value);
    else if (name === 'style') element.style.cssText = value;
    else if (value !== null && value !== undefined && value !== false) element.setAttribute(name, value === true ? '' : value);
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

const finite = (value) => typeof value === 'number' && Number.isFinite(value);
const plural = (count, word) => `${count} ${word}${count === 1 ? '' : 's'}`;
const plain = (value) => String(value ?? '').replace(/^"(.*)"$/s, '$1');
const PREFIX = [[1e12, 'T'], [1e9, 'G'], [1e6, 'M'], [1e3, 'k'], [1, '']];
const prefix = (size) => PREFIX.find(([scale]) => size >= scale * 0.9995) ?? [1, ''];

const power = (exponent) => `10${[...String(exponent)].map((c) => (c === '-' ? '⁻' : '⁰¹²³⁴⁵⁶⁷⁸⁹'[c])).join('')}`;

/** A few digits, with a prefix or a power of ten where that is shorter. */
function short(value, digits = 3) {
  if (!finite(value)) return '–';
  const size = Math.abs(value);
  if (size === 0) return '0';
  if (size < 9.995e-4) {
    const [factor, exponent] = value.toExponential(digits - 1).split('e');
    return Number(factor) === 1 ? power(Number(exponent)) : `${Number(factor)} × ${power(Number(exponent))}`;
  }
  const [scale, letter] = size < 9995 ? [1, ''] : prefix(size);
  return `${Number((value / scale).toPrecision(digits))}${letter && `\u00a0${letter}`}`;
}

/** A mean and, apart, its deviation with as many decimals, of which two digits count. */
function spread(is, digits = 4) {
  const { mean, deviation, count } = is;
  if (!(count > 1) || !(deviation > 0)) return [short(mean, digits), count > 1 && deviation === 0 ? ' ± 0' : ''];
  const size = Math.max(Math.abs(mean), deviation);
  if (size < 1e-3 || size >= 9995) return [short(mean, digits), ` ± ${short(deviation, 2)}`];
  const decimals = Math.min(Math.max(1 - Math.floor(Math.log10(deviation)), 0), Math.max(4 - Math.floor(Math.log10(size)), 0), 6);
  return [mean.toFixed(decimals), ` ± ${deviation.toFixed(decimals)}`];
}

const seconds = (value) => (!finite(value) ? '–' : `${short(value)}\u00a0s`);
const cost = (x, is) => (x === 'evaluations' ? `${short(is?.mean)} evaluations` : `${seconds(is?.mean)} CPU`);

/** One scale and one number of decimals for a column, so that its numbers line up. */
function column(values, prefixed) {
  const sizes = values.filter(finite).map(Math.abs).filter((size) => size > 0);
  const [scale, letter] = prefixed && sizes.length ? prefix(Math.max(...sizes)) : [1, ''];
  const least = sizes.length ? Math.min(...sizes) / scale : 1;
  const digits = sizes.length ? Math.min(Math.max(2 - Math.floor(Math.log10(least)), 0), scale > 1 ? 2 : 5) : 0;
  const whole = scale === 1 && sizes.every(Number.isInteger);
  return { letter, text: (value) => (finite(value) ? (value / scale).toFixed(whole ? 0 : digits) : '–') };
}

const label = (setting) => D.axes.map((axis, k) => `${axis.name} ${plain(setting.values[k])}`).join(', ') || 'this run';
const pointsOf = (at) => (D.settings[at]?.points ?? []).map((place) => D.points[place]).filter(Boolean);
const spreadOf = (setting) => setting.figures[state.figure];

/** The point of a setting that is shown: that of the chosen seed, or the first with something to see. */
function pointOf(at) {
  const points = pointsOf(at);
  return points.find((point) => state.seed !== null && point.seed === state.seed)
    ?? points.find((point) => point.fate === 'done') ?? points.find((point) => point.pictures.length) ?? points[0];
}

function thumbnail(at) {
  const shown = pointsOf(at).flatMap((point) => point.pictures.slice(0, 1)).map(([, place]) => D.pictures[place]);
  return shown.find((picture) => picture?.uri);
}

// ---- header

function head() {
  const count = (fate) => D.points.filter((point) => point.fate === fate).length;
  const fates = [[count('done'), 'done'], [count('failed'), 'failed'], [count('missing'), 'not run or not finished']];
  const varied = D.axes.map((axis) => `${axis.name} (${plural(axis.values.length, 'value')})`);
  if (D.seed) varied.push(`${D.seed.name} for error bars (${plural(D.seed.values.length, 'value')})`);
  const failed = D.points.filter((point) => point.fate === 'failed');
  const where = (point) => [SWEEP && label(D.settings[point.setting] ?? { values: [] }), point.seed !== null && `${D.seed?.name ?? 'seed'} ${plain(point.seed)}`].filter(Boolean).join(', ');
  const item = (point) => make('li', {}, where(point) && make('strong', {}, `${where(point)}: `), point.problem ?? 'no reason is known');
  const list = (points) => make('ul', { class: 'problems' }, points.map(item));
  const when = new Date(D.made * 1000).toISOString().slice(0, 16).replace('T', ' ');
  return make('header', {},
    make('h1', {}, D.title),
    varied.length > 0 && make('p', {}, `Varied: ${varied.join(', ')}.`),
    make('p', {}, D.points.length === 0 ? 'There are no points.' : D.points.length === 1 && count('done') === 1 ? 'One run.' : `${plural(D.points.length, 'point')}: ${fates.filter(([n]) => n > 0).map(([n, what]) => `${n} ${what}`).join(', ')}.`),
    failed.length > 0 && list(failed.slice(0, 8)),
    failed.length > 8 && make('details', {}, make('summary', {}, `${failed.length - 8} more failed`), list(failed.slice(8))),
    D.notes.map((note) => make('p', { class: 'note' }, note)),
    make('p', { class: 'note' }, `From ${D.source}, ${when} UTC, Lightloom ${D.version}.`));
}

function cheapest() {
  if (!SWEEP || D.cheapest.length === 0) return null;
  const card = (target) => {
    const choice = (x) => target[x] !== null && D.settings[target[x]] && make('button', { onclick: () => select(target[x], true) },
      make('strong', {}, label(D.settings[target[x]])), make('span', { class: 'quiet' }, cost(x, D.settings[target[x]][x])));
    const same = target.evaluations === target.cpu_seconds;
    const setting = D.settings[target.evaluations];
    const both = same && setting && make('button', { onclick: () => select(target.evaluations, true) },
      make('strong', {}, label(setting)), make('span', { class: 'quiet' }, `${cost('evaluations', setting.evaluations)}, ${cost('cpu_seconds', setting.cpu_seconds)}`));
    const found = [both || null, !same && choice('evaluations'), !same && choice('cpu_seconds')].filter(Boolean);
    return make('div', { class: 'card' }, make('h3', {}, `within ${Number((target.target * 100).toPrecision(3))} %`), found.length ? found : make('span', { class: 'quiet' }, 'not reached'));
  };
  return make('section', {}, make('h2', {}, `Cheapest setting by ${D.plot.y}`), make('div', { class: 'cards' }, D.cheapest.map(card)));
}

// ---- plot

/** Where values stand between two places, with ticks. */
function scale(values, from, to, room) {
  let [low, high] = [Math.min(...values), Math.max(...values)];
  const log = low > 0 && high / low > 10;
  const ticks = [];
  if (log) {
    const margin = 0.05 * Math.log10(high / low);
    [low, high] = [Math.log10(low) - margin, Math.log10(high) + margin];
    const decades = high - low;
    const inner = decades * 3 < room ? [1, 2, 5] : [1];
    const step = Math.max(1, Math.ceil(decades / room));
    for (let power = Math.floor(low); power <= high; power += 1) {
      if (power % step === 0) ticks.push(...inner.map((digit) => digit * 10 ** power));
    }
  } else {
    if (low > 0 && low < 0.7 * high) low = 0;
    const margin = low === high ? Math.abs(high) / 2 || 1 : 0.05 * (high - low);
    [low, high] = [low === 0 ? 0 : low - margin, high + margin];
    const rough = (high - low) / room;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((digit) => digit * power).find((size) => size >= rough);
    for (let k = Math.ceil(low / step); k * step <= high; k += 1) ticks.push(Number((k * step).toPrecision(12)));
  }
  const place = (value) => {
    const at = log ? (value > 0 ? Math.log10(value) : low) : value;
    return from + ((Math.min(Math.max(at, low), high) - low) / (high - low)) * (to - from);
  };
  const inside = (value) => (log ? Math.log10(value) : value) >= low && (log ? Math.log10(value) : value) <= high;
  return { place, ticks: ticks.filter(inside) };
}

/** A colour for a value of an axis: by rank for ordered values, else one of seven. */
function colours(at) {
  const axis = D.axes[at];
  if (!axis) return () => 'var(--accent)';
  const ordered = axis.values.every((value) => value.trim() !== '' && Number.isFinite(Number(value)));
  const ranked = ordered ? [...axis.values].sort((p, q) => Number(p) - Number(q)) : axis.values;
  return (value) => {
    const rank = ranked.indexOf(value);
    if (rank < 0) return 'var(--quiet)';
    if (!ordered && ranked.length <= 7) return `var(--cat-${rank})`;
    const t = ranked.length > 1 ? (2 * rank) / (ranked.length - 1) : 1;
    const lower = Math.min(Math.floor(t), 1);
    return `color-mix(in oklab, var(--seq-${lower + 1}) ${Math.round((t - lower) * 100)}%, var(--seq-${lower}))`;
  };
}

/** Settings that no other undercuts; those of the plotted figure are given, others: lower is better. */
function frontOf(drawn) {
  const points = drawn.map((at) => [D.settings[at][state.x].mean, spreadOf(D.settings[at]).mean, at]).sort((p, q) => p[0] - q[0] || p[1] - q[1]);
  if (state.figure === D.plot.y) return points.filter(([, , at]) => D.settings[at][COST[state.x].front]);
  let best = Infinity;
  return points.filter(([, y]) => y < best && ((best = y), true));
}

const hollow = (setting) => state.x === 'cpu_seconds' && (setting.together || setting.other_host);

function plot() {
  if (!SWEEP) return null;
  if (D.figures.length === 0) {
    return make('section', {}, make('h2', {}, 'Error against cost'), make('p', { class: 'quiet' }, 'There are no figures: no node of the graph measures anything that the report can plot.'));
  }
  const canvas = make('div', { class: 'plot' });
  const below = make('div');
  const toggle = make('span', { class: 'choice', role: 'group', 'aria-label': 'cost' });
  const draw = () => {
    toggle.replaceChildren(...Object.keys(COST).map((x) => make('button', { 'data-x': x, 'aria-pressed': String(state.x === x), onclick: () => { state.x = x; draw(); toggle.querySelector(`[data-x=${x}]`).focus(); } }, COST[x].name)));
    drawPlot(canvas, below);
  };
  const choose = (key, entries, id) => make('select', { id, onchange: (event) => { state[key] = key === 'colour' ? Number(event.target.value) : event.target.value; draw(); } },
    entries.map(([value, name]) => make('option', { value, selected: value === state[key] }, name)));
  new ResizeObserver(draw).observe(canvas);
  return make('section', {}, make('h2', {}, 'Error against cost'),
    make('div', { class: 'controls' },
      make('label', {}, 'Figure', choose('figure', D.figures.map((name) => [name, name]), 'figure')),
      make('label', {}, 'against', toggle),
      D.axes.length > 0 && make('label', {}, 'Colour', choose('colour', [[-1, 'one colour'], ...D.axes.map((axis, k) => [k, axis.name])], 'colour'))),
    canvas, below);
}

function drawPlot(canvas, below) {
  const width = canvas.clientWidth;
  if (width === 0) return;
  const usable = (is) => is && finite(is.mean);
  const drawn = D.settings.map((_, at) => at).filter((at) => usable(spreadOf(D.settings[at])) && usable(D.settings[at][state.x]));
  const missing = D.settings.length - drawn.length;
  if (drawn.length === 0) {
    canvas.replaceChildren(make('p', { class: 'quiet' }, `No setting has both ${state.figure} and ${COST[state.x].name}.`));
    below.replaceChildren();
    return;
  }
  const height = Math.min(440, Math.max(300, width * 0.6));
  const [left, right, top, bottom] = [62, width - 14, 26, height - 46];
  const ends = (is) => [is.mean + is.deviation, is.mean - is.deviation];
  const shown = (spreads) => {
    const means = spreads.map((is) => is.mean);
    const positive = means.every((mean) => mean > 0);
    return means.concat(spreads.flatMap(ends).filter((end) => finite(end) && (!positive || end > 0.3 * Math.min(...means))));
  };
  const X = scale(shown(drawn.map((at) => D.settings[at][state.x])), left, right, width / 75);
  const Y = scale(shown(drawn.map((at) => spreadOf(D.settings[at]))), bottom, top, 7);
  const colour = colours(state.colour);
  const svg = make('svg', { height, viewBox: `0 0 ${width} ${height}`, role: 'group', 'aria-label': `${state.figure} against ${COST[state.x].axis}` });
  for (const tick of Y.ticks) {
    svg.append(make('line', { class: 'grid', x1: left, x2: right, y1: Y.place(tick), y2: Y.place(tick) }), make('text', { x: left - 10, y: Y.place(tick) + 4, 'text-anchor': 'end' }, short(tick)));
  }
  for (const tick of X.ticks) {
    svg.append(make('line', { class: 'grid', x1: X.place(tick), x2: X.place(tick), y1: top, y2: bottom }), make('text', { x: X.place(tick), y: bottom + 20, 'text-anchor': 'middle' }, short(tick)));
  }
  svg.append(make('text', { class: 'label', x: 0, y: 12 }, state.figure), make('text', { class: 'label x-label', x: right, y: height - 6, 'text-anchor': 'end' }, COST[state.x].axis));
  const front = frontOf(drawn);
  if (front.length > 1) {
    const steps = front.map(([x, y], k) => (k === 0 ? `M${X.place(x)},${Y.place(y)}` : `H${X.place(x)}V${Y.place(y)}`));
    svg.append(make('path', { class: 'front', d: steps.join('') }));
  }
  const tip = make('div', { class: 'tip', hidden: true, role: 'status' });
  const marks = drawn.map((at) => {
    const setting = D.settings[at];
    const [x, y] = [X.place(setting[state.x].mean), Y.place(spreadOf(setting).mean)];
    const fill = colour(setting.values[state.colour]);
    for (const [of, S, across] of [[spreadOf(setting), Y, false], [setting[state.x], X, true]]) {
      if (!(of.count > 1) || !finite(of.deviation) || (across && of.deviation === 0)) continue;
      const [p, q] = [S.place(of.mean - of.deviation), S.place(of.mean + of.deviation)];
      const d = across ? `M${p},${y - 3}v6m0,-3H${q}m0,-3v6` : `M${x - 4},${p}h8m-4,0V${q}m-4,0h8`;
      svg.append(make('path', { class: across ? 'bar across' : 'bar', 'data-setting': at, d, style: `stroke: ${fill}` }));
    }
    const show = () => {
      tip.replaceChildren(make('strong', {}, label(setting)), make('div', {}, `${state.figure} ${spread(spreadOf(setting)).join('')}`),
        make('div', { class: 'quiet' }, ['evaluations', 'cpu_seconds'].filter((kind) => setting[kind]).map((kind) => cost(kind, setting[kind])).join(', ')));
      tip.hidden = false;
      tip.style.left = `${Math.max(0, Math.min(x + 14, width - tip.offsetWidth))}px`;
      tip.style.top = `${Math.max(0, y - tip.offsetHeight - 12)}px`;
    };
    const hide = () => { tip.hidden = true; };
    return make('circle', {
      class: `mark${hollow(setting) ? ' hollow' : ''}${at === state.setting ? ' selected' : ''}`, 'data-setting': at, cx: x, cy: y, r: 6,
      style: `fill: ${fill}; stroke: ${hollow(setting) ? fill : 'var(--paper)'}`, tabindex: 0, role: 'button',
      'aria-label': `${label(setting)}: ${state.figure} ${short(spreadOf(setting).mean)}, ${cost(state.x, setting[state.x])}`,
      onpointerenter: show, onpointerleave: hide, onfocus: show, onblur: hide, onclick: () => select(at), onkeydown: (event) => { if (press(event)) select(at); },
    });
  });
  svg.append(...marks);
  canvas.replaceChildren(svg, tip);
  const axis = D.axes[state.colour];
  const entry = (swatch, text) => make('li', {}, swatch, text);
  const any = (key) => drawn.some((at) => D.settings[at][key]);
  const reasons = [any('together') && 'measured while something else ran, or for several points at once', any('other_host') && 'measured on another host'].filter(Boolean);
  const legend = make('ul', { class: 'legend' },
    axis && [make('li', {}, axis.name), axis.values.map((value) => entry(make('i', { style: `background: ${colour(value)}` }), plain(value)))],
    front.length > 1 && entry(make('i', { class: 'line' }), state.figure === D.plot.y ? 'front: no other setting is better at no more cost' : 'front, if lower is better'),
    drawn.some((at) => spreadOf(D.settings[at]).count > 1) && entry(make('i', { class: 'error' }), '± one standard deviation'));
  below.replaceChildren(legend);
  if (state.x === 'cpu_seconds' && reasons.length) {
    below.append(make('ul', { class: 'legend footnote' }, entry(make('i', { class: 'open' }), `CPU time ${reasons.join('; or ')}: not comparable to the second`)));
  }
  below.append(make('p', { class: 'note' }, 'Click a mark to see its pictures, costs and graph below.'));
  if (missing > 0) below.append(make('p', { class: 'note' }, `${plural(missing, 'setting')} without ${state.figure} or ${COST[state.x].name} ${missing === 1 ? 'is' : 'are'} not drawn.`));
}

/** Whether a key means a click, of a thing that is no button. */
function press(event) {
  if (event.key !== 'Enter' && event.key !== ' ') return false;
  event.preventDefault();
  return true;
}

// ---- table of settings

function table() {
  if (!SWEEP) return null;
  const values = (get) => D.settings.map(get);
  const columns = D.axes.map((axis, k) => ({
    name: axis.name, number: axis.values.every((value) => Number.isFinite(Number(value))),
    key: (setting) => axis.values.indexOf(setting.values[k]), cell: (setting) => plain(setting.values[k]),
  }));
  const measured = (name, get, prefixed) => {
    const text = column(values((setting) => get(setting)?.mean), prefixed);
    const varies = D.settings.some((setting) => get(setting)?.deviation > 0);
    const deviation = (is) => (varies && is?.count > 1 ? ` ± ${text.text(is.deviation)}` : '');
    // All as wide as the widest, so that the means line up.
    const wide = Math.max(...values((setting) => deviation(get(setting)).length));
    columns.push({
      name: `${name}${text.letter && ` (${text.letter})`}`, number: true, key: (setting) => get(setting)?.mean,
      cell: (setting) => [text.text(get(setting)?.mean), wide > 0 && make('span', { class: 'sd', style: `min-width: ${wide}ch` }, deviation(get(setting)))],
    });
  };
  for (const figure of D.figures) measured(figure, (setting) => setting.figures[figure]);
  measured('evaluations', (setting) => setting.evaluations, true);
  measured('CPU s', (setting) => setting.cpu_seconds);
  const fates = (setting) => setting.points.map((place) => D.points[place]?.fate ?? 'missing');
  const done = (setting) => fates(setting).filter((fate) => fate === 'done').length;
  columns.push({
    name: 'points', key: done,
    cell: (setting) => [`${done(setting)} of ${setting.points.length}`, fates(setting).includes('failed') && make('span', { class: 'bad' }, ', failed')],
  });
  const front = (setting) => [setting.front_evaluations && 'evaluations', setting.front_cpu_seconds && 'CPU time'].filter(Boolean);
  columns.push({ name: 'front', key: (setting) => -front(setting).length, cell: (setting) => front(setting).length > 0 && make('span', { title: `on the front of ${D.plot.y}` }, `● ${front(setting).length > 1 ? 'both' : front(setting)[0]}`) });
  const body = make('tbody');
  const heads = columns.map((of, k) => make('th', { class: of.number && 'number', scope: 'col' }, make('button', {
    onclick: () => { state.sort = { key: k, up: state.sort.key === k ? !state.sort.up : true }; sort(); },
  }, of.name)));
  const rows = D.settings.map((setting, at) => {
    const picture = thumbnail(at);
    return make('tr', { tabindex: 0, 'data-setting': at, onclick: () => select(at), onkeydown: (event) => { if (press(event)) select(at); } },
      make('td', { class: 'thumb' }, picture && make('img', { src: picture.uri, alt: '', loading: 'lazy' })),
      columns.map((of) => make('td', { class: of.number && 'number' }, of.cell(setting))));
  });
  const sort = () => {
    const { key, up } = state.sort;
    heads.forEach((head, k) => (k === key ? head.setAttribute('aria-sort', up ? 'ascending' : 'descending') : head.removeAttribute('aria-sort')));
    const value = (at) => { const is = key === null ? at : columns[key].key(D.settings[at]); return finite(is) ? is : null; };
    // What is not known comes last either way; equal ones stay in the order of the sweep.
    const order = rows.map((_, at) => at).sort((p, q) => {
      const [u, v] = [value(p), value(q)];
      return u === null || v === null ? (u === null) - (v === null) || p - q : (up ? u - v : v - u) || p - q;
    });
    body.replaceChildren(...order.map((at) => rows[at]));
  };
  sort();
  return make('section', {}, make('h2', {}, plural(D.settings.length, 'setting')),
    make('div', { class: 'scroll tall' }, make('table', { class: 'settings' }, make('thead', {}, make('tr', {}, make('th'), heads)), body)));
}

// ---- the selected setting

function select(at, scroll) {
  state.setting = at;
  for (const element of document.querySelectorAll('[data-setting].mark, .settings tr[data-setting]')) element.classList.toggle('selected', Number(element.dataset.setting) === at);
  const old = document.getElementById('selected');
  const next = selected();
  // A page that becomes shorter for a moment would jump.
  old.style.minHeight = `${old.offsetHeight}px`;
  old.replaceChildren(...next);
  old.style.minHeight = '';
  if (scroll) old.scrollIntoView();
}

function selected() {
  const point = pointOf(state.setting);
  if (!point) return [make('p', { class: 'quiet' }, 'There is nothing to show yet.')];
  const setting = D.settings[state.setting];
  const seeds = pointsOf(state.setting).filter((other) => other.seed !== null);
  const step = (by) => make('button', { class: 'button', 'aria-label': by < 0 ? 'previous setting' : 'next setting', onclick: () => select((state.setting + by + D.settings.length) % D.settings.length) }, by < 0 ? '←' : '→');
  return [
    make('h2', {}, SWEEP ? label(setting) : 'Result'),
    (SWEEP || seeds.length > 1) && make('div', { class: 'controls' }, SWEEP && make('span', { class: 'choice' }, step(-1), step(1)),
      seeds.length > 1 && make('label', {}, D.seed?.name ?? 'seed', make('select', { id: 'seed', onchange: (event) => { state.seed = event.target.value; select(state.setting); } },
        seeds.map((other) => make('option', { value: other.seed, selected: other === point }, plain(other.seed)))))),
    point.fate === 'failed' && make('p', { class: 'bad' }, `This point failed: ${point.problem ?? 'no reason is known'}`),
    point.fate === 'missing' && make('p', { class: 'quiet' }, 'This point was not run, or did not finish.'),
    numbers(setting, point), pictures(), costs(point), graph(point),
  ].flat().filter(Boolean);
}

function numbers(setting, point) {
  const entry = (name, main, extra) => make('div', {}, make('dt', {}, name), make('dd', {}, main, extra && make('span', { class: 'sd' }, extra)));
  const entries = D.figures.filter((name) => setting.figures[name]).map((name) => entry(name, ...spread(setting.figures[name])));
  if (setting.evaluations) entries.push(entry('evaluations', ...spread(setting.evaluations, 3)));
  if (setting.cpu_seconds) entries.push(entry('CPU seconds', ...spread(setting.cpu_seconds, 3)));
  const peak = Math.max(0, ...point.nodes.map((place) => D.nodes[place].peak_bytes));
  if (peak > 0) entries.push(entry('peak memory', `${short(peak)}B`));
  const none = D.figures.some((name) => setting.figures[name]) ? null : make('p', { class: 'quiet' }, 'No figures were measured here.');
  return [none, entries.length > 0 && make('dl', { class: 'figures' }, entries)];
}

// ---- pictures

function pictures() {
  const title = make('h3', {}, 'Pictures');
  if (!D.points.some((point) => point.pictures.length)) return [title, make('p', { class: 'quiet' }, 'There are no pictures: the graph has no output that is one, or nothing was run.')];
  const names = (side) => (pointOf(state[side].setting ?? state.setting)?.pictures ?? []).map(([name]) => name);
  // What may be compared at once: two pictures of this setting, or the same of another one.
  if (state.b.name === null && names('a').length > 1) [, state.b.name] = names('b');
  if (state.b.name === null && SWEEP) {
    const others = D.settings.map((_, at) => at).filter((at) => at !== state.setting && thumbnail(at) && finite(spreadOf(D.settings[at])?.mean));
    state.b.setting ??= others.sort((p, q) => spreadOf(D.settings[p]).mean - spreadOf(D.settings[q]).mean)[0] ?? null;
  }
  const find = (side) => {
    const point = pointOf(state[side].setting ?? state.setting);
    const named = point?.pictures.find(([name]) => name === state[side].name) ?? point?.pictures[0];
    return named ? { name: named[0], ...D.pictures[named[1]] } : { name: null, problem: 'this point has no picture' };
  };
  const stage = make('div', { class: 'stage' });
  const controls = make('div', { class: 'controls' });
  const side = (key) => {
    const of = state[key];
    const withSetting = SWEEP && make('select', { id: `${key}-setting`, 'aria-label': `setting of ${key.toUpperCase()}`, onchange: (event) => { of.setting = event.target.value === '' ? null : Number(event.target.value); draw(); } },
      make('option', { value: '' }, 'the selected setting'), D.settings.map((setting, at) => make('option', { value: at, selected: of.setting === at }, label(setting))));
    const name = find(key).name;
    return make('label', {}, key.toUpperCase(), withSetting, make('select', { id: `${key}-name`, 'aria-label': `picture of ${key.toUpperCase()}`, onchange: (event) => { of.name = event.target.value; draw(); } },
      names(key).map((other) => make('option', { value: other, selected: other === name }, other))));
  };
  const handle = make('div', { class: 'handle', role: 'slider', tabindex: 0, 'aria-label': 'boundary between A and B', 'aria-valuemin': 0, 'aria-valuemax': 100 });
  const split = (percent) => {
    state.split = Math.min(100, Math.max(0, percent));
    stage.style.setProperty('--split', `${state.split}%`);
    handle.setAttribute('aria-valuenow', Math.round(state.split));
    handle.setAttribute('aria-valuetext', `A on the left ${Math.round(state.split)} %`);
  };
  handle.addEventListener('keydown', (event) => {
    const by = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10, Home: -100, End: 100 }[event.key];
    if (by === undefined) return;
    event.preventDefault();
    split(state.split + by * (event.shiftKey ? 10 : 1));
  });
  const drag = (event) => {
    const box = stage.getBoundingClientRect();
    split(((event.clientX - box.left) / box.width) * 100);
  };
  stage.addEventListener('pointerdown', (event) => {
    if (state.mode !== 'slider' || event.button !== 0) return;
    stage.setPointerCapture(event.pointerId);
    drag(event);
    handle.focus();
    event.preventDefault();
  });
  stage.addEventListener('pointermove', (event) => { if (stage.hasPointerCapture(event.pointerId)) drag(event); });
  const magnified = () => {
    for (const image of stage.querySelectorAll('img')) image.classList.toggle('magnified', image.clientWidth * devicePixelRatio > image.naturalWidth);
  };
  new ResizeObserver(magnified).observe(stage);
  const note = make('p', { class: 'note' });
  const draw = () => {
    const [a, b] = [find('a'), find('b')];
    const [width, height] = a.width ? [a.width, a.height] : [b.width || 16, b.height || 9];
    const panel = (picture, key) => make('figure', { class: key, style: `aspect-ratio: ${width} / ${height}` },
      picture.uri ? make('img', { src: picture.uri, alt: `${key.toUpperCase()}: ${picture.name}`, draggable: 'false', onload: magnified }) : make('div', { class: 'gone' }, `${picture.name ?? 'No picture'}: ${picture.problem}`),
      make('figcaption', {}, `${key.toUpperCase()} ${picture.name ?? ''}`));
    const count = state.mode === 'side' ? 2 : 1;
    stage.className = `stage ${state.mode}`;
    stage.style.width = state.zoom ? `${width * state.zoom * count + 12 * (count - 1)}px` : `min(100%, ${(count * 80 * width) / height}vh)`;
    stage.replaceChildren(panel(a, 'a'), panel(b, 'b'), ...(state.mode === 'slider' ? [handle] : []));
    const option = (key, value, text) => make('button', { 'data-mode': value, 'aria-pressed': String(state[key] === value), onclick: () => { state[key] = value; draw(); controls.querySelector(`[data-mode="${value}"]`).focus(); } }, text);
    controls.replaceChildren(side('a'), side('b'),
      make('span', { class: 'choice', role: 'group', 'aria-label': 'comparison' }, option('mode', 'slider', 'Slider'), option('mode', 'side', 'Side by side'), option('mode', 'difference', 'Difference × 5')),
      make('span', { class: 'choice', role: 'group', 'aria-label': 'magnification' }, option('zoom', 0, 'Fit'), option('zoom', 1, '1×'), option('zoom', 2, '2×'), option('zoom', 4, '4×')));
    const about = [];
    if (state.mode === 'difference') about.push('Absolute difference of the display values (after tone mapping and gamma, not of light), times 5, white where it is beyond that.');
    if (a.width && b.width && (a.width !== b.width || a.height !== b.height)) about.push(`A is ${a.width} × ${a.height} pixels and B ${b.width} × ${b.height}: both are scaled to the same area.`);
    else about.push(`${width} × ${height} pixels.`);
    if ([a, b].some((picture) => picture.uri && !picture.exact)) about.push('Copies made smaller for this page.');
    note.textContent = about.join(' ');
    split(state.split);
    magnified();
  };
  draw();
  return [title, controls, make('div', { class: 'view' }, stage), note];
}

// ---- costs and graph

function costs(point) {
  const title = make('h3', {}, 'Cost of each node');
  const nodes = point.nodes.map((place) => D.nodes[place]);
  if (nodes.length === 0) return [title, make('p', { class: 'quiet' }, 'No costs are known.')];
  const counted = nodes.filter((node) => node.counts);
  const sum = (key) => counted.reduce((total, node) => total + node[key], 0);
  const of = (key, prefixed) => column([...nodes.map((node) => node[key]), sum(key)], prefixed);
  const [wall, cpu, evaluations, bytes, peak] = [of('seconds'), of('cpu_seconds'), of('evaluations', true), of('bytes', true), of('peak_bytes', true)];
  const longest = Math.max(...nodes.map((node) => node.cpu_seconds), 1e-12);
  const number = (text) => make('td', { class: 'number' }, text);
  const cell = (is, value) => number(value > 0 ? is.text(value) : '–');
  const row = (node) => make('tr', { class: !node.counts && 'off' },
    make('td', {}, node.name), make('td', { class: 'quiet' }, node.counts ? node.kind : `${node.kind}, measuring only`), number(node.executions),
    number(`${wall.text(node.seconds)}${node.together ? ' *' : ''}`), number(cpu.text(node.cpu_seconds)),
    make('td', { class: 'length' }, make('i', { style: `width: ${(100 * node.cpu_seconds) / longest}%` })),
    cell(evaluations, node.evaluations), cell(bytes, node.bytes), cell(peak, node.peak_bytes));
  const heads = [['node'], ['type'], ['runs', 1], ['seconds', 1], ['CPU s', 1], [''], [`evaluations${evaluations.letter && ` (${evaluations.letter})`}`, 1], [`size (${bytes.letter}B)`, 1], [`peak (${peak.letter}B)`, 1]];
  const most = Math.max(...counted.map((node) => node.peak_bytes), 0);
  return [title, make('div', { class: 'scroll' }, make('table', { class: 'costs' },
    make('thead', {}, make('tr', {}, heads.map(([name, right]) => make('th', { class: right && 'number', scope: 'col' }, name)))),
    make('tbody', {}, nodes.map(row)),
    make('tfoot', {}, make('tr', {}, make('td', {}, 'all'), make('td'), number(sum('executions')), number(wall.text(sum('seconds'))), number(cpu.text(sum('cpu_seconds'))), make('td'), cell(evaluations, sum('evaluations')), cell(bytes, sum('bytes')), cell(peak, most))))),
  nodes.some((node) => !node.counts) && make('p', { class: 'note' }, 'Nodes that only measure do not count: they are grey, and not in the last row.'),
  nodes.some((node) => node.together) && make('p', { class: 'note' }, '* Measured while something else ran, or for several points at once.')];
}

function graph(point) {
  const text = point.graph.map((place) => D.lines[place]).join('\n');
  if (text === '') return [make('h3', {}, 'Graph'), make('p', { class: 'quiet' }, 'The graph of this point is not in the page.')];
  const body = make('pre', { tabindex: 0 }, text);
  const copy = make('button', {
    class: 'button', onclick: async () => {
      let done = true;
      try {
        await navigator.clipboard.writeText(`${text}\n`);
      } catch {
        // Files opened from a disk may not use the clipboard: the text is at least marked.
        getSelection().selectAllChildren(body);
        done = document.execCommand('copy');
      }
      copy.textContent = done ? 'Copied' : 'Marked: copy it by hand';
    },
  }, 'Copy');
  const file = `${[D.title, ...(SWEEP ? D.settings[state.setting].values.map(plain) : []), plain(point.seed)].join('-').replace(/[^\w.]+/g, '-').replace(/^-|-$/g, '')}.ron`;
  const open = document.querySelector('.graph')?.open ?? false;
  return [make('h3', {}, 'Graph'), make('details', { class: 'graph', open }, make('summary', {}, 'The graph file of this point'),
    make('div', { class: 'controls' }, copy, make('a', { class: 'button', download: file, href: `data:text/plain;charset=utf-8,${encodeURIComponent(`${text}\n`)}` }, 'Download')), body)];
}

// ---- start

const good = D.settings.map((_, at) => at).filter((at) => finite(spreadOf(D.settings[at])?.mean));
const fronts = good.filter((at) => D.settings[at].front_evaluations);
const lowest = (among) => among.reduce((best, at) => (best === null || spreadOf(D.settings[at]).mean < spreadOf(D.settings[best]).mean ? at : best), null);
const done = D.settings.findIndex((_, at) => pointsOf(at).some((point) => point.fate === 'done'));
state.setting = lowest(fronts) ?? lowest(good) ?? Math.max(done, 0);
document.getElementById('page').replaceChildren(...[head(), cheapest(), plot(), table(), make('section', { id: 'selected' })].filter(Boolean));
select(state.setting);
