// The rows of the controls: a slider and a field for each number, a list for each choice.
import { formatNumber, parseNumber } from "./format.js";

const SLIDER_STEPS = 1000;
const ZERO_STEPS = 20; // left end of a logarithmic slider that has a zero
const PAGE_STEPS = 20; // three of them change a gap by less than twice
const CHOICE_LABELS = { concept: "Concept", load: "Load", direction: "Direction" };
const CHOICE_GROUPS = { concept: "absorber", load: "load", direction: "numerics" };
const FOLDED = "numerics";

export function sliderFromValue(control, value) {
  if (control.whole) return value;
  if (!control.log) return (SLIDER_STEPS * (value - control.low)) / (control.high - control.low);
  if (value <= 0) return 0;
  const start = control.zero ? ZERO_STEPS : 0;
  const share = Math.log(value / control.low) / Math.log(control.high / control.low);
  return start + (SLIDER_STEPS - start) * share;
}

export function valueFromSlider(control, position) {
  if (control.whole) return position;
  if (!control.log) {
    const value = control.low + ((control.high - control.low) * position) / SLIDER_STEPS;
    return Number(value.toPrecision(4));
  }
  const start = control.zero ? ZERO_STEPS : 0;
  if (position < start) return 0;
  const share = (position - start) / (SLIDER_STEPS - start);
  return Number((control.low * (control.high / control.low) ** share).toPrecision(3));
}

export function isAllowed(control, value) {
  const low = control.zero ? 0 : control.low;
  const slack = 1e-9 * control.high;
  return Number.isFinite(value) && value >= low - slack && value <= control.high + slack;
}

