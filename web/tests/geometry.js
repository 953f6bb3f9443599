// Where things stand on a page, measured: what overlaps, what leaves its card, what moves.

/** What is wrong with the places of things on the page as it is now. */
export function misplaced(page) {
  return page.evaluate(() => {
    const found = [];
    const { scrollWidth, clientWidth } = document.documentElement;
    if (scrollWidth > clientWidth) found.push(`the page scrolls sideways: ${scrollWidth} > ${clientWidth}`);
    const SLACK = 1;
    const isHidden = (element) =>
      element.closest(".sr, [hidden], [role=tooltip]") || !element.checkVisibility({ opacityProperty: true, visibilityProperty: true });

    /** The part of a box that is seen: what its ancestors cut off does not count. */
    function seen(box, from) {
      let { left, right, top, bottom } = box;
      let scrolls = false;
      for (let at = from; at && at !== document.body; at = at.parentElement) {
        const { overflowX, overflowY } = getComputedStyle(at);
        if (overflowX === "visible" && overflowY === "visible") continue;
        const clip = at.getBoundingClientRect();
        [left, right] = [Math.max(left, clip.left), Math.min(right, clip.right)];
        [top, bottom] = [Math.max(top, clip.top), Math.min(bottom, clip.bottom)];
        scrolls ||= overflowX === "auto" || overflowX === "scroll";
      }
      return right - left > 0.5 && bottom - top > 0.5 ? { left, right, top, bottom, scrolls } : null;
    }

    /** Every word and every control that stands below an element. */
    function pieces(root) {
      const list = [];
      const walk = document.createTreeWalker(root, NodeFilter.SHOW_TEXT);
      for (let node = walk.nextNode(); node; node = walk.nextNode()) {
        if (!node.data.trim() || isHidden(node.parentElement)) continue;
        const range = document.createRange();
        range.selectNodeContents(node);
        for (const rect of range.getClientRects()) {
          const box = seen(rect, node.parentElement);
          if (box) list.push({ box, element: node.parentElement, name: node.data.trim() });
        }
      }
      for (const element of root.querySelectorAll(".track, .lamp, button:not(.switch, .value), input, select, meter, svg[role=img], .tag")) {
        if (isHidden(element)) continue;
        const box = seen(element.getBoundingClientRect(), element.parentElement);
        if (box) list.push({ box, element, name: `<${element.localName} ${element.getAttribute("class") ?? ""}>` });
      }
      return list;
    }

    for (const card of document.querySelectorAll("main .card, main .note, dialog .body")) {
      const frame = card.getBoundingClientRect();
      const all = pieces(card);
      for (const { box, name } of all) {
        if (box.left < frame.left - SLACK || box.right > frame.right + SLACK || box.bottom > frame.bottom + SLACK) {
          found.push(`leaves its card: ${name} ${JSON.stringify(box)} of ${JSON.stringify(frame)}`);
        }
        if (!box.scrolls && box.right > clientWidth + SLACK) found.push(`leaves the window: ${name}`);
      }
      for (const [at, one] of all.entries()) {
        for (const two of all.slice(at + 1)) {
          if (one.element === two.element || one.element.contains(two.element) || two.element.contains(one.element)) continue;
          const wide = Math.min(one.box.right, two.box.right) - Math.max(one.box.left, two.box.left);
          const high = Math.min(one.box.bottom, two.box.bottom) - Math.max(one.box.top, two.box.top);
          if (wide > SLACK && high > 2) found.push(`overlap by ${wide.toFixed(1)} x ${high.toFixed(1)}: "${one.name}" and "${two.name}"`);
        }
      }
    }
    return [...new Set(found)];
  });
}

/** Watches every switch at every frame until it is asked how far one has moved or grown, in pixels. */
export async function watchSwitches(page) {
  await page.evaluate(() => {
    const all = [...document.querySelectorAll("main button[role=switch] .track")];
    const place = (element) => {
      const { left, top, width, height } = element.getBoundingClientRect();
      return [left + scrollX, top + scrollY, width, height];
    };
    const first = all.map(place);
    const watch = { moved: 0, seen: 0, on: true };
    window.switchWatch = watch;
    const look = () => {
      for (const [at, element] of all.entries()) {
        place(element).forEach((now, i) => (watch.moved = Math.max(watch.moved, Math.abs(now - first[at][i]))));
      }
      watch.seen += 1;
      if (watch.on) requestAnimationFrame(look);
    };
    look();
  });
  return () =>
    page.evaluate(() => {
      window.switchWatch.on = false;
      return window.switchWatch.moved;
    });
}
