// What this browser remembers of how the page shall look.

export type Theme = "auto" | "light" | "dark";
export const THEMES: readonly Theme[] = ["auto", "light", "dark"];

const KEPT = "railbus.theme";

function kept(): Theme {
  const name = localStorage.getItem(KEPT);
  return THEMES.find((theme) => theme === name) ?? "auto";
}

let theme = $state<Theme>(kept());

export function themeNow(): Theme {
  return theme;
}

/** Shows another theme, here and the next time. */
export function wear(next: Theme): void {
  theme = next;
  localStorage.setItem(KEPT, next);
  dress();
}

/** Tells the style sheet. */
export function dress(): void {
  document.documentElement.dataset["theme"] = theme;
}