function makeElement(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

export class ControlTable {
  // onChange(name) is called when a person has changed a value.
  constructor(container, table, onChange) {
    this.container = container;
    this.onChange = onChange;
    this.useTable(table);
  }

  useTable(table) {
    this.table = table;
    this.controls = new Map(table.controls.map((control) => [control.name, control]));
    this.rows = new Map();
    this.values = {};
    this.container.replaceChildren();
    const groups = new Map();
    for (const [name, label] of Object.entries(table.groups)) {
      const group = this.makeGroup(name, label);
      groups.set(name, group);
      this.container.append(group);
    }
    for (const name of Object.keys(CHOICE_LABELS)) {
      groups.get(CHOICE_GROUPS[name]).append(this.makeChoice(name, table[`${name}s`]));
    }
    for (const control of table.controls) groups.get(control.group).append(this.makeRow(control));
    for (const group of groups.values()) group.hidden = !group.querySelector(".row");
    this.values.view = Object.keys(table.views)[0];
    this.values.instant = null;
    this.showRelevant();
  }

  makeGroup(name, label) {
    if (name === FOLDED) {
      const group = makeElement("details", { className: "group" });
      group.append(makeElement("summary", { textContent: label }));
      return group;
    }
    const group = makeElement("fieldset", { className: "group" });
    group.append(makeElement("legend", { textContent: label }));
    return group;
  }

  makeChoice(name, words) {
    const select = makeElement("select", { id: name });
    for (const [value, label] of Object.entries(words)) select.append(new Option(label, value));
    this.values[name] = Object.keys(words)[0];
    select.addEventListener("change", () => {
      this.values[name] = select.value;
      this.showRelevant();
      this.onChange(name);
    });
    const label = makeElement("label", { htmlFor: name, textContent: CHOICE_LABELS[name] });
    return makeElement("div", { className: "row choice" }, label, select);
  }

  makeRow(control) {
    const { name, unit } = control;
    const unitLabel = makeElement("span", { className: "unit", textContent: unit });
    const label = makeElement("label", { htmlFor: `n-${name}`, title: control.about });
    label.append(`${control.label} `, unitLabel);
    const field = makeElement("input", { id: `n-${name}`, type: "text", inputMode: "decimal" });
    field.setAttribute("aria-describedby", `e-${name}`);
    const slider = makeElement("input", { type: "range", title: control.about });
    slider.min = control.whole ? control.low : 0;
    slider.max = control.whole ? control.high : SLIDER_STEPS;
    slider.step = 1;
    slider.setAttribute("aria-label", `${control.label}${unit ? `, ${unit}` : ""}`);
    const error = makeElement("p", { className: "error", id: `e-${name}` });
    error.setAttribute("role", "alert");
    const row = makeElement("div", { className: "row" }, label, field, slider, error);
    row.dataset.control = name;
    this.rows.set(name, { row, field, slider, error, unitLabel });
    slider.addEventListener("input", () => this.moveSlider(control));
    slider.addEventListener("keydown", (event) => this.movePage(control, event));
    field.addEventListener("change", () => this.readField(control));
    field.addEventListener("keydown", (event) => {
      if (event.key === "Enter") this.readField(control);
    });
    this.set(name, control.value);
    return row;
  }

  moveSlider(control) {
    const { slider } = this.rows.get(control.name);
    this.set(control.name, valueFromSlider(control, Number(slider.value)), slider);
    this.onChange(control.name);
  }

  // A browser moves by a tenth of the slider, which multiplies a gap by more than two.
  movePage(control, event) {
    if (control.whole || (event.key !== "PageUp" && event.key !== "PageDown")) return;
    event.preventDefault();
    const { slider } = this.rows.get(control.name);
    slider.value = Number(slider.value) + (event.key === "PageUp" ? PAGE_STEPS : -PAGE_STEPS);
    this.moveSlider(control);
  }

  readField(control) {
    const { field } = this.rows.get(control.name);
    const before = this.values[control.name];
    if (before !== null && field.value === this.formatValue(control, before)) return;
    const number = parseNumber(field.value, control.unit);
    const value = number === null ? null : Number((number / control.per).toPrecision(15));
    this.set(control.name, value, number === null ? field : undefined);
    if (value === null) {
      const unit = control.unit ? ` ${control.unit}` : "";
      const example = `${this.formatValue(control, control.value)}${unit}`;
      this.showError(
        control.name,
        `“${field.value.slice(0, 20)}” is no number; an example: ${example}`,
      );
    }
    this.onChange(control.name);
  }

  formatValue(control, value) {
    return String(Number((value * control.per).toPrecision(6)));
  }

  set(name, value, source) {
    const control = this.controls.get(name);
    const { field, slider, unitLabel } = this.rows.get(name);
    this.values[name] = value;
    if (value === null) return;
    if (source !== field) field.value = this.formatValue(control, value);
    if (source !== slider) slider.value = sliderFromValue(control, value);
    slider.setAttribute("aria-valuetext", `${field.value} ${control.unit}`);
    if (name === "mass_ratio") {
      unitLabel.textContent = `${control.unit}, ${formatNumber(value * this.table.beam_mass_kg, 3)} kg`;
    }
  }

  // Set values by their names; missing ones become the defaults.
  setAll(values) {
    for (const control of this.controls.values()) {
      this.set(control.name, values[control.name] ?? control.value);
    }
    for (const name of ["concept", "load", "direction", "view"]) {
      const words = this.table[`${name}s`];
      this.values[name] = values[name] in words ? values[name] : Object.keys(words)[0];
    }
    this.values.instant = values.instant ?? null;
    this.showErrors({});
    this.showRelevant();
  }

  defaultOf(name) {
    if (this.controls.has(name)) return this.controls.get(name).value;
    return name === "instant" ? null : Object.keys(this.table[`${name}s`])[0];
  }

  // The values that are allowed and differ from the defaults.
  listChanges() {
    return Object.entries(this.values).filter(([name, value]) => {
      if (value === null || value === undefined || value === this.defaultOf(name)) return false;
      return !this.controls.has(name) || isAllowed(this.controls.get(name), value);
    });
  }

  hasErrors() {
    return [...this.controls.keys()].some((name) => this.values[name] === null);
  }

  isRelevant(control) {
    const { concept, load } = this.values;
    const fits = (names, value) => !names.length || names.includes(value);
    return fits(control.concepts, concept) && fits(control.loads, load);
  }

  showRelevant() {
    for (const [name, { row }] of this.rows) row.hidden = !this.isRelevant(this.controls.get(name));
    for (const name of Object.keys(CHOICE_LABELS)) {
      this.container.querySelector(`#${name}`).value = this.values[name];
    }
    this.container.querySelector("#direction").disabled = this.values.load === "random";
  }

  showError(name, text) {
    const { field, error } = this.rows.get(name);
    error.textContent = text;
    field.setAttribute("aria-invalid", text !== "");
    if (text) error.closest("details")?.setAttribute("open", "");
  }

  // Show the errors of controls at their rows, and return those of no control.
  showErrors(errors) {
    for (const name of this.rows.keys()) this.showError(name, errors[name] ?? "");
    return Object.entries(errors)
      .filter(([name]) => !this.rows.has(name))
      .map(([, text]) => text);
  }
}
