// SPDX-License-Identifier: Apache-2.0
// Places the explanation of a panel beside this panel, inside the window.

const MARGIN = 8; // smallest distance to the edge of the window and to the panel [pixels]

// Places each explanation when it opens.
export function placeHelps() {
  document.querySelectorAll('.live-help-text').forEach((text) => {
    text.addEventListener('toggle', () => { if (text.matches(':popover-open')) place(text); });
  });
}

function place(text) {
  const { offsetWidth: width, offsetHeight: height } = text;
  const [right, bottom] = [window.innerWidth - width - MARGIN, window.innerHeight - height - MARGIN];
  const opener = document.querySelector(`[popovertarget="${text.id}"]`);
  const panel = (opener.closest('figure') || opener).getBoundingClientRect();
  const button = opener.getBoundingClientRect();
  const inside = (value, largest) => Math.max(MARGIN, Math.min(value, largest));
  const along = inside(button.right - width, right);
  const beside = inside(panel.top, bottom);
  const found = [
    [along, panel.bottom + MARGIN], [along, panel.top - height - MARGIN],
    [panel.right + MARGIN, beside], [panel.left - width - MARGIN, beside],
  ].find(([x, y]) => x >= MARGIN && x <= right && y >= MARGIN && y <= bottom);
  const [x, y] = found || [along, inside(panel.bottom + MARGIN, bottom)];
  Object.assign(text.style, { left: `${x}px`, top: `${y}px` });
}
