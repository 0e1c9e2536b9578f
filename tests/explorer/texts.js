() => {
  // Texts that are cut by what they lie in, overlap each other, or have a contrast below 4.5.
  const faults = [], texts = [], root = document.documentElement;
  const brief = (text) => text.trim().replace(/\s+/g, " ").slice(0, 60);
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const parent = node.parentElement;
    if (!node.data.trim() || parent.closest(".unseen, .skip, option, title, style, script")) continue;
    if (!parent.checkVisibility({ checkVisibilityCSS: true, checkOpacity: true })) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    const drawn = parent.closest("text"), whole = drawn ?? node;
    for (const rect of drawn ? [drawn.getBoundingClientRect()] : range.getClientRects()) {
      if (rect.width > 1) texts.push({ words: brief(node.data), rect, parent, whole });
    }
  }
  for (const { words, rect, parent } of texts) {
    for (let box = parent; box && box !== document.body; box = box.parentElement) {
      const style = getComputedStyle(box), edge = box.getBoundingClientRect();
      const cuts = (flow) => box.tagName === "svg" || /hidden|clip|auto|scroll/.test(flow);
      // What scrolls downwards shows the rest in time; nobody looks sideways.
      const side = cuts(style.overflowX) ? Math.max(edge.left - rect.left, rect.right - edge.right) : 0;
      const still = box.tagName === "svg" || /hidden|clip/.test(style.overflowY);
      const over = still ? Math.max(edge.top - rect.top, rect.bottom - edge.bottom) - 0.15 * rect.height : 0;
      if (side > 1 || over > 1) {
        faults.push(`cut by ${Math.max(side, over).toFixed(0)} px: ${words}`);
        break;
      }
      if (style.position === "fixed") break;
    }
    if (rect.right > root.clientWidth + 1 || rect.left < -1) faults.push(`beyond the page: ${words}`);
  }
  for (const box of document.querySelectorAll("input[type=text]")) {
    const full = !box.checkVisibility() || box.scrollWidth <= box.clientWidth + 1;
    if (!full) faults.push(`cut in its field: ${box.value || box.placeholder}`);
  }
  const parts = (colour) => colour.match(/[\d.]+/g).map(Number);
  const light = (colour) => {
    const linear = parts(colour).map((c) => (c > 10 ? ((c / 255 + 0.055) / 1.055) ** 2.4 : c / 255 / 12.92));
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2] + 0.05;
  };
  for (const { words, parent } of texts) {
    if (parent.closest(":disabled")) continue;
    const style = getComputedStyle(parent), clear = (box) => (parts(getComputedStyle(box).backgroundColor)[3] ?? 1) < 1;
    let ground = parent;
    while (ground !== root && clear(ground)) ground = ground.parentElement;
    const under = light(getComputedStyle(ground).backgroundColor);
    const over = light(parent.closest("text") ? style.fill : style.color);
    const contrast = Math.max(over, under) / Math.min(over, under);
    if (contrast < 4.5) faults.push(`pale, ${contrast.toFixed(1)} to 1: ${words}`);
  }
  const pen = document.createElement("canvas").getContext("2d");
  for (const box of document.querySelectorAll("select")) {
    if (!box.checkVisibility()) continue;
    const style = getComputedStyle(box);
    pen.font = style.font;
    const room = box.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight) - 16;
    const wide = pen.measureText(box.selectedOptions[0]?.text ?? "").width;
    if (wide > room + 1) faults.push(`cut in its list: ${box.selectedOptions[0].text}`);
  }
  // What is scrolled out of its box is in nobody's way.
  for (const text of texts) {
    for (let box = text.parent; box; box = box.parentElement) {
      if (!/auto|scroll/.test(getComputedStyle(box).overflowY) || box === document.body) continue;
      const { top, bottom } = box.getBoundingClientRect();
      const seen = [Math.max(text.rect.top, top), Math.min(text.rect.bottom, bottom)];
      text.rect = new DOMRect(text.rect.left, seen[0], text.rect.width, Math.max(0, seen[1] - seen[0]));
    }
  }
  texts.sort((a, b) => a.rect.top - b.rect.top);
  for (let i = 0; i < texts.length; i++) {
    const a = texts[i];
    for (let j = i + 1; j < texts.length && texts[j].rect.top < a.rect.bottom; j++) {
      const b = texts[j];
      if (a.whole === b.whole) continue;
      const across = Math.min(a.rect.right, b.rect.right) - Math.max(a.rect.left, b.rect.left);
      const down = Math.min(a.rect.bottom, b.rect.bottom) - Math.max(a.rect.top, b.rect.top);
      // Letters leave a quarter of their box empty above and below.
      const fixed = (t) => t.parent.closest(".numbers, .menu[open] .panel");
      if (fixed(a) !== fixed(b)) continue;
      if (across > 2 && down > 0.3 * Math.min(a.rect.height, b.rect.height)) {
        faults.push(`overprinted by ${across.toFixed(0)} x ${down.toFixed(0)} px: ${a.words} | ${b.words}`);
      }
    }
  }
  return [...new Set(faults)];
}
