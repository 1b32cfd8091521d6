// SPDX-License-Identifier: Apache-2.0
// A picture of all plots of the page.

import { theme } from './drawing.js';

// Returns a canvas with the visible figures of an element: captions, plots and legends.
export function picture(plots) {
  const look = theme();
  const ratio = window.devicePixelRatio || 1;
  const whole = plots.getBoundingClientRect();
  const figures = [...plots.querySelectorAll('.live-figure')].filter((figure) => figure.offsetHeight && figure.querySelector('canvas').offsetHeight);
  const bottom = Math.max(...figures.map((figure) => figure.getBoundingClientRect().bottom));
  const canvas = Object.assign(document.createElement('canvas'), {
    width: Math.round(whole.width * ratio), height: Math.round((bottom - whole.top) * ratio),
  });
  const c = canvas.getContext('2d');
  c.scale(ratio, ratio);
  c.fillStyle = look.panel;
  c.fillRect(0, 0, whole.width, bottom - whole.top);
  const boxOf = (element) => {
    const box = element.getBoundingClientRect();
    return [box.left - whole.left, box.top - whole.top, box.width, box.height];
  };
  c.textBaseline = 'middle';
  figures.forEach((figure) => {
    c.strokeStyle = look.line;
    c.strokeRect(...boxOf(figure));
    const plot = figure.querySelector('canvas');
    c.drawImage(plot, ...boxOf(plot));
    figure.querySelectorAll('figcaption, figcaption span, .live-legend span').forEach((label) => {
      const [x, y, , height] = boxOf(label);
      const text = label.tagName === 'FIGCAPTION' ? label.firstChild.textContent : label.textContent;
      c.fillStyle = label.parentElement.className === 'live-legend' ? getComputedStyle(label, '::before').borderTopColor : look.ink;
      c.font = label.tagName === 'FIGCAPTION' ? '600 16px system-ui, sans-serif' : '15px system-ui, sans-serif';
      c.fillText(text.trim(), x, y + Math.min(height, 24) / 2);
    });
  });
  return canvas;
}

export function download(blob, name) {
  const link = Object.assign(document.createElement('a'), { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
