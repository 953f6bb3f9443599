// Display preferences, kept in this browser.

export type Theme = "auto" | "light" | "dark";
const THEMES: readonly Theme[] = ["auto", "light", "dark"];

const KEPT = "railbus.theme";

function kept(): Theme {
  const name = localStorage.getItem(KEPT);
  return THEMES.find((theme) => theme === name) ?? "auto";
}

const dark = matchMedia("(prefers-color-scheme: dark)");
let system = $state<"light" | "dark">(dark.matches ? "dark" : "light");
let theme = $state<Theme>(kept());

export function themeNow(): Theme {
  return theme;
}

/** The theme in effect: `auto` is the system's. */
export function effectiveTheme(): "light" | "dark" {
  return theme === "auto" ? system : theme;
}

/** Switches to the next theme, and stores it. */
export function change(): void {
  theme = THEMES[(THEMES.indexOf(theme) + 1) % THEMES.length] ?? "auto";
  localStorage.setItem(KEPT, theme);
  applyTheme();
}

/** Sets what the style sheet goes by. */
function applyTheme(): void {
  document.documentElement.dataset["theme"] = effectiveTheme();
}

/** Applies the theme, and again when the system's preference changes. */
export function follow(): void {
  applyTheme();
  dark.addEventListener("change", () => {
    system = dark.matches ? "dark" : "light";
    applyTheme();
  });
}

let all = $state(false);

/** Hidden points are shown, until the page is reloaded. */
export function showsHidden(): boolean {
  return all;
}

export function showHidden(show: boolean): void {
  all = show;
}

const TABLED = "railbus.tabled";

/** The overview is shown as a table. */
export function isTabled(): boolean {
  return localStorage.getItem(TABLED) === "1";
}

export function keepTabled(tabled: boolean): void {
  localStorage.setItem(TABLED, tabled ? "1" : "0");
}
