// The current time, updated once a second, for everything that shows an age.

let now = $state(Date.now());
setInterval(() => (now = Date.now()), 1_000);

export function clock(): number {
  return now;
}
