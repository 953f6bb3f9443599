// Downloads that the page makes itself.
import { language } from "../i18n/index.svelte";

export function save(name: string, type: string, text: string): void {
  const url = URL.createObjectURL(new Blob([text], { type }));
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 1_000);
}

/** Rows as CSV. For Chinese with a byte order mark, without which spreadsheets do not assume UTF-8. */
export function csv(head: string[], rows: unknown[][]): string {
  const cell = (value: unknown): string => {
    const text = String(value ?? "");
    // Escape formulas: a spreadsheet would run them.
    const safe = /^[=+\-@]/.test(text) && typeof value === "string" ? `'${text}` : text;
    return /[",\r\n]/.test(safe) ? `"${safe.replaceAll('"', '""')}"` : safe;
  };
  const lines = [head, ...rows].map((row) => row.map(cell).join(",") + "\r\n");
  return (language() === "zh" ? "\ufeff" : "") + lines.join("");
}
