// The page's address contains the setting; each change is a step of the browser's history, so that Back undoes it.

const SAME_STEP = 1500; // ms in which changes of one control are one step

export class SettingHistory {
  // onRestore(setting) is called when the browser goes back or forward.
  constructor(onRestore, onSteps) {
    this.onSteps = onSteps;
    this.lastSource = null;
    this.lastTime = 0;
    this.step = history.state?.step ?? 0;
    this.newest = Math.max(this.step, Number(sessionStorage.getItem("newest") ?? 0));
    history.replaceState({ step: this.step }, "");
    addEventListener("popstate", () => {
      this.step = history.state?.step ?? this.step;
      this.lastSource = null;
      this.reportSteps();
      onRestore(readSetting());
    });
    this.reportSteps();
  }

  // Write a setting into the address, as a new step unless the same control is still being moved.
  record(words, source) {
    const address = words.size ? `#${words}` : location.pathname;
    const now = performance.now();
    const same = source === this.lastSource && now - this.lastTime < SAME_STEP;
    this.lastSource = source;
    this.lastTime = now;
    if (location.hash === (words.size ? address : "")) return;
    if (same) {
      history.replaceState({ step: this.step }, "", address);
      return;
    }
    this.step += 1;
    this.newest = this.step;
    sessionStorage.setItem("newest", this.newest);
    history.pushState({ step: this.step }, "", address);
    this.reportSteps();
  }

  reportSteps() {
    this.onSteps(this.step > 0, this.step < this.newest);
  }
}

// Return the words of the address as strings.
export function readSetting() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}
