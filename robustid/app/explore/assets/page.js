// Functions that run in the page: fields and sliders that follow each other, and modes that are dragged.
window.dash_clientside = window.dash_clientside || {};
window.dash_clientside.explore = (() => {
  const STEPS = 1000, STEP = 100; // of a slider; milliseconds between two steps of a line
  const same = () => window.dash_clientside.no_update; // not there yet when this is read
  const short = (value) => Number(value.toPrecision(6));

  function together(number, place, name) {
    const one = window.explored[name];
    const slider = document.getElementById(name + "-slider");
    const slid = window.dash_clientside.callback_context.triggered_id === name + "-slider";
    if (slid) {
      const value = short(one.offset + one.low * Math.pow(one.high / one.low, place / STEPS));
      slider.setAttribute("aria-valuetext", String(value));
      return [value, same()];
    }
    const part = (number - one.offset) / one.low;
    if (number === undefined || number === null) return [same(), same()];
    slider.setAttribute("aria-valuetext", String(number));
    if (!(part > 0)) return [same(), same()];
    const width = one.high / one.low;
    if (name.startsWith("hz-") && (part < 1 || part > width)) { // another mode, or a long way
      [one.low, one.high] = [number / Math.sqrt(width), number * Math.sqrt(width)];
    }
    const share = Math.log((number - one.offset) / one.low) / Math.log(width);
    return [same(), Math.round(STEPS * Math.min(Math.max(share, 0), 1))];
  }

  const move = (number, value) => {
    if (value > 0) window.dash_clientside.set_props("hz-" + number, { value: short(value) });
  };

  // A line that is dragged at one of its ends tells of that end only.
  function moved(change) {
    Object.entries(change).forEach(([key, value]) => {
      const parts = key.match(/^shapes\[(\d+)\]\.x[01]$/);
      if (parts) move(parts[1], value);
    });
  }

  // The line of a mode while it is dragged: a picture that is drawn anew has another one in its place, which follows it.
  let dragged = null, told = 0, later = 0;
  const drawn = (picture, number) =>
    [...picture.querySelectorAll(`.shapelayer [data-index="${number}"] path`)].find((one) => !one.closest("[drag-helper]"));
  function follow() {
    clearTimeout(later);
    if (!dragged) return;
    const { picture, line, number } = dragged, x = parseFloat(line.getAttribute("d").slice(1)), now = performance.now();
    const other = drawn(picture, number), axis = picture._fullLayout.xaxis;
    if (other && other !== line) other.setAttribute("d", other.getAttribute("d").replace(/([ML])[^,]+/g, "$1" + x));
    if (x === dragged.x) return;
    if (now - told < STEP) {
      later = setTimeout(follow, STEP);
      return;
    }
    [told, dragged.x] = [now, x];
    move(number, axis.p2d(x - axis._offset));
  }

  // A picture that is drawn anew would take away a range that is being chosen in it.
  const hold = (held) => window.dash_clientside.set_props("tick", { max_intervals: held ? 0 : -1 });
  document.addEventListener("pointerdown", (event) => {
    const picture = event.target.closest("#picture .js-plotly-plot");
    if (!picture) return;
    const held = event.target.closest("[drag-helper]"), number = held && held.dataset.index;
    dragged = held && { picture, line: drawn(picture, number), number };
    if (!held) hold(true);
    if (!picture.followed) picture.on("plotly_relayout", moved); // none of its events is lost, as between two of a property
    picture.followed = true;
  }, true);
  // Plotly hears of a pointer by the mouse events, which come after.
  document.addEventListener("mousemove", () => { if (dragged) setTimeout(follow); }, true);
  ["pointerup", "pointercancel"].forEach((name) => document.addEventListener(name, () => { dragged = null; hold(false); }, true));

  document.addEventListener("change", (event) => { if (event.target.id === "views") location.href = event.target.value; });

  return { together };
})();
