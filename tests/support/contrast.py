"""Shared by the tests: contrast of all text of a page as a browser shows it, by WCAG 2."""

import json

_SCRIPT = """
(() => {
  const parts = (text) => { const m = text.match(/[\\d.]+/g).map(Number); return m.length < 4 ? [...m, 1] : m; };
  const over = (front, back) => [0, 1, 2].map((k) => front[k] * front[3] + back[k] * (1 - front[3]));
  const linear = (v) => v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4;
  const light = (c) => 0.2126 * linear(c[0]) + 0.7152 * linear(c[1]) + 0.0722 * linear(c[2]);
  const behind = (one) => {
    const found = [];
    for (; one; one = one.parentElement) { found.push(parts(getComputedStyle(one).backgroundColor)); }
    return found.reverse().reduce((back, front) => over(front, back), [255, 255, 255]);
  };
  const found = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const text = walk.currentNode.textContent.trim(), one = walk.currentNode.parentElement, style = getComputedStyle(one);
    const shown = style.visibility !== "hidden" && one.getClientRects().length && !one.closest("svg");
    if (!text || !shown || ["SCRIPT", "STYLE", "NOSCRIPT"].includes(one.tagName)) { continue; }
    const back = behind(one), [a, b] = [light(over(parts(style.color), back)), light(back)];
    const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    found.push([(Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05) / (large ? 3 : 4.5), text.slice(0, 40)]);
  }
  return JSON.stringify(found.sort((one, other) => one[0] - other[0]).slice(0, 3));
})()
"""


def least_contrast(browser):
    """The text with the least contrast, and the ratio as a share of what it needs: 4.5, of large letters 3."""
    return tuple(json.loads(browser.value(_SCRIPT))[0])
