// Functions that run in the page: fields and sliders that follow each other, and modes that are dragged.
window.dash_clientside = window.dash_clientside || {};
window.dash_clientside.explore = (() => {
  const STEPS = 1000;
  const same = () => window.dash_clientside.no_update; // not there yet when this is read
  const short = (value) => Number(value.toPrecision(6));

  function together(number, place, name) {
    const one = window.explored[name];
    const slider = document.getElementById(name + "-slider");
    const moved = window.dash_clientside.callback_context.triggered_id === name + "-slider";
    if (moved) {
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
  function moved(change, ...before) {
    const found = before.map(same);
    Object.entries(change || {}).forEach(([key, value]) => {
      const parts = key.match(/^shapes\[(\d+)\]\.x[01]$/);
      if (parts && value > 0 && short(value) !== before[parts[1]]) found[parts[1]] = short(value);
    });
    return found.length === 1 ? found[0] : found;
  }

  return { together, moved };
})();
