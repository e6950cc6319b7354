// SPDX-License-Identifier: Apache-2.0
// Run in a page: texts whose contrast to their ground is too low (WCAG 2.2, 1.4.3), and the controls that Tab must reach.
(() => {
  const shown = (element) => element.checkVisibility({ visibilityProperty: true }) && element.getClientRects().length > 0;
  const parse = (color) => color.match(/[\d.]+/g).map(Number);
  const groundOf = (element) => {
    for (let one = element; one; one = one.parentElement) {
      const [r, g, b, alpha = 1] = parse(getComputedStyle(one).backgroundColor);
      if (alpha === 1) {
        return [r, g, b];
      }
    }
    return [255, 255, 255];
  };
  const luminance = (color) => {
    const [r, g, b] = color.map((each) => (each / 255 <= 0.04045 ? each / 255 / 12.92 : ((each / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const pale = [];
  for (const element of document.querySelectorAll("body, body *")) {
    const own = [...element.childNodes].filter((node) => node.nodeType === 3).map((node) => node.data.trim()).join(" ").trim();
    if (own && shown(element) && element.tagName !== "OPTION") {
      const style = getComputedStyle(element), [dark, light] = [parse(style.color), groundOf(element)].map(luminance).sort((a, b) => a - b);
      const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
      const ratio = (light + 0.05) / (dark + 0.05);
      if (ratio < (large ? 3 : 4.5)) {
        pale.push(`${element.tagName} "${own.slice(0, 40)}" ${ratio.toFixed(2)}`);
      }
    }
  }
  const controls = [...document.querySelectorAll("a[href], button, input, select, summary, [tabindex='0']")]
    .filter((element) => shown(element) && !element.disabled);
  controls.forEach((element, i) => {
    element.dataset.reach = i;
  });
  return { pale, controls: controls.map(({ outerHTML }) => outerHTML.slice(0, 80)) };
})()
