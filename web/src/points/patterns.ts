/** Patterns of points as people type them: separated by commas, Chinese ones too, or blanks. */
export function patterns(text: string): string[] {
  return [...new Set(text.split(/[\s,，、;；]+/).filter(Boolean))];
}
