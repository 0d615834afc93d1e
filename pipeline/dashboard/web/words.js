// Numbers and states in words.

export const STATES = { s: "in sync", a: "out of sync", u: "cannot tell" };
export const TONE_OF_STATE = { s: "good", a: "bad", u: "unsure" };
export const TONES = { bad: "in trouble", away: "not heard", warn: "with warnings", unsure: "unsure", good: "in sync" };
export const GLYPHS = { bad: "✕", away: "⊘", warn: "⚠", unsure: "?", good: "✓" };

export function signed(value, digits = 1) {
  const text = Math.abs(value).toFixed(digits);
  if (Number(text) === 0) return (0).toFixed(digits);
  return (value < 0 ? "−" : "+") + text;
}

export function offset(value, sigma) {
  if (value === null || value === undefined) return "–";
  return sigma === null || sigma === undefined ? `${signed(value)} ms` : `${signed(value)} ± ${sigma.toFixed(1)} ms`;
}

export function duration(seconds) {
  const whole = Math.max(0, Math.round(seconds));
  for (const [unit, length] of [["days", 86400], ["h", 3600], ["min", 60]]) {
    if (whole >= 2 * length) return `${Math.floor(whole / length)} ${unit}`;
  }
  return `${whole} s`;
}

export function clock(ms) {
  const at = new Date(ms);
  const time = at.toLocaleTimeString([], { hour: "2-digit", minute: "2-digit", second: "2-digit", hour12: false });
  return at.toDateString() === new Date().toDateString() ? time : `${at.toLocaleDateString()} ${time}`;
}

export function plain(word) {
  return word.replaceAll("_", " ");
}

export function pairName(name) {
  return name.replace("-", " – ");
}
