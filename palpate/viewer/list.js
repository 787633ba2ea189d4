"use strict";
// The page of a run: shows the objects that have all words of the filter.
(() => {
  const filter = document.getElementById("filter");
  const objects = [...document.querySelectorAll("figure[data-words]")];
  const count = document.getElementById("count");
  function apply() {
    const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const each of objects) each.hidden = !words.every((word) => each.dataset.words.includes(word));
    count.textContent = words.length ? `${objects.filter((each) => !each.hidden).length} of ${objects.length}` : "";
  }
  filter.addEventListener("input", apply);
  document.body.dataset.state = "ready";
})();
