// Numbers and units as text, and text as numbers.

export function formatNumber(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return String(Number(value.toPrecision(digits)));
}

export function formatQuantity(value, unit, per = 1, digits = 4) {
  if (value === null || value === undefined) return "–";
  return `${formatNumber(value * per, digits)} ${unit}`.trim();
}

// What one of a typed unit is in the page's unit of the control.
const CONVERSIONS = {
  mm: { m: 1e3, cm: 10, µm: 1e-3, um: 1e-3, in: 25.4 },
  N: { kN: 1e3, mN: 1e-3, lbf: 4.4482216152605 },
  "N RMS": { N: 1, kN: 1e3, mN: 1e-3 },
  "N/m": { "N/mm": 1e3, "kN/m": 1e3 },
  "m/s²": { "m/s^2": 1, "m/s2": 1, g: 9.80665 },
};

// Return the number that somebody typed, with a decimal point or comma and perhaps a unit, in the control's unit; null if it is none.
export function parseNumber(text, unit) {
  const match = /^([+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:e[+-]?\d+)?)\s*(.*)$/i.exec(text.trim());
  if (!match) return null;
  const number = Number(match[1].replace(",", "."));
  const typed = match[2];
  if (typed === "" || typed === unit || (typed === "%" && unit.startsWith("%"))) return number;
  const factor = CONVERSIONS[unit]?.[typed];
  return factor === undefined ? null : number * factor;
}

export function escapeText(text) {
  const names = { "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" };
  return String(text).replace(/[&<>"]/g, (character) => names[character]);
}
