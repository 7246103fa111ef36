// Functions that run in the page: fields and sliders that follow each other, and modes that are dragged.
window.dash_clientside = window.dash_clientside || {};
window.dash_clientside.explore = (() => {
  const STEPS = 1000;
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
    if (!(number > one.offset)) return [same(), same()];
    slider.setAttribute("aria-valuetext", String(number));
    const share = Math.log((number - one.offset) / one.low) / Math.log(one.high / one.low);
    return [same(), Math.round(STEPS * Math.min(Math.max(share, 0), 1))];
  }

  // A line that is dragged at one of its ends tells of that end only.
  function moved(change) {
    Object.entries(change).forEach(([key, value]) => {
      const parts = key.match(/^shapes\[(\d+)\]\.x[01]$/);
      if (parts && value > 0) window.dash_clientside.set_props("hz-" + parts[1], { value: short(value) });
    });
  }

  // A picture that is drawn anew would take away what is being dragged.
  const hold = (held) => window.dash_clientside.set_props("tick", { disabled: held });
  document.addEventListener("pointerdown", (event) => {
    const picture = event.target.closest("#picture .js-plotly-plot");
    if (!picture) return;
    hold(true);
    if (!picture.followed) picture.on("plotly_relayout", moved); // none of its events is lost, as between two of a property
    picture.followed = true;
  }, true);
  ["pointerup", "pointercancel"].forEach((name) => document.addEventListener(name, () => hold(false), true));

  return { together };
})();
