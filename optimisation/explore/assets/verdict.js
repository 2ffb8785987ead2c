// The verdict at the top, the comparison with a pinned setting, and all numbers of the card with their explanations.
import { escapeText, formatNumber, formatQuantity } from "./format.js";

const find = (selector) => document.querySelector(selector);

export function showVerdict(card) {
  const { grade, headline, band, sentence } = card.verdict;
  find("#verdict").dataset.grade = grade;
  find("#headline").textContent = headline;
  find("#band").textContent = band;
  find("#sentence").textContent = sentence;
}

// Return the setting's changes as text, "gap 1 → 1.2 mm".
export function describeChanges(controls, before, after) {
  const changes = [];
  for (const [name, value] of Object.entries(after)) {
    const control = controls.get(name);
    if (!control || before[name] === value || before[name] === null) continue;
    const old = formatNumber(before[name] * control.per);
    const now = formatQuantity(value, control.unit, control.per);
    if (old !== formatNumber(value * control.per)) changes.push(`${control.label} ${old} → ${now}`);
  }
  return changes.join("; ");
}

export function showComparison(pinned, card, controls, values) {
  const place = find("#comparison");
  place.hidden = !pinned?.card;
  if (place.hidden) return;
  const relevant = Object.fromEntries(
    Object.entries(values).filter(([name]) => controls.has(name)),
  );
  const changes = describeChanges(controls, pinned.values, relevant) || "the same numbers";
  const before = formatNumber(100 * (pinned.card.level / pinned.card.without), 3);
  const now = card ? `${formatNumber(100 * (card.level / card.without), 3)} %` : "…";
  place.textContent = `Pinned ${before} % → now ${now} of no absorber (${changes}).`;
}

function formatCardNumber(row, card) {
  if (row.key === "band") {
    const [low, high] = card.band;
    if (low === null || high === null) return "– (one run)";
    return `${formatNumber(low * row.per)} to ${formatQuantity(high, row.unit, row.per)}`;
  }
  if (row.key === "limit" && card.limit === 0) return "none at this load";
  return formatQuantity(card[row.key], row.unit, row.per);
}

// Return label, text and row of each number that a card has.
export function listNumbers(rows, card) {
  return rows
    .filter((row) => card[row.key] !== undefined)
    .map((row) => ({ row, text: formatCardNumber(row, card) }));
}

export function showNumbers(rows, card, note) {
  const items = listNumbers(rows, card).map(({ row, text }) => {
    const pair = document.createElement("div");
    const term = document.createElement("dt");
    const value = document.createElement("dd");
    const about = document.createElement("dd");
    const link = document.createElement("a");
    term.textContent = row.label;
    value.textContent = text;
    value.dataset.number = row.key;
    about.className = "about";
    link.href = `help#${row.key}`;
    link.target = "_blank";
    link.rel = "noopener";
    link.textContent = "more";
    link.setAttribute("aria-label", `More about ${row.label}`);
    about.append(`${row.about} `, link);
    pair.append(term, value, about);
    return pair;
  });
  find("#card dl").replaceChildren(...items);
  find("#card .note").textContent = note;
}

const CARD_STYLE =
  "body{font:15px sans-serif;max-width:60rem;margin:2rem auto}td,th{padding:.2rem .8rem;text-align:left;border-bottom:1px solid #ccc}";

// Return the card as one HTML file: verdict, numbers, commands, files and figures.
export function makeCardPage({ title, about, card, rows, commands, files, figures }) {
  const numbers = listNumbers(rows, card)
    .map(
      ({ row, text }) =>
        `<tr><th>${escapeText(row.label)}</th><td>${escapeText(text)}</td><td>${escapeText(row.about)}</td></tr>`,
    )
    .join("");
  const listed = Object.entries(files)
    .map(
      ([name, content]) =>
        `<h2>${escapeText(name)}</h2><pre>${escapeText(JSON.stringify(content, null, 1))}</pre>`,
    )
    .join("");
  const { headline, band, sentence } = card.verdict;
  return `<!doctype html><html lang="en"><meta charset="utf-8"><title>Design card</title><style>${CARD_STYLE}</style>
<h1>${escapeText(headline)}</h1><p>${escapeText(band)}. ${escapeText(sentence)}</p><p>${escapeText(title)}; ${escapeText(about)}.</p>
<table>${numbers}</table><p>The same runs by commands, with the files below:</p><pre>${escapeText(commands)}</pre>${listed}${figures.join("\n")}</html>`;
}
