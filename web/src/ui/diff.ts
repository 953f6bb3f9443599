// What differs between two texts, line by line.

export interface DiffLine {
  kind: "same" | "added" | "gone";
  text: string;
}

/** Beyond this many pairs of lines, everything between the equal ends counts as changed. */
const PAIRS_MOST = 4_000_000;

/** The shortest edit from one text to the other. */
export function diff(before: string, after: string): DiffLine[] {
  const [a, b] = [before.split("\n"), after.split("\n")];
  let head = 0;
  while (head < a.length && head < b.length && a[head] === b[head]) head++;
  let tail = 0;
  while (tail < a.length - head && tail < b.length - head && a.at(-1 - tail) === b.at(-1 - tail)) tail++;
  const same = (text: string): DiffLine => ({ kind: "same", text });
  return [
    ...a.slice(0, head).map(same),
    ...between(a.slice(head, a.length - tail), b.slice(head, b.length - tail)),
    ...a.slice(a.length - tail).map(same),
  ];
}

function between(a: string[], b: string[]): DiffLine[] {
  const gone = (text: string): DiffLine => ({ kind: "gone", text });
  const added = (text: string): DiffLine => ({ kind: "added", text });
  if (a.length * b.length > PAIRS_MOST) return [...a.map(gone), ...b.map(added)];
  // longest[i][j]: how many lines the rests from i and j on have in common.
  const wide = b.length + 1;
  const longest = new Uint32Array((a.length + 1) * wide);
  const of = (i: number, j: number): number => longest[i * wide + j] ?? 0;
  for (let i = a.length - 1; i >= 0; i--) {
    for (let j = b.length - 1; j >= 0; j--) {
      longest[i * wide + j] = a[i] === b[j] ? of(i + 1, j + 1) + 1 : Math.max(of(i + 1, j), of(i, j + 1));
    }
  }
  const found: DiffLine[] = [];
  let [i, j] = [0, 0];
  while (i < a.length || j < b.length) {
    const [left, right] = [a[i], b[j]];
    if (left !== undefined && left === right) {
      found.push({ kind: "same", text: left });
      i++;
      j++;
    } else if (left !== undefined && (right === undefined || of(i + 1, j) >= of(i, j + 1))) {
      found.push(gone(left));
      i++;
    } else if (right !== undefined) {
      found.push(added(right));
      j++;
    }
  }
  return found;
}

/** For each line the number of the change it belongs to; -1 for lines in both texts. */
export function changes(lines: readonly DiffLine[]): number[] {
  let count = 0;
  return lines.map(({ kind }, i) => {
    if (kind === "same") return -1;
    if (i === 0 || lines[i - 1]?.kind === "same") count++;
    return count - 1;
  });
}

/** The text before with some of the changes made. */
export function partly(lines: readonly DiffLine[], taken: (change: number) => boolean): string {
  const of = changes(lines);
  const stays = ({ kind }: DiffLine, i: number): boolean => kind === "same" || (kind === "added") === taken(of[i] ?? -1);
  return lines
    .filter(stays)
    .map(({ text }) => text)
    .join("\n");
}

/** Lines of context around a change. */
const AROUND = 3;

/** A diff with long equal parts folded: a number stands for that many lines. */
export function folded<Line extends DiffLine>(lines: readonly Line[]): (Line | number)[] {
  const near = new Uint8Array(lines.length);
  lines.forEach((line, i) => {
    if (line.kind !== "same") near.fill(1, Math.max(0, i - AROUND), i + AROUND + 1);
  });
  const found: (Line | number)[] = [];
  for (const [i, line] of lines.entries()) {
    const last = found.at(-1);
    if (near[i]) found.push(line);
    else if (typeof last === "number") found[found.length - 1] = last + 1;
    else found.push(1);
  }
  return found;
}
