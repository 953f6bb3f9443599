// The current time, updated once a second, for everything that shows an age.

let now = $state(Date.now());
const tick = (): void => void (now = Date.now());
setInterval(tick, 1_000);
// Timers of a hidden page are slowed down.
document.addEventListener("visibilitychange", tick);

export function clock(): number {
  return now;
}
