// Looking closely at a flat drawing: wheel and drag, buttons and keys move the part of it that is shown.
import { html, useEffect, useRef, useState } from "./vendor.js";
import { t } from "./words.js";

// `whole` [x, y, width, height] is all that there is, `first` what is shown to begin with. Returns the box that is shown,
// the properties of the <svg>, and a way to change the box.
export function useLook(whole, first = whole) {
  const [box, setBox] = useState(first), svg = useRef(), start = useRef(null);
  const zoom = (factor, at = [0.5, 0.5]) => setBox(([x, y, w, h]) => {
    const to = Math.min(Math.max(1, whole[3] / h / (whole[2] / w)) * whole[2], Math.max(0.005 * whole[2], w * factor)), nh = (to / w) * h;
    return [x + (w - to) * at[0], y + (h - nh) * at[1], to, nh];
  });
  const look = useRef(zoom);
  look.current = zoom;
  useEffect(() => {
    const wheel = (event) => { event.preventDefault(); const place = svg.current.getBoundingClientRect(); look.current(event.deltaY > 0 ? 1.2 : 1 / 1.2, [(event.clientX - place.left) / place.width, (event.clientY - place.top) / place.height]); };
    const node = svg.current;
    node.addEventListener("wheel", wheel, { passive: false });
    return () => node.removeEventListener("wheel", wheel);
  }, []);
  const props = {
    ref: svg, viewBox: box.join(" "), tabindex: "0", style: { touchAction: "none", cursor: "grab" },
    onPointerDown: (event) => { start.current = [event.clientX, event.clientY, box[0], box[1]]; },
    onPointerUp: () => { start.current = null; },
    onPointerMove: (event) => {
      if (!event.buttons || !start.current) return;
      const place = svg.current.getBoundingClientRect(), scale = Math.max(box[2] / place.width, box[3] / place.height);
      setBox([start.current[2] - (event.clientX - start.current[0]) * scale, start.current[3] - (event.clientY - start.current[1]) * scale, box[2], box[3]]);
    },
    onKeyDown: (event) => {
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
      if (step) setBox(([x, y, w, h]) => [x + step[0] * w, y + step[1] * h, w, h]);
      else if (event.key === "+") zoom(1 / 1.3); else if (event.key === "-") zoom(1.3); else return;
      event.preventDefault();
    },
  };
  return { box, setBox, zoom, props };
}

export const Zoom = ({ zoom }) => html`<div class="segment"><button aria-label=${t("zoom_in")} onClick=${() => zoom(1 / 1.5)}>+</button><button aria-label=${t("zoom_out")} onClick=${() => zoom(1.5)}>−</button></div>`;
