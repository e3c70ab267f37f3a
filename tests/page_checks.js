// Checks of a page in the browser: what somebody with weak eyes, a screen reader or no mouse would stumble over.
(name) => {
  const brush = document.createElement("canvas").getContext("2d", { willReadFrequently: true });

  // Any colour of CSS as red, green, blue and how much it covers.
  const rgba = (colour) => {
    brush.clearRect(0, 0, 1, 1);
    brush.fillStyle = colour;
    brush.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = brush.getImageData(0, 0, 1, 1).data;
    return [r, g, b, a / 255];
  };
  const over = (top, under) => top.slice(0, 3).map((part, at) => part * top[3] + under[at] * (1 - top[3]));
  const ground = (one) => {
    if (!one) return [255, 255, 255];
    const own = rgba(getComputedStyle(one).backgroundColor);
    return own[3] === 1 ? own.slice(0, 3) : over(own, ground(one.parentElement));
  };
  // Relative luminance and contrast ratio of WCAG 2.2.
  const linear = (part) => (part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4);
  const light = (colour) => {
    const [r, g, b] = colour.map((part) => linear(part / 255));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const contrast = (one, other) => {
    const [a, b] = [light(one), light(other)].sort((x, y) => y - x);
    return (a + 0.05) / (b + 0.05);
  };
  const opacity = (one) => (one ? Number(getComputedStyle(one).opacity) * opacity(one.parentElement) : 1);
  const hasText = (one) => [...one.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());

  const weak = () =>
    [...document.querySelectorAll("body *")]
      .filter((one) => hasText(one) && one.checkVisibility() && !one.closest(".unseen, noscript, svg, .skip"))
      .map((one) => {
        const under = ground(one);
        const colour = rgba(getComputedStyle(one).color);
        colour[3] *= opacity(one);
        return [contrast(over(colour, under), under), one.outerHTML.slice(0, 100)];
      })
      .filter(([ratio]) => ratio < 4.5);

  const labelOf = (one) => {
    const labelled = document.getElementById(one.getAttribute("aria-labelledby"))?.textContent;
    const labels = [...(one.labels ?? [])].map((label) => label.textContent).join("");
    return one.getAttribute("aria-label") || labelled || labels || one.textContent;
  };
  const nameless = () =>
    [...document.querySelectorAll("button, a[href], input, select, img")]
      .filter((one) => one.checkVisibility())
      .filter((one) => (one.matches("img") ? !one.hasAttribute("alt") : !labelOf(one).trim()))
      .map((one) => one.outerHTML.slice(0, 120));

  const focused = () => {
    const one = document.activeElement;
    if (!one || one === document.body) return null;
    const style = getComputedStyle(one);
    const isOutlined = style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 2;
    return { kind: one.dataset.kind ?? one.id, html: one.outerHTML.slice(0, 80), isOutlined };
  };

  return { weak, nameless, focused }[name]();
}
