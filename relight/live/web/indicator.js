// The direction of the light: the sky as a strip, its suns, and the direction of the view.

import { paintSky } from "./light.js";

const SUN = "#e0762d", HEADING = "rgba(255, 255, 255, .85)";

// A strip on a canvas of 2:1. draw(light, angle, exposure, suns): the light turned by radians, and its turned
// suns. look(x, z): where the view points.
export function indicator(canvas) {
  const context = canvas.getContext("2d"), { width, height } = canvas, pixels = context.createImageData(width, height), color = [0, 0, 0];
  let suns = [], heading = null;
  const column = (x, z) => (((0.5 - Math.atan2(x, z) / (2 * Math.PI)) * width) % width + width) % width;
  const show = () => {
    context.putImageData(pixels, 0, 0);
    if (heading !== null) {
      context.fillStyle = HEADING;
      context.fillRect(heading - 0.5, 0, 1, height);
    }
    context.strokeStyle = SUN;
    context.lineWidth = 1.5;
    for (const { direction: [x, y, z] } of suns) {
      context.beginPath();
      context.arc(column(x, z), (0.5 - Math.asin(Math.max(-1, Math.min(1, y))) / Math.PI) * height, 4, 0, 2 * Math.PI);
      context.stroke();
    }
  };
  return {
    draw(light, angle, exposure, turnedSuns) {
      paintSky(light.image, angle, exposure, height, width, pixels.data);
      suns = turnedSuns;
      show();
    },
    look(x, z) {
      const next = column(x, z);
      if (heading !== null && Math.abs(next - heading) < 0.5) return;
      heading = next;
      show();
    },
  };
}
